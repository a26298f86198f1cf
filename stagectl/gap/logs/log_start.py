"""How a log begins: at rest, or in the middle of a motion.

A model that begins at rest where the machine moves needs a long way to catch up, and the gap has a peak there that is
none of the machine's.
"""

import math
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.kernels import stage

ROWS = 9  # of the beginning, through which a parabola is fitted; chosen
# Of the parabola's misfit, and of the smallest change between two rows: a smaller move in these rows may be noise, or
# an encoder between two counts; chosen.
STANDARD_DEVIATIONS, LEAST_STEPS = 8.0, 4.0
# Of the mean velocity in these rows: an axis that had half of it in the first one was moving before; chosen.  Of an
# axis that starts from rest a parabola says 0, or a velocity of the other sign.
MOVING = 0.5

_ROW = np.arange(ROWS, dtype=np.float64)
_PARABOLA = np.vander(_ROW, 3, increasing=True)
_FIT = np.linalg.pinv(_PARABOLA)


class LogStart(NamedTuple):
    """The machine in the first row of a log."""

    position: float  # rad | m, as it is read
    clock: float  # s, of the session
    going_on: tuple[float, float] = (0.0, 0.0)  # velocity (rad/s | m/s; 0: at rest) and the current (A) that acts

    def plant(self, p: stage.Stage, dt: float) -> stage.State:
        """The model `p`, as it begins the log."""
        return stage.as_read(p, self.position, self.clock, self.going_on, dt)


def of_log(position: Array, current: Array, clock: float, dt: float, carried: float = 0.0) -> LogStart:
    """The start of a log of `position` (n,) rad | m and `current` (n,) A, at the session `clock` (s).

    An axis at rest stands under the current `carried` (A); one that moves has had that of the first row.
    """
    velocity = initial_velocity(position, dt)
    return LogStart(float(position[0]), clock, (velocity, float(current[0]) if velocity else carried))


def initial_velocity(position: Array, dt: float) -> float:
    """Velocity (rad/s | m/s) in the first row of `position` (n,); 0 where the axis starts from rest."""
    if len(position) < ROWS:
        return 0.0
    way = position[:ROWS] - position[0]
    fit = _FIT @ way
    moved, misfit = float(way[-1]), float(np.std(way - _PARABOLA @ fit))
    steps = np.abs(np.diff(way))
    least = max(STANDARD_DEVIATIONS * misfit, LEAST_STEPS * float(steps[steps > 0.0].min(initial=math.inf)))
    mean = moved / (ROWS - 1)
    moving = abs(moved) > least and mean * fit[1] > MOVING * mean * mean
    return float(fit[1]) / dt if moving else 0.0
