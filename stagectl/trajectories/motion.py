"""What every trajectory is made of: motion itself, ends at rest, and the window that fades in and out."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stagectl.units import StageError

Array = npt.NDArray[np.float64]


class TrajectoryError(StageError):
    """A trajectory that cannot be run: field, value, unit, what is admissible, and what to change."""


class Motion(NamedTuple):
    """Position and its exact derivatives, in the unit of travel, relative to where the axis stood."""

    position: Array  # (n,) m
    velocity: Array  # (n,) m/s
    acceleration: Array  # (n,) m/s^2


def contained(inside: Callable[[Array], Motion], t: npt.ArrayLike, duration: float, end: float) -> Motion:
    """`inside` over ``0 <= t < duration``; standing at 0 before, and at `end` (m) from `duration` (s) on."""
    t = np.asarray(t, dtype=np.float64)  # a time given as an int must not make positions of ints
    during = (t >= 0.0) & (t < duration)
    motion = Motion(np.where(t < 0.0, 0.0, end), np.zeros(t.shape), np.zeros(t.shape))
    for whole, part in zip(motion, inside(t[during]), strict=True):
        whole[during] = part
    return motion


def window(t: Array, ramp: float, duration: float) -> Motion:
    r"""Factor that rises from 0 to 1 in the first `ramp` (s) and falls in the last, with its derivatives.

    ::

        1       ________            w(s) = 10 s^3 - 15 s^4 + 6 s^5: at both ends of a ramp velocity and
        |      /        \          acceleration of the factor are zero, so whatever it multiplies starts
        0 ____/          \____     and ends at rest.
    """
    s = np.clip(np.minimum(t, duration - t) / ramp, 0.0, 1.0)
    towards = np.where(t < 0.5 * duration, 1.0, -1.0) / ramp
    rest = s * (1.0 - s)
    return Motion(
        s * s * s * (10.0 - s * (15.0 - 6.0 * s)),
        30.0 * rest * rest * towards,
        60.0 * rest * (1.0 - 2.0 * s) / (ramp * ramp),
    )


def product(a: Motion, b: Motion) -> Motion:
    """``a b`` and its derivatives by the product rule."""
    return Motion(
        a.position * b.position,
        a.velocity * b.position + a.position * b.velocity,
        a.acceleration * b.position + 2.0 * a.velocity * b.velocity + a.position * b.acceleration,
    )
