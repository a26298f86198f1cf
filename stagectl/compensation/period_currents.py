"""The current of each control period that does what a current which changes within periods is to do."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.compensation.constants import FADE_TIME
from stagectl.kernels import stage

Array = NDArray[np.float64]


class Hold(NamedTuple):
    """How a drive gives a current, and what is done about it."""

    resolved: bool  # what changes within a period: see `resolved`
    taken: float  # share of a second difference of the current that the current loop takes away
    span: int  # periods, of that difference

    def commands(self, current: Array, each: int) -> Array:
        """Command (n,) A of each period that moves the axis as `current` (n `each`,) behind the current loop does.

        The mean of a period gives its velocity.  What comes early or late in it also moves the axis; the periods on
        either side give that, too, where it is `resolved`: not of a push that is over before they are.
        """
        rows = current.reshape(-1, each)
        means: Array = rows.mean(axis=1)
        if not self.resolved:
            return means
        from_middle = (np.arange(each) + 0.5) / each - 0.5
        means += np.convolve(rows @ from_middle / each, (-0.5, 0.0, 0.5), "same")
        around = np.pad(means, self.span, "edge")
        return means - self.taken * (around[2 * self.span :] - 2.0 * means + around[: -2 * self.span])


def hold(p: stage.Stage, dt: float) -> Hold:
    """That of a stage at its control period `dt` (s).

    The look-ahead by the lag T of the current loop, ``1 + T s + (T s / 2 zeta)^2``, leaves the factor
    ``1 - (1/2 - 1/(4 zeta^2)) (T s)^2`` of its inverse.  The difference spans the lag: what is faster does not pass.
    """
    drive = p.drive
    span = max(math.ceil(drive.current_lag / dt), 1)
    left = 0.5 - 0.25 / drive.current_damping**2
    return Hold(resolved(p, dt), left * (drive.current_lag / (span * dt)) ** 2, span)


def resolved(p: stage.Stage, dt: float) -> bool:
    """Whether a contact across a gap, half a swing of the drive train, lasts for two periods `dt` (s)."""
    return p.mechanics.transmission.backlash == 0.0 or 4.0 * p.mechanics.transmission.resonance * dt <= 1.0


def spread(current: Array, most: float) -> Array:
    """`current` (n + 1,) A within `most` (A): what a push lacks, as a gap that closes asks for, comes beside it.

    Half a period early and late it gives the same momentum.  What lasts longer than a push is cut.
    """
    inside = np.clip(current, -most, most)
    beside = np.convolve(current - inside, (0.5, 0.0, 0.5), "same")
    return np.clip(inside + beside, -most, most)


def fading(step: float, count: int, dt: float) -> Array:
    """`step` (A) that fades away: `count` periods of `dt` (s) of a half wave of the cosine."""
    t: Array = np.minimum(dt * np.arange(count, dtype=np.float64) / FADE_TIME, 1.0)
    faded: Array = 0.5 * step * (1.0 + np.cos(np.pi * t))
    return faded
