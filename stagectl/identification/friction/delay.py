"""The delay between current and position that all members of the family share.

``Kt i(t - tau) = J a(t) + ...``: it is found once, by `simultaneous`, whose friction is none of the family's, and taken
where its interval leaves zero out and a member with it leaves less of the force.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import standard_errors
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.result import Parameter
from stagectl.identification.simultaneous import method as simultaneous

STEP = 1e-4  # s, of what a note tells


class Delay(NamedTuple):
    """What is taken, and why."""

    value: float = 0.0  # s, by which the force follows the capture's current column
    deviation: float = 0.0  # s, that the parameters' intervals have in them
    known: Parameter | None = None
    words: str = "taken as given"


def estimated(captures: list[Capture], file: StageFile, left: Callable[[float], float]) -> Delay:
    """The delay of all `captures`; `left` is the force (N m | N) that a member leaves at a delay (s)."""
    try:
        told = simultaneous.identify(captures, file).parameters["delay"]
    except IdentificationError as error:
        return Delay(words=f"taken as zero, as `simultaneous` does not find it ({error})")
    half = 0.5 * (told.high - told.low)
    said = f"{1e3 * told.value:.3g} ± {1e3 * half:.2g} ms by `simultaneous`"
    if told.low <= 0.0 <= told.high:
        about = math.hypot(told.value, half / standard_errors.SURE)  # of zero, which is what is taken
        return Delay(0.0, about, told._replace(value=0.0), f"taken as zero, which {said} does not leave out")
    if not left(told.value) < left(0.0):
        return Delay(words=f"taken as zero: {said} would leave more of the force")
    return Delay(told.value, half / standard_errors.SURE, told, f"{said}, taken for every model")


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
        raise IdentificationError(
            f"{capture.name}: delay = {1e3 * delay:.4g} ms; must be shorter than the record, "
            f"{capture.dt * len(capture.time):.4g} s, either way"
        )
    kept = slice(lost, None) if delay > 0.0 else slice(0, rows)
    current = np.asarray(CubicSpline(capture.time, capture.current)(capture.time[kept] - delay), dtype=np.float64)
    return capture._replace(
        time=capture.time[:rows],
        position=capture.position[kept],
        current=current,
        excitation=None if capture.excitation is None else capture.excitation[kept],
        reference=None if capture.reference is None else capture.reference[kept],
    )


def note(taken: Delay, names: list[str], values: Array, per_second: Array) -> str:
    """In words, with what 0.1 ms would change of the parameters `names`, by their changes (k,) a second of delay."""
    changes = ", ".join(
        f"{name} by {100.0 * STEP * abs(slope / value):.2g} %"
        for name, value, slope in zip(names, values.tolist(), per_second.tolist(), strict=False)
        if value
    )
    said = f"delay: {taken.words}; 0.1 ms more or less would change {changes}"
    if taken.deviation:
        return f"{said}: the intervals hold what is not known of it"
    advice = "" if taken.known is not None else ": --delay gives one that is known"
    return f"{said}, which the intervals do not hold{advice}"
