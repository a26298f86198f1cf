"""``nominal.yaml`` of a capture folder: model and controller of a recording in plain values.

What is not known is null or absent, never guessed.
"""

import math
from pathlib import Path
from typing import Any

import yaml

from stagectl.config.friction_laws import Dahl, Lugre, friction_of
from stagectl.config.lengths import Lengths
from stagectl.config.loader import Reader
from stagectl.config.stage_blocks import StageFile
from stagectl.design import Control
from stagectl.drives.drive import Canopen
from stagectl.kernels.effects import TURN
from stagectl.kernels.unloading import Unloading
from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import Recording, RecordingError
from stagectl.recording.metadata import flat, written
from stagectl.units import LINEAR, ROTARY

# The last section of a capture folder's description, for our own law.
_REFERENCE = (
    "quintic spline (not-a-knot) through all samples of the reference column, constant outside; the controller itself "
    "used the motion's own formula, so where the acceleration jumps (trapezoid) or has corners (s_curve) the "
    "recomputed feedforward differs for some rows around"
)
_START = "integrator, derivative filter and previous error zero; friction operators zero at the first reference sample"
_ANTI_WINDUP = (
    "conditional integration: while the command exceeds command_limit_A and the error has its sign, the integrator "
    "keeps its value"
)
# Fields of a stage file with defaults that are no effects: stage, friction and drive of nominal.yaml have them.
_ELSEWHERE = {"bias", "pitch", "elements", "exponent", "damping", "stribeck", "delay_samples", "counts_per_revolution"}
_ELSEWHERE |= {"resistance", "back_emf", "voltage_limit"}
_ACCURACY = "the values that the controller was designed for; how true they are of the machine is not known"


def nominal_of(recording: Recording) -> dict[str, Any]:
    """All that a recording knows of its stage and controller, in the words of nominal.yaml."""
    meta = recording.meta
    if "nominal" in meta:  # it came from such a file
        nominal: dict[str, Any] = meta["nominal"]
        return nominal
    if "law" not in meta:
        return {"stage": {"name": meta["name"], **axis_values(meta["axis"])}}
    file = carried_stage(recording)
    return {
        "stage": _stage(file, meta["axis"]),
        "friction": _friction(file),
        "drive": _drive(file),
        "controller": _controller(file, meta),
        **({"effects": nominal} if (nominal := effects_of(file)) else {}),
    }


def difference(a: dict[str, Any], b: dict[str, Any]) -> str:
    """Where two descriptions first differ, apart from their names, which decide nothing; empty where nowhere."""
    one, other = flat(a), flat(b)
    differing = (key for key in one | other if key != "stage.name" and one.get(key) != other.get(key))
    return next((f"{key} ({other.get(key)} and {one.get(key)})" for key in differing), "")


def effects_of(file: StageFile) -> dict[str, Any]:
    """The effects that act in this stage, by block and field as in its file, SI; neutral ones are absent."""
    blocks = {name: _acting(getattr(file, name)) for name in ("motor", "mechanics", "friction", "encoder", "drive")}
    blocks["encoder"].pop("step", None)  # of its counts; that of the friction is an effect
    known = {name: block for name, block in blocks.items() if block}
    if file.residual is not None:
        known["residual"] = {**file.residual._asdict(), "values": list(file.residual.values)}
    return known


def _acting(block: Any) -> dict[str, Any]:
    """Fields of a block that are not neutral, without those that are elsewhere in nominal.yaml."""
    changed = {
        name: value
        for name, value in block._asdict().items()
        if name not in _ELSEWHERE and name in block._field_defaults and value != block._field_defaults[name]
    }
    return {name: written(value) for name, value in changed.items()}


def carried_stage(recording: Recording) -> StageFile:
    """The stage file whose text a recording of ours carries."""
    axis = recording.meta["axis"]
    lead = 2.0 * math.pi * axis["travel_per_unit"] if axis["kind"] == ROTARY and axis["travel_unit"] == "m" else 0.0
    name, text = (recording.meta["files"]["stage"][part] for part in ("name", "text"))
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    if root is None:
        raise RecordingError(f"{recording.path} carries an empty stage file {name}", recording.path, ProblemKind.SYNTAX)
    reader = Reader(Path(name), Lengths(axis["kind"], lead))
    file: StageFile = reader.value(StageFile, root, "")
    reader.finish()
    return file


def axis_values(axis: dict[str, Any]) -> dict[str, Any]:
    """What nominal.yaml says of an axis, from the entry of a recording's meta."""
    linear, screw = axis["kind"] == LINEAR, axis["travel_unit"] == "m"
    known = {
        "kind": LINEAR if linear else ("ball-screw" if screw else ROTARY),
        "position_unit": "m" if linear else "rad",
        "torque_unit": "N" if linear else "Nm",
        "travel_per_unit_mm": 1e3 * axis["travel_per_unit"] if screw else None,
        "encoder_step": axis["encoder_step"] or None,
    }
    return {name: value for name, value in known.items() if value is not None}


def _stage(file: StageFile, axis: dict[str, Any]) -> dict[str, Any]:
    mechanics, wave = file.mechanics, file.encoder.interpolation
    return {
        "name": file.name,
        **axis_values(axis),
        "force_constant": file.motor.force_constant,
        "inertia": mechanics.inertia,
        "viscous": mechanics.viscous,
        "bias": mechanics.bias,
        "pitch": mechanics.pitch if file.axis.lead or mechanics.pitch != TURN else None,
        "encoder_periods_per_pitch": wave.order if wave.order > 1.0 else None,
        "accuracy": _ACCURACY,
    }


def _friction(file: StageFile) -> dict[str, Any]:
    if isinstance(file.friction, Dahl | Lugre):
        name = "dahl" if isinstance(file.friction, Dahl) else "lugre"
        return {"law": name, **written(file.friction.bristle())}
    operators, beside = file.friction.operators(), friction_of(file.friction).bristle
    return {
        "law": "stop-operator",
        "weight": written(operators.weight),
        "slip": written(operators.slip),
        "coulomb": math.fsum(operators.weight),
        **({"stribeck": file.friction.stribeck._asdict()} if file.friction.stribeck.rise else {}),
        **({"bristle": written(beside)} if beside.coulomb else {}),
    }


def _drive(file: StageFile) -> dict[str, Any]:
    wire = file.drive.wire
    powered = file.drive.voltage_limit < math.inf  # without a limit nothing is known of winding and supply
    return {
        "current_quantum_A": wire.command_scale if isinstance(wire, Canopen) else None,
        "current_loop_s": file.drive.current_lag,
        "delay_samples": file.drive.delay_samples,
        "resistance_ohm": file.drive.resistance if powered else None,
        "back_emf_V_per_unit_s": file.drive.back_emf if powered else None,
        "current_limit_A": file.drive.current_limit,
        "voltage_limit_V": file.drive.voltage_limit if powered else None,
    }


def _controller(file: StageFile, meta: dict[str, Any]) -> dict[str, Any]:
    return {
        "Ts": meta["dt"],
        **(_cascade(meta) if meta["law"]["cascaded"] else _pid(file, meta)),
        **_anticipation(file, meta),
        **_observer(meta),
        "standstill_band": meta["law"].get("standstill_band", 0.0),
        "unloading": list(Unloading(**held)) if (held := meta["law"].get("unloading")) else None,
        "states_at_first_row": _START,
        "anti_windup": _ANTI_WINDUP,
        "command_limit_A": meta["law"]["current_limit"],
    }


def _pid(file: StageFile, meta: dict[str, Any]) -> dict[str, Any]:
    pid, dt = meta["law"]["feedback"], meta["dt"]
    pole = 2.0 * (1.0 - pid["decay"]) / (dt * (1.0 + pid["decay"]))  # Tustin's rule, backwards
    return {
        "bandwidth_Hz": file.control.bandwidth if isinstance(file.control, Control) else None,
        "Kp": pid["proportional"],
        "Ki": 2.0 * pid["integral"] / dt,
        "Kd": pid["derivative"] * (2.0 + pole * dt) / (2.0 * pole),
        "derivative_pole": pole,
        "discretisation": "tustin",
    }


def _cascade(meta: dict[str, Any]) -> dict[str, Any]:
    p = meta["law"]["cascade"]
    return {
        "law": "v = position_gain (y0 - position) + velocity_feedforward dreference/dt - dq; dq = (position[k] - "
        "position[k-span]) / (span Ts); force = velocity_gain v + I, I by Tustin's rule; feedback[k] = retained "
        "feedback[k-1] + (1 - retained) force[k]",
        "position_gain": p["position"],
        "velocity_gain": p["velocity"],
        "integral_gain": 2.0 * p["integral"] / meta["dt"],
        "retained": p["retained"],
        "velocity_feedforward": p["share"],
        "reference_velocity": "derivative",
        "span": p["span"],
    }


def _observer(meta: dict[str, Any]) -> dict[str, Any]:
    """The disturbance observer, where there is one."""
    p = meta["law"].get("observer", {"active": False})
    if not p["active"]:
        return {}
    return {
        "observer": "e = position - x1; d + k3 e is subtracted from the command; then x1 += a12 x2 + b1 u + k1 e, x2 = "
        "a22 x2 + b2 u + k2 e, d += k3 e, with u = share c[k-delay] + (1 - share) c[k-delay-1] + d as it was; c = "
        "limited command less friction compensation",
        "observer_model": {name: p[name] for name in ("a12", "a22", "b1", "b2", "delay", "share")},
        "observer_gains": [p["position"], p["velocity"], p["disturbance"]],
    }


def _anticipation(file: StageFile, meta: dict[str, Any]) -> dict[str, Any]:
    """The parts of the command other than the feedback."""
    ahead, dt = meta["feedforward"], meta["dt"]
    advance = file.drive.current_lag + meta["nd"] * dt + file.drive.dead_time
    by_model, bristle = meta["compensation"]["form"] == "model", friction_of(file.friction).bristle
    friction = ahead["friction"] if ahead["with_friction"] and by_model else {"weight": (), "slip": ()}
    beside = ahead["with_friction"] and by_model and bristle.coulomb  # in addition to the stop operators
    return {
        "model_inertia": file.mechanics.inertia,
        "model_viscous": file.mechanics.viscous,
        "model_force_constant": ahead["force_constant"],
        "feedforward": "perfect tracking" if ahead["with_ptc"] else "none: y0 is the reference",
        **({"friction_compensation": meta["compensation"]} if ahead["with_friction"] and not by_model else {}),
        **({"friction_bristle": written(bristle)} if beside else {}),
        "friction_weight": list(friction["weight"]),
        "friction_slip": list(friction["slip"]),
        "effect_feedforward": "nominal" if "effects" in meta.get("layers", ()) else "none",
        "feedforward_advance_s": advance,
        "friction_advance_s": advance + 0.5 * dt,
        "measurement_delay_samples": meta["nm"],
        "frame_samples": 2,
        "reference_interpolation": _REFERENCE,
    }
