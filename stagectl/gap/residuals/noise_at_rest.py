"""A standing axis, without the noise of its sensors.

A model that follows every step of a resting encoder, or feels the noise of a current sensor as a force, is shaken, and
shaking works its friction: a bristle gives up load at each turn, where on the machine nothing moved.  It then begins
the next motion in a state that the machine never had.
"""

from collections.abc import Sequence

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import thresholds

Spans = Sequence[tuple[int, int]]  # [begin, end) rows in which the axis stands


def quiet(signal: Array, still: Spans, dt: float) -> Array:
    """`signal` (n,) with its course in each of `still` freed of what is no larger than its noise there."""
    signal = signal.copy()
    most = max(round(thresholds.NOISE_WINDOW / dt), 1)
    for begin, end in still:
        signal[begin:end] = _quiet(signal[begin:end], most)
    return signal


def _quiet(part: Array, most: int) -> Array:
    """The moving mean, and what departs from it by more than the noise."""
    course = _moving_mean(part, most)
    apart = part - course
    noise = thresholds.NOISE_WIDTHS * float(np.median(np.abs(apart)))
    ringing: Array = np.where(np.abs(apart) > noise, apart - noise**2 / np.where(apart, apart, 1.0), 0.0)
    return course + ringing


def _moving_mean(part: Array, most: int) -> Array:
    """Mean (n,) over as many samples to either side as there are up to the nearer end, at most `most`."""
    row = np.arange(len(part))
    half = np.minimum(np.minimum(row, row[::-1]), most)
    summed = np.concatenate([[0.0], np.cumsum(part - part[0])])
    mean: Array = part[0] + (summed[row + half + 1] - summed[row - half]) / (2 * half + 1)
    return mean
