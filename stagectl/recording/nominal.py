"""``nominal.yaml`` of a capture folder: model and controller in plain values, from a recording and back to scales.

What is not known is null or absent, never guessed.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from stagectl.config.friction_laws import Dahl, Lugre
from stagectl.config.loader import Lengths, Reader
from stagectl.config.source import compose
from stagectl.config.stage_file import Setup, StageFile
from stagectl.design import Control
from stagectl.kernels import friction_bristle
from stagectl.recording.hdf5 import Recording, RecordingError
from stagectl.units import LINEAR, ROTARY, UnitError, factor

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
_ACCURACY = "the values that the controller was designed for; how true they are of the machine is not known"


class Scales(NamedTuple):
    """How a log's units become those of the axis; 0 where a scale is not known."""

    kind: str  # rotary or linear
    travel_per_unit: float = 1.0  # m per rad (a screw), else 1
    travel_unit: str = "m"
    encoder_step: float = 0.0  # rad | m a count
    force_constant: float = 0.0  # N m/A | N/A
    amplifier: float = 0.0  # A/V, of the drive's analogue input

    def position(self, unit: str) -> float:
        """Factor from a position in `unit` to rad | m.

        Raises RecordingError where the axis or a missing scale forbids it.
        """
        inside = "m" if self.kind == LINEAR else "rad"
        if unit == "counts":
            return self._known(self.encoder_step, "counts", "stage.encoder_step")
        through_screw = self.kind == ROTARY and self.travel_unit == "m"
        try:
            return factor(unit, inside)
        except UnitError as error:
            if through_screw:
                return factor(unit, "m") / self.travel_per_unit
            raise RecordingError(f"a position in {unit} on an axis whose positions are in {inside}: {error}") from error

    def current(self, unit: str) -> float:
        """Factor from a current, force, torque or amplifier voltage in `unit` to A.

        Raises RecordingError where a scale is missing.
        """
        effort = "N" if self.kind == LINEAR else "N m"
        spelled = "N m" if unit == "Nm" else unit
        if unit in ("V", "mV"):
            return factor(unit, "V") * self._known(self.amplifier, "a voltage", "drive.amplifier_A_per_V")
        if unit in ("N", "kN", "Nm", "mNm"):
            return factor(spelled.replace("mNm", "mN m"), effort) / self._known(
                self.force_constant, f"an effort in {unit}", "stage.force_constant"
            )
        return factor(spelled, "A")

    def _known(self, value: float, what: str, key: str) -> float:
        if value == 0.0:
            raise RecordingError(f"{what} has no scale: write {key} in nominal.yaml beside the log, or give --stage")
        return value


def scales_of_stage(setup: Setup, amplifier: float = 0.0) -> Scales:
    """The scales that a stage file gives; it says nothing of an analogue `amplifier` (A/V)."""
    axis, p = setup.file.axis, setup.stage
    return Scales(axis.kind, axis.travel_per_unit, axis.travel_unit, p.encoder.step, p.motor.force_constant, amplifier)


def scales_of_nominal(nominal: dict[str, Any], place: Path) -> Scales:
    """The scales that a nominal.yaml at `place` gives.

    Raises RecordingError where the axis is not told or a scale is no positive number.
    """
    stage, drive = _block(nominal, "stage", place), _block(nominal, "drive", place)
    unit = stage.get("position_unit") or ("m" if stage.get("kind") == LINEAR else "rad")
    if unit not in ("m", "rad"):
        raise RecordingError(f"stage.position_unit = {unit}; must be rad or m ({place})")
    kind = LINEAR if unit == "m" else ROTARY
    per_unit = 1e-3 * _positive(stage, "travel_per_unit_mm", place) if kind == ROTARY else 0.0
    return Scales(
        kind,
        per_unit or 1.0,
        "m" if kind == LINEAR or per_unit else "rad",
        _positive(stage, "encoder_step", place),
        _positive(stage, "force_constant", place),
        _positive(drive, "amplifier_A_per_V", place),
    )


def read_values(path: Path) -> dict[str, Any]:
    """A YAML file that is a block of plain values, such as JSON can hold; a date becomes its text.

    Raises RecordingError or ConfigError with the place and the reason.
    """
    node = compose(path)
    try:
        found = json.loads(json.dumps(yaml.SafeLoader("").construct_document(node), default=str))
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        raise RecordingError(f"{path} holds something else than plain values: {error}") from error
    if not isinstance(found, dict):
        raise RecordingError(f"{path} must be a block of `key: value` lines")
    return found


def _block(nominal: dict[str, Any], name: str, place: Path) -> dict[str, Any]:
    found = nominal.get(name) or {}
    if not isinstance(found, dict):
        raise RecordingError(f"{name} = {found!r}; must be a block of values ({place})")
    return found


def _positive(block: dict[str, Any], key: str, place: Path) -> float:
    """The number at `key`; 0 where it is absent or null."""
    value = block.get(key)
    if value is None:
        return 0.0
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not 0.0 < number < math.inf:
        raise RecordingError(f"{key} = {value!r}; must be a number in (0, inf) ({place})")
    return number


def nominal_of(recording: Recording) -> dict[str, Any]:
    """All that a recording knows of its stage and controller, in the words of nominal.yaml."""
    meta = recording.meta
    if "nominal" in meta:  # it came from such a file
        found: dict[str, Any] = meta["nominal"]
        return found
    if "law" not in meta:
        return {"stage": {"name": meta["name"], **_axis(meta["axis"])}}
    file = carried_stage(recording)
    return {
        "stage": _stage(file, meta["axis"]),
        "friction": _friction(file),
        "drive": _drive(file),
        "controller": _controller(file, meta),
    }


def carried_stage(recording: Recording) -> StageFile:
    """The stage file whose text a recording of ours carries."""
    axis = recording.meta["axis"]
    lead = 2.0 * math.pi * axis["travel_per_unit"] if axis["kind"] == ROTARY and axis["travel_unit"] == "m" else 0.0
    name, text = (recording.meta["files"]["stage"][part] for part in ("name", "text"))
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    if root is None:
        raise RecordingError(f"{recording.path} carries an empty stage file {name}")
    reader = Reader(Path(name), Lengths(axis["kind"], lead))
    file: StageFile = reader.value(StageFile, root, "")
    reader.finish()
    return file


def _axis(axis: dict[str, Any]) -> dict[str, Any]:
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
    mechanics = file.mechanics
    return {
        "name": file.name,
        **_axis(axis),
        "force_constant": file.motor.force_constant,
        "inertia": mechanics.inertia,
        "viscous": mechanics.viscous,
        "bias": mechanics.bias,
        "pitch": 2.0 * math.pi if file.axis.lead else None,
        "encoder_periods_per_pitch": None,
        "accuracy": _ACCURACY,
    }


def _friction(file: StageFile) -> dict[str, Any]:
    if isinstance(file.friction, Dahl | Lugre):
        name = "dahl" if isinstance(file.friction, Dahl) else "lugre"
        return {"law": name, **_plain(file.friction.bristle())}
    operators = file.friction.operators()
    weight = [float(value) for value in operators.weight]
    return {
        "law": "stop-operator",
        "weight": weight,
        "slip": [float(value) for value in operators.slip],
        "coulomb": math.fsum(weight),
        **({"stribeck": file.friction.stribeck._asdict()} if file.friction.stribeck.rise else {}),
    }


def _plain(bristle: friction_bristle.Bristle) -> dict[str, Any]:
    return {**bristle._asdict(), "stribeck": bristle.stribeck._asdict()}


def _drive(file: StageFile) -> dict[str, Any]:
    return {
        "current_loop_s": file.drive.current_lag,
        "delay_samples": file.drive.delay_samples,
        "resistance_ohm": None,
        "back_emf_V_per_unit_s": None,
        "current_limit_A": file.drive.current_limit,
        "voltage_limit_V": None,
    }


def _controller(file: StageFile, meta: dict[str, Any]) -> dict[str, Any]:
    return {
        "Ts": meta["dt"],
        **(_cascade(meta) if meta["law"]["cascaded"] else _pid(file, meta)),
        **_anticipation(file, meta),
        **_observer(meta),
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
    """What the command holds beside the feedback."""
    ahead, dt = meta["feedforward"], meta["dt"]
    advance = file.drive.current_lag + meta["nd"] * dt
    form = meta["compensation"]["form"]
    friction = ahead["friction"] if ahead["with_friction"] and form == "model" else {"weight": (), "slip": ()}
    return {
        "model_inertia": file.mechanics.inertia,
        "model_viscous": file.mechanics.viscous,
        "model_force_constant": ahead["force_constant"],
        "feedforward": "perfect tracking" if ahead["with_ptc"] else "none: y0 is the reference",
        **({"friction_compensation": meta["compensation"]} if form != "model" and ahead["with_friction"] else {}),
        "friction_weight": list(friction["weight"]),
        "friction_slip": list(friction["slip"]),
        "feedforward_advance_s": advance,
        "friction_advance_s": advance + 0.5 * dt,
        "measurement_delay_samples": meta["nm"],
        "frame_samples": 2,
        "reference_interpolation": _REFERENCE,
    }
