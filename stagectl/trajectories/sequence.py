"""Trajectories one after another or at once, and the names by which files call them."""

from __future__ import annotations

from itertools import accumulate
from typing import Annotated, NamedTuple

import numpy as np
import numpy.typing as npt

from stagectl.trajectories.motion import Array, Motion, contained
from stagectl.trajectories.periodic import Multisine, Sine
from stagectl.trajectories.profiles import Dwell, SCurve, Trapezoid
from stagectl.trajectories.recorded import Csv, Recorded
from stagectl.units import Tagged


class Sequence(NamedTuple):
    """Trajectories one after another: each begins when and where the last one ended."""

    parts: Annotated[tuple[Entry, ...], "list of trajectories, each a block with its type"]

    @property
    def duration(self) -> float:
        """All parts (s)."""
        return float(sum(part.duration for part in self.parts))

    @property
    def end(self) -> float:
        """Where the last part ends (m)."""
        return float(sum(part.end for part in self.parts))

    def at(self, t: npt.ArrayLike) -> Motion:
        """Motion at the times `t` (n,) s."""
        return contained(self._inside, t, self.duration, self.end)

    def _inside(self, t: Array) -> Motion:
        starts = list(accumulate((part.duration for part in self.parts), initial=0.0))
        ends = list(accumulate((part.end for part in self.parts), initial=0.0))
        # Each instant belongs to one part only: two that both claimed a border would add their accelerations.
        owner = np.searchsorted(starts, t, side="right") - 1
        motion = Motion(*np.zeros((3, *t.shape)))
        for k, part in enumerate(self.parts):
            mine = owner == k
            x, v, a = part.at(t[mine] - starts[k])
            motion.position[mine], motion.velocity[mine], motion.acceleration[mine] = ends[k] + x, v, a
        return motion


class Sum(NamedTuple):
    """Trajectories at once, such as a sine on a constant speed, their motions added; one that is over stays there."""

    parts: Annotated[tuple[Entry, ...], "list of trajectories, each a block with its type"]

    @property
    def duration(self) -> float:
        """Of the longest part (s)."""
        return max((part.duration for part in self.parts), default=0.0)

    @property
    def end(self) -> float:
        """Sum of the parts' ends (m)."""
        return float(sum(part.end for part in self.parts))

    def at(self, t: npt.ArrayLike) -> Motion:
        """Motion at the times `t` (n,) s."""
        return contained(self._inside, t, self.duration, self.end)

    def _inside(self, t: Array) -> Motion:
        motions = [part.at(t) for part in self.parts]
        return Motion(*(np.sum(columns, axis=0) for columns in zip(*motions, strict=True)))


Trajectory = Sine | Trapezoid | SCurve | Dwell | Multisine | Recorded | Sequence | Sum

TYPES: dict[str, type[Trajectory | Csv]] = {
    "sine": Sine,
    "trapezoid": Trapezoid,
    "s_curve": SCurve,
    "dwell": Dwell,
    "multisine": Multisine,
    "csv": Csv,
    "sequence": Sequence,
    "sum": Sum,
}
Entry = Annotated[Trajectory, Tagged("type", TYPES)]  # of a file, in which a recorded motion is a `Csv`
