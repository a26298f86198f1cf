r"""Tracking error at reversals, with the sign that a machinist gives it.

::

    error = way (measured - reference), way = +1 or -1: the direction of the motion after the reversal

    negative    the axis lags behind: it sticks where it turned, material is left standing
    positive    the axis leads: it has turned back too early, the work piece is excessively cut

At a turn from positive to negative velocity that is reference minus measured: the paper's Pe1 to Pe3 (friction
paper of the linear slider, Fig. 10).
"""

import math
from typing import NamedTuple

import numpy as np

from stagectl.compensation.legs import Array, legs


class ReversalError(NamedTuple):
    """One reversal."""

    time: float  # s, of the reference's zero crossing, or of its start after a dwell
    way: float  # +1 or -1
    negative: float  # rad | m, <= 0, the largest lag
    positive: float  # rad | m, >= 0, the largest lead


def reversal_errors(
    position: Array, velocity: Array, measured: Array, dt: float, within: float = math.inf
) -> list[ReversalError]:
    """Each reversal of a reference `position`, `velocity` (n,), from the middle of one leg to that of the next.

    No more of it than `within` (s) either side of the reversal.
    """
    cut = legs(position, velocity, dt)
    middles = 0.5 * (cut.start + np.minimum(cut.end, dt * len(position)))
    time = dt * np.arange(len(position))
    errors = []
    for leg in cut.reversals().tolist():
        first, last = max(middles[leg - 1], cut.start[leg] - within), min(middles[leg], cut.start[leg] + within)
        inside = (time >= first) & (time < last)
        error = cut.way[leg] * (measured[inside] - position[inside])
        negative, positive = float(np.min(error, initial=0.0)), float(np.max(error, initial=0.0))
        errors.append(ReversalError(float(cut.start[leg]), float(cut.way[leg]), negative, positive))
    return errors
