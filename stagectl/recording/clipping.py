"""A current that is cut off at a limit, recognised by the corner with which it reaches it."""

import math

import numpy as np
from numpy.typing import NDArray

from stagectl.recording import constants
from stagectl.recording.columns import Array
from stagectl.recording.true_rows import stretches


def clipped(current: Array) -> NDArray[np.intp]:
    """Rows in which `current` (n,) is cut off at its largest or smallest value: repeated there, reached with a corner.

    The flat top of a rounded sine, or of friction that saturates, is reached without one.
    """
    largest = float(np.abs(current).max())
    ends = (float(current.max()), float(current.min()))
    sides = [end for end in ends if abs(end) >= constants.CLIPPED_SIDE * largest]
    top = np.any([np.abs(current - end) <= 1e-6 * largest for end in sides], axis=0)
    runs = [(a, b) for a, b in stretches(top) if b - a >= constants.CLIPPED_RUN]
    rows = np.concatenate([np.arange(a, b) for a, b in runs]) if runs else np.zeros(0, dtype=np.intp)
    if len(rows) < constants.CLIPPED_SHARE * len(current):
        return np.zeros(0, dtype=np.intp)
    gaps = zip([0, *(b for _, b in runs)], (a for a, _ in runs), strict=False)
    apart = [(end, a) for end, a in gaps if end == 0 or a - end > 4 * constants.CLIPPED_RUN]  # noise breaks runs
    corners = [corner for end, a in apart if not math.isnan(corner := _corner(current[end:a], current[a]))]
    return rows if corners and float(np.median(corners)) >= constants.CLIPPED_CORNER else np.zeros(0, dtype=np.intp)


def _corner(before: Array, top: float) -> float:
    """How straight the rise of `before` (n,) to the value `top` ends, see `CLIPPED_CORNER`; NaN for a jump."""
    signed, largest, count = before * math.copysign(1.0, top), abs(top), len(before)
    low = np.flatnonzero(signed < 0.5 * largest)
    tenth = (count - int(low[-1])) // 10 if len(low) else 0
    if tenth < 2:
        return math.nan
    width = max(1, tenth // 2)
    late, early = (
        float(np.mean(signed[max(count - n * tenth - width, 0) : count - n * tenth + width])) for n in (1, 2)
    )
    rise = largest - early
    return (largest - late) / rise if rise > constants.CLIPPED_RISE * largest else 0.0  # it has been there for long
