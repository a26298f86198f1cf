"""The delay between current and position that all members of the family share.

``Kt i(t - tau) = J a(t) + ...``: it is found once, by `simultaneous`, whose friction model is not of the family.  It is
used where its interval excludes zero and a member with it has a smaller residual.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal
from stagectl.identification.result import Note, Parameter, Topic
from stagectl.identification.simultaneous import method as simultaneous
from stagectl.identification.thresholds import NORMAL_95

NOTED_CHANGE = 1e-4  # s of delay, whose effect the note gives


class Delay(NamedTuple):
    """The delay that is used, and why."""

    value: float = 0.0  # s, by which the force follows the capture's current column
    deviation: float = 0.0  # s, included in the parameters' intervals
    known: Parameter | None = None
    words: str = "taken as given"


def estimated(captures: list[Capture], file: StageFile, residual: Callable[[float], float]) -> Delay:
    """The delay of all `captures`; `residual` gives the rms residual (N m | N) of a member at a delay (s)."""
    try:
        delay = simultaneous.identify(captures, file).parameters["delay"]
    except IdentificationError as error:
        return Delay(words=f"taken as zero, as `simultaneous` does not find it ({error})")
    words = f"{1e3 * delay.value:.3g} ± {1e3 * delay.half:.2g} ms by `simultaneous`"
    if delay.low <= 0.0 <= delay.high:
        about_zero = math.hypot(delay.value, delay.half / NORMAL_95)
        return Delay(0.0, about_zero, delay._replace(value=0.0), f"taken as zero, which {words} does not exclude")
    if not residual(delay.value) < residual(0.0):
        return Delay(words=f"taken as zero: with {words} the residual would be larger")
    return Delay(delay.value, delay.half / NORMAL_95, delay, f"{words}, taken for every model")


def given(delay: float) -> Delay:
    """A delay (s) that the user knows."""
    return Delay(delay, 0.0, Parameter(delay, delay, delay, "s"), f"{1e3 * delay:.3g} ms, taken as given")


def shifted(capture: Capture, delay: float) -> Capture:
    """The capture with its current `delay` (s) later, cubic between the rows; rows without a current are cut off.

    Raises IdentificationError where the record is not longer than the delay.
    """
    if delay == 0.0:
        return capture
    lost = math.ceil(abs(delay) / capture.dt - 1e-9)
    rows = len(capture.time) - lost
    if rows < 2:
        duration = capture.dt * len(capture.time)
        raise IdentificationError(
            f"{capture.name}: delay = {1e3 * delay:.4g} ms; must be shorter than the record, {duration:.4g} s, either "
            "way",
            Refusal.UNKNOWN_OPTION,
            capture=capture.name,
            value=delay,
            unit="s",
            admissible=f"({-duration:g}, {duration:g})",
        )
    rows_used = slice(lost, None) if delay > 0.0 else slice(0, rows)
    current = np.asarray(CubicSpline(capture.time, capture.current)(capture.time[rows_used] - delay), dtype=np.float64)
    return capture._replace(
        time=capture.time[:rows],
        position=capture.position[rows_used],
        current=current,
        excitation=None if capture.excitation is None else capture.excitation[rows_used],
        reference=None if capture.reference is None else capture.reference[rows_used],
    )


def note(delay: Delay, names: list[str], values: Array, per_second: Array) -> Note:
    """A note with the effect of 0.1 ms on the parameters `names`, by their changes (k,) a second of delay."""
    changes = ", ".join(
        f"{name} by {100.0 * NOTED_CHANGE * abs(slope / value):.2g} %"
        for name, value, slope in zip(names, values.tolist(), per_second.tolist(), strict=False)
        if value
    )
    text = f"delay: {delay.words}; 0.1 ms more or less would change {changes}"
    if delay.deviation:
        return Note(Topic.DELAY, f"{text}: the intervals include its uncertainty")
    advice = "" if delay.known is not None else ": --delay gives one that is known"
    return Note(Topic.DELAY, f"{text}, which the intervals do not include{advice}")
