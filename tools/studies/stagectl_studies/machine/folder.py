"""What the user has: CSVs, captures.yaml and nominal.yaml."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import yaml

from stagectl_studies.machine.controller import Loop, Model
from stagectl_studies.machine.machine import Floats
from stagectl_studies.machine.plant import Trace
from stagectl_studies.machine.reference import PERIOD
from stagectl_studies.machine.trials import Capture, Trial

ACCURACY = "nominal values may be off by 10 to 15 percent; the force constant is meant to be right"
DRIVE: dict[str, float | None] = {
    "current_loop_s": 0.000159,
    "delay_samples": 1,
    "resistance_ohm": 1.1,
    "back_emf_V_per_unit_s": 0.48,
    "current_limit_A": None,
    "voltage_limit_V": None,
}


def write_csv(path: Path, columns: dict[str, Floats]) -> None:
    """Columns with their shortest exact decimals."""
    table = pa.table({name: values + 0.0 for name, values in columns.items()})  # + 0.0: no negative zeros
    with path.open("wb") as file:
        file.write((",".join(columns) + "\n").encode())
        pacsv.write_csv(table, file, pacsv.WriteOptions(include_header=False, quoting_style="none"))


def capture_columns(capture: Capture, trace: Trace) -> dict[str, Floats]:
    """What one capture holds."""
    return {
        "time_s": np.round(np.arange(trace.position.size) * PERIOD, 7),
        "reference_rad": capture.experiment.reference,
        "position_rad": np.round(trace.position, 12),
        "current_command_A": np.round(trace.command, 8),
        "current_A": np.round(trace.current, 6),
    }


def injection_name(capture: Capture) -> str | None:
    """File of the injected current; None where nothing is injected."""
    return f"{capture.experiment.name}-injection.csv" if np.any(capture.experiment.injection) else None


def entry(capture: Capture) -> dict[str, Any]:
    """One line of captures.yaml."""
    line: dict[str, Any] = {
        "file": capture.file,
        "experiment": capture.experiment.name,
        "repeat": capture.repeat,
        "use": capture.experiment.use,
        "start_s": capture.start,
    }
    name = injection_name(capture)
    return line if name is None else {**line, "injection": name}


def floats(values: Floats) -> list[float]:
    """Plain floats for YAML."""
    return [float(value) for value in values]


def nominal(trial: Trial) -> dict[str, Any]:
    """The user's model and the documented controller."""
    model = trial.model
    friction = {
        "law": "stop-operator",
        "weight": floats(model.weight),
        "slip": floats(model.slip),
        "coulomb": float(model.weight.sum()),
    }
    return {"stage": _stage(model), "friction": friction, "drive": DRIVE, "controller": _controller(model, trial.loop)}


def _stage(model: Model) -> dict[str, Any]:
    return {
        "kind": "ball-screw",
        "position_unit": "rad",
        "torque_unit": "Nm",
        "force_constant": model.force_constant,
        "inertia": model.inertia,
        "viscous": model.viscous,
        "travel_per_unit_mm": 1.9098593171,
        "pitch": 6.283185307,
        "encoder_step": 5.99211e-06,
        "encoder_periods_per_pitch": 2048,
        "accuracy": ACCURACY,
    }


def _controller(model: Model, loop: Loop) -> dict[str, Any]:
    return {
        "Ts": loop.period,
        "bandwidth_Hz": loop.bandwidth,
        "Kp": loop.kp,
        "Ki": loop.ki,
        "Kd": loop.kd,
        "derivative_pole": loop.pole,
        "discretisation": "tustin",
        "model_inertia": model.inertia,
        "model_viscous": model.viscous,
        "model_force_constant": model.force_constant,
        "friction_weight": floats(model.weight),
        "friction_slip": floats(model.slip),
        "feedforward_advance_s": loop.advance,
        "friction_advance_s": loop.friction_advance,
        "measurement_delay_samples": 0,
        "frame_samples": 2,
        "reference_interpolation": "quintic spline (not-a-knot) through all samples of the reference column, "
        "constant outside",
        "states_at_first_row": "integrator, derivative filter and previous error zero; friction operators zero "
        "at the first reference sample",
        "anti_windup": "none",
    }


def write_yaml(path: Path, content: dict[str, Any]) -> None:
    """YAML, lists of numbers on one line, keys in order."""
    path.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=160), encoding="utf-8")


def write_capture(capture: Capture, trace: Trace, folder: Path) -> None:
    """One capture, and with the first of an experiment's repeats the current that was injected."""
    write_csv(folder / capture.file, capture_columns(capture, trace))
    name = injection_name(capture)
    if name is not None and capture.repeat == 1:
        injection = capture.experiment.injection
        time = np.round(np.arange(injection.size) * PERIOD, 7)
        write_csv(folder / name, {"time_s": time, "injection_A": injection})


def write_folder(trial: Trial, traces: Sequence[Trace], folder: Path) -> None:
    """The folder of captures, as its format page says."""
    folder.mkdir(parents=True, exist_ok=True)
    for capture, trace in zip(trial.captures, traces, strict=True):
        write_capture(capture, trace, folder)
    write_yaml(folder / "captures.yaml", {"captures": [entry(capture) for capture in trial.captures]})
    write_yaml(folder / "nominal.yaml", nominal(trial))
