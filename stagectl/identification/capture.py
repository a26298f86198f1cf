"""One record of a motion as an identification reads it, and the error that refuses it."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from stagectl.identification import thresholds
from stagectl.units import LINEAR, ROTARY, StageError

Array = NDArray[np.float64]


class Refusal(enum.StrEnum):
    """Why a record or a request is refused."""

    AT_REST = "at rest"  # the axis did not move, or not far enough
    CONSTANT_CURRENT = "constant current"
    FRICTION_UNSETTLED = "friction unsettled"  # it still changes where it must be constant
    HELD_OUT = "held out"
    ILL_CONDITIONED = "ill-conditioned"  # the motion does not separate the parameters
    IMPLAUSIBLE = "implausible"  # units, signs or a current that cannot be right
    MISSING_COLUMN = "missing column"
    NOISE = "noise"  # more noise than acceleration
    NO_CAPTURE = "no capture"
    NO_EXCITATION = "no excitation"
    NO_INERTIA = "no inertia"  # the estimate is not positive
    NO_REVERSAL = "no reversal"
    NO_SAME_SIGN = "no same sign"  # velocity and acceleration never have the same sign
    NO_STEADY_SPEED = "no steady speed"
    NO_SWING = "no swing"
    NOT_FINITE = "not finite"
    ONE_DIRECTION = "one direction"
    OPPOSITE_SIGN = "opposite sign"  # of current and velocity
    SAMPLING = "sampling"
    SEARCH = "search"  # it did not converge
    SHAPE = "shape"
    TIME_ORDER = "time order"
    TOO_FAST = "too fast"
    TOO_FEW_LINES = "too few lines"
    TOO_SHORT = "too short"
    UNKNOWN_OPTION = "unknown option"
    UNSTABLE = "unstable"
    WRONG_AXIS = "wrong axis"


class IdentificationError(StageError):
    """A record from which the parameters cannot be found: what is wrong with it, and what to record instead."""

    def __init__(
        self,
        message: str,
        reason: Refusal,
        *,
        capture: str = "",
        value: float | str | None = None,
        unit: str = "",
        admissible: str = "",
    ) -> None:
        super().__init__(message)
        self.reason = reason
        self.capture = capture  # name of the record; empty where no single one is meant
        self.value = value  # the number or name that is refused, in `unit`
        self.unit = unit
        self.admissible = admissible  # interval of numbers, or names

    def within(self, place: object) -> Self:
        """The same error with the place where it was found in front of the message."""
        return type(self)(
            f"{place}: {self}",
            self.reason,
            capture=self.capture or str(place),
            value=self.value,
            unit=self.unit,
            admissible=self.admissible,
        )


class Capture(NamedTuple):
    """Columns (n,) of one record without gaps, equally spaced."""

    name: str
    time: Array  # s, from 0
    position: Array  # rad | m, measured
    current: Array  # A, from the column that `current_column` names
    dt: float  # s, sampling time
    current_column: str = "measured_current"  # or current, command
    excitation: Array | None = None  # A, injected into the command: the instrument of a frequency response
    reference: Array | None = None  # rad | m
    encoder_step: float = 0.0  # rad | m, 0: not known
    steady: tuple[float, float] | None = None  # s, window of the steady part
    meta: Mapping[str, Any] = MappingProxyType({})  # of the recording
    notes: tuple[str, ...] = ()  # what is doubtful about it, for the user


def check_excited(capture: Capture) -> None:
    """Check that position and current are finite, long enough and not constant.

    Raises IdentificationError where they are not.
    """
    unit = {ROTARY: "rad", LINEAR: "m"}.get(capture.meta.get("axis", {}).get("kind"), "rad | m")
    _check_finite(capture, unit)
    rows = len(capture.time)
    if rows < thresholds.CAPTURE_LEAST_ROWS:
        raise IdentificationError(
            f"{capture.name}: {rows} rows; must have at least {thresholds.CAPTURE_LEAST_ROWS}: record longer",
            Refusal.TOO_SHORT,
            capture=capture.name,
            value=rows,
            admissible=f"[{thresholds.CAPTURE_LEAST_ROWS}, inf)",
        )
    if not np.ptp(capture.current) > thresholds.LEAST_EXCITATION:
        raise IdentificationError(
            f"{capture.name}: the {capture.current_column} is {capture.current[0]:g} A throughout. Without an "
            "excitation there is no response: command a current_sine or current_multisine, or inject a current",
            Refusal.CONSTANT_CURRENT,
            capture=capture.name,
            value=float(capture.current[0]),
            unit="A",
        )
    travel, least = float(np.ptp(capture.position)), thresholds.LEAST_ENCODER_STEPS * capture.encoder_step
    if not travel > least:
        raise IdentificationError(
            f"{capture.name}: the position moves by {travel:g} {unit} in all; must be more than "
            f"{thresholds.LEAST_ENCODER_STEPS:g} encoder steps of {capture.encoder_step:g} {unit}: raise the "
            "amplitude, or check that the drive was enabled",
            Refusal.AT_REST,
            capture=capture.name,
            value=travel,
            unit=unit,
            admissible=f"({least:g}, inf)",
        )


def _check_finite(capture: Capture, unit: str) -> None:
    for name, column, column_unit in (("position", capture.position, unit), ("current", capture.current, "A")):
        if column.shape == capture.time.shape and np.all(np.isfinite(column)):
            continue
        row = int(np.argmin(np.isfinite(column)))
        value = float(column[row]) if len(column) else float("nan")
        raise IdentificationError(
            f"{capture.name}: {name}[{row}] = {value:g} {column_unit}; {name} must be finite in all "
            f"{len(capture.time)} rows: cut the record to a part without gaps",
            Refusal.NOT_FINITE,
            capture=capture.name,
            value=value,
            unit=column_unit,
        )
