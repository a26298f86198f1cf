"""Scales of a log's columns, from a stage file or a ``nominal.yaml`` next to it.

What is not known is 0, never guessed.
"""

from __future__ import annotations

import contextlib
import json
import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from stagectl.config.source import compose
from stagectl.config.stage_file import Setup
from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import RecordingError
from stagectl.units import LINEAR, ROTARY, UnitError, factor, in_base_units, unit_on

# A share of the rated current, as CiA 402 has it in 0x6077 and traces of many drives have it in a header.
SHARES = {
    **dict.fromkeys(("permille", "per mille", "‰", "0.1%", "0.1 %"), 1e-3),
    **dict.fromkeys(("percent", "per cent", "%"), 1e-2),
}
_TORQUE = re.compile(r"(?<=N)[ .*·]?(?=c?m$)")  # N m, N.m, N*m, Nm, N cm
_RATED = (
    "it is a share of the rated current; write that as drive.wire.rated_current in the stage file, as "
    "stage.rated_current (A) in nominal.yaml next to the log, or as rated_current=... in --model; or write the column "
    "in A"
)
_OPTIONS = {"stage.encoder_step": "--counts N", "stage.force_constant": "--force-constant K"}  # of `stagectl import`
_EFFORTS = ("N", "kN", "N m", "mN m", "kN m", "N cm")


def is_unit(text: str) -> bool:
    """Whether a text in a header is a unit that a log may have."""
    return text in SHARES or bool(bases_of(text))


def bases_of(unit: str) -> dict[str, int]:
    """Exponents of the SI base units in a unit as a log writes it; empty where it is none that measures something."""
    with contextlib.suppress(UnitError):
        return in_base_units(_TORQUE.sub(" ", unit))[1]
    return {}


class Scales(NamedTuple):
    """How a log's units become those of the axis; 0 where a scale is not known."""

    kind: str  # rotary or linear
    travel_per_unit: float = 1.0  # m per rad (a screw), else 1
    travel_unit: str = "m"
    encoder_step: float = 0.0  # rad | m a count
    force_constant: float = 0.0  # N m/A | N/A
    amplifier: float = 0.0  # A/V, of the drive's analogue input
    rated_current: float = 0.0  # A

    def units(self, quantity: str) -> tuple[str, ...]:
        """Units that a log may have its position, reference or velocity in, the likeliest first."""
        lengths, through_screw = ("mm", "m", "um", "nm"), self.kind == ROTARY and self.travel_unit == "m"
        if quantity == "velocity":
            return ("mm/s", "m/s") if self.kind == LINEAR else ("rad/s", "deg/s", "rpm")
        angles = () if self.kind == LINEAR else ("rad", "deg", "rev")
        known = (*(lengths if self.kind == LINEAR or through_screw else ()), *angles)
        return (*known, *(("counts",) if self.encoder_step else ()))

    def position(self, unit: str) -> float:
        """Factor from a position in `unit` to rad | m.

        Raises RecordingError where the axis or a missing scale forbids it.
        """
        inside = unit_on(self.kind, "rad | m")
        if unit == "counts":
            return self._known(self.encoder_step, "counts", "stage.encoder_step")
        try:
            if self.kind == ROTARY and self.travel_unit == "m":  # through the screw
                with contextlib.suppress(UnitError):
                    return factor(unit, "m") / self.travel_per_unit
            return factor(unit, inside)
        except UnitError as error:
            known = ", ".join(self.units("position"))
            reason = f"a position in {unit} on a {self.kind} axis: {error}; must be one of {known}"
            raise RecordingError(reason, kind=ProblemKind.UNIT) from error

    def speed(self, unit: str) -> float:
        """Factor from a velocity in `unit`, such as ``mm/s`` or ``rpm``, to rad/s | m/s."""
        inside = unit_on(self.kind, "rad/s | m/s")
        if unit.startswith("counts"):
            return self.position("counts")
        return factor(unit or inside, inside)

    def current(self, unit: str) -> float:
        """Factor from a current, force, torque, amplifier voltage or share of the rated current in `unit` to A.

        Raises RecordingError where a scale is missing.
        """
        if unit in SHARES:
            return SHARES[unit] * self._known(self.rated_current, f"a current in {unit}", "stage.rated_current", _RATED)
        if unit in ("V", "mV"):
            return factor(unit, "V") * self._known(self.amplifier, "a voltage", "drive.amplifier_A_per_V")
        if (spaced := _TORQUE.sub(" ", unit)) in _EFFORTS:
            constant = self._known(self.force_constant, f"an effort in {unit}", "stage.force_constant")
            return factor(spaced, unit_on(self.kind, "N m | N")) / constant
        return factor(unit, "A")

    def _known(self, value: float, what: str, key: str, where: str = "") -> float:
        if value == 0.0:
            option = f", or import it with {_OPTIONS[key]}" if key in _OPTIONS else ""
            place = where or f"write {key} in nominal.yaml next to the log, or give --stage{option}"
            raise RecordingError(f"{what} has no scale: {place}", kind=ProblemKind.MISSING, column=key)
        return value


class Known(NamedTuple):
    """What the user says about the machine of a log; 0 where nothing."""

    counts: float = 0.0  # a turn, or a metre of a linear axis
    force_constant: float = 0.0  # N m/A | N/A
    rated_current: float = 0.0  # A
    axis: Scales | None = None  # of the stage file
    travel: float = 0.0  # rad | m, of the stage file

    def on(self, scales: Scales) -> Scales:
        """The scales of a log, with those that the user says."""
        step = scales.position("m" if scales.kind == LINEAR else "rev") / self.counts if self.counts else 0.0
        return scales._replace(
            encoder_step=step or scales.encoder_step,
            force_constant=self.force_constant or scales.force_constant,
            rated_current=self.rated_current or scales.rated_current,
        )

    def of_stage(self, setup: Setup) -> Known:
        """The same with what a stage file says."""
        scales, (low, high) = scales_of_stage(setup), setup.file.limits.travel
        return self._replace(rated_current=scales.rated_current, axis=scales, travel=high - low)


NOTHING_KNOWN = Known()


def scales_of_stage(setup: Setup, amplifier: float = 0.0) -> Scales:
    """The scales that a stage file gives; it says nothing of an analogue `amplifier` (A/V)."""
    axis, p, wire = setup.file.axis, setup.stage, setup.file.drive.wire
    step, constant, rated = p.encoder.step, p.motor.force_constant, getattr(wire, "rated_current", 0.0)
    return Scales(axis.kind, axis.travel_per_unit, axis.travel_unit, step, constant, amplifier, rated)


def scales_of_nominal(nominal: dict[str, Any], place: Path) -> Scales:
    """The scales that a nominal.yaml at `place` gives.

    Raises RecordingError where the axis is not known or a scale is not a positive number.
    """
    stage, drive = _block(nominal, "stage", place), _block(nominal, "drive", place)
    unit = stage.get("position_unit") or unit_on(stage.get("kind", ""), "rad | m")
    if unit not in ("m", "rad"):
        raise RecordingError(f"stage.position_unit = {unit}; must be rad or m ({place})", place, ProblemKind.VALUE)
    kind = LINEAR if unit == "m" else ROTARY
    per_unit = 1e-3 * _positive(stage, "travel_per_unit_mm", place) if kind == ROTARY else 0.0
    return Scales(
        kind,
        per_unit or 1.0,
        "m" if kind == LINEAR or per_unit else "rad",
        _positive(stage, "encoder_step", place),
        _positive(stage, "force_constant", place),
        _positive(drive, "amplifier_A_per_V", place),
        _positive(stage, "rated_current", place),
    )


def read_values(path: Path) -> dict[str, Any]:
    """A YAML file that is a block of plain values, such as JSON can hold; a date becomes its text.

    Raises RecordingError or ConfigError with the place and the reason.
    """
    node = compose(path)
    causes = (yaml.YAMLError, ValueError, TypeError, RecursionError)
    with RecordingError.instead_of(causes, f"{path} holds something other than plain values", path, ProblemKind.VALUE):
        values = json.loads(json.dumps(yaml.SafeLoader("").construct_document(node), default=str))
    if not isinstance(values, dict):
        raise RecordingError(f"{path} must be a block of `key: value` lines", path, ProblemKind.SHAPE)
    return values


def _block(nominal: dict[str, Any], name: str, place: Path) -> dict[str, Any]:
    block = nominal.get(name) or {}
    if not isinstance(block, dict):
        reason = f"{name} = {block!r}; must be a block of values ({place})"
        raise RecordingError(reason, place, ProblemKind.SHAPE, column=name)
    return block


def number_in(value: Any) -> float:
    """The number that an entry of a YAML file is; NaN where it is none."""
    try:
        return math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        return math.nan


def _positive(block: dict[str, Any], key: str, place: Path) -> float:
    """The number at `key`; 0 where it is absent or null."""
    value = block.get(key)
    if value is None:
        return 0.0
    number = number_in(value)
    if not 0.0 < number < math.inf:
        reason = f"{key} = {value!r}; must be a number in (0, inf) ({place})"
        raise RecordingError(reason, place, ProblemKind.RANGE, column=key)
    return number
