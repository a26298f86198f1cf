"""One record of a motion as an identification reads it, and the error that refuses it."""

import enum
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from stagectl.identification import thresholds
from stagectl.identification.result import Note, Progress, Topic
from stagectl.units import LINEAR, ROTARY, StageError

Array = NDArray[np.float64]
Treated = TypeVar("Treated")


class Refusal(enum.StrEnum):
    """Why a record or a request is refused."""

    AT_REST = "at rest"  # the axis did not move, or not far enough
    CONSTANT_CURRENT = "constant current"
    FRICTION_UNSETTLED = "friction unsettled"  # it still changes where it must be constant
    GIVEN_TWICE = "given twice"  # a log counts once: its copy holds nothing new
    HELD_OUT = "held out"
    ILL_CONDITIONED = "ill-conditioned"  # the motion does not separate the parameters
    IMPLAUSIBLE = "implausible"  # units, signs or a current that cannot be right
    MISSING_COLUMN = "missing column"
    NOISE = "noise"  # more noise than acceleration
    NO_CAPTURE = "no capture"
    NO_EXCITATION = "no excitation"
    NO_REVERSAL = "no reversal"
    NO_SAME_SIGN = "no same sign"  # velocity and acceleration never have the same sign
    NO_STEADY_SPEED = "no steady speed"
    NO_SWING = "no swing"
    NOT_FINITE = "not finite"
    ONE_DIRECTION = "one direction"
    OPPOSITE_SIGN = "opposite sign"  # of current and velocity
    SAMPLING = "sampling"
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
        return self.saying(f"{place}: {self}", self.capture or str(place))

    def saying(self, message: str, capture: str) -> Self:
        """The same refusal in other words."""
        return type(self)(
            message, self.reason, capture=capture, value=self.value, unit=self.unit, admissible=self.admissible
        )


class Capture(NamedTuple):
    """Columns (n,) of one record: finite, without gaps, equally spaced, of `CAPTURE_LEAST_ROWS` rows or more."""

    name: str
    time: Array  # s, from 0
    position: Array  # rad | m, measured
    current: Array  # A, from the column that `current_column` names
    dt: float  # s, sampling time
    current_column: str = "measured_current"  # or current, command
    excitation: Array | None = None  # A, injected into the command: the instrument of a frequency response
    reference: Array | None = None  # rad | m
    encoder_step: float = 0.0  # rad | m, 0: not known
    meta: Mapping[str, Any] = MappingProxyType({})  # of the recording
    notes: tuple[str, ...] = ()  # what is doubtful about it, for the user
    unevenness: float = 0.0  # s, rms of how far its time stamps were from equally spaced ones


def each(
    captures: Sequence[Capture], treat: Callable[[Capture], Treated], progress: Progress, further: int = 0
) -> Iterator[Treated]:
    """What `treat` makes of each capture; its errors name the capture.  `further` steps follow in the progress."""
    for number, capture in enumerate(captures, 1):
        try:
            yield treat(capture)
        except IdentificationError as error:
            raise error.within(capture.name) from error
        progress(number, len(captures) + further)


def accepted(captures: Iterable[Capture], treat: Callable[[Capture], Treated]) -> tuple[list[Treated], list[Note]]:
    """What `treat` makes of each capture, and notes on those that it refuses.

    Raises IdentificationError where it refuses all of them.
    """
    results: list[Treated] = []
    refused: list[IdentificationError] = []
    for capture in captures:
        try:
            results.append(treat(capture))
        except IdentificationError as error:
            refused.append(error.within(capture.name))
    if not results and not refused:
        raise IdentificationError("no capture to identify from; give at least one", Refusal.NO_CAPTURE)
    if not results:
        raise refused[0].saying("\n".join(map(str, refused)), refused[0].capture)
    return results, [Note(Topic.LEFT_OUT, f"left out: {error}") for error in refused]


def check_excited(capture: Capture) -> None:
    """Check that position and current are not constant.

    Raises IdentificationError where they are not.
    """
    unit = {ROTARY: "rad", LINEAR: "m"}.get(capture.meta.get("axis", {}).get("kind"), "rad | m")
    if not np.ptp(capture.current) > thresholds.LEAST_EXCITATION:
        text = (
            f"the {capture.current_column} is {capture.current[0]:g} A throughout. Without an "
            "excitation there is no response: command a current_sine or current_multisine, or inject a current"
        )
        raise IdentificationError(text, Refusal.CONSTANT_CURRENT, value=float(capture.current[0]), unit="A")
    travel, least = float(np.ptp(capture.position)), thresholds.LEAST_ENCODER_STEPS * capture.encoder_step
    if not travel > least:
        text = (
            f"the position moves by {travel:g} {unit} in all; must be more than "
            f"{thresholds.LEAST_ENCODER_STEPS:g} encoder steps of {capture.encoder_step:g} {unit}: raise the "
            "amplitude, or check that the drive was enabled"
        )
        raise IdentificationError(text, Refusal.AT_REST, value=travel, unit=unit, admissible=f"({least:g}, inf)")
