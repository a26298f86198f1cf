"""A motion that also brings an axis to where its reference is."""

from typing import NamedTuple

import numpy as np

from stagectl.trajectories.motion import Array, Motion, window
from stagectl.trajectories.sequence import Trajectory

APPROACH_TIME = 0.25  # s; chosen: 10 um within it ask for no more than 1 mm/s^2


class Approach(NamedTuple):
    """A motion of an axis that begins `off` (m | rad of travel) its reference, and ends on it."""

    motion: Trajectory
    off: float

    @property
    def duration(self) -> float:
        """That of the motion (s)."""
        return self.motion.duration

    def at(self, t: Array) -> Motion:
        """The way from where it begins."""
        way = self.motion.at(t)
        gone = window(np.clip(t, 0.0, APPROACH_TIME), APPROACH_TIME, 3.0 * APPROACH_TIME)  # its rise alone
        return Motion(*(x - self.off * share for x, share in zip(way, gone, strict=True)))
