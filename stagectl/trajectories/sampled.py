"""A trajectory row by row: for a controller of one's own, which takes samples and no files of ours."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stagectl.trajectories.experiments import Experiment, Released, phases
from stagectl.trajectories.motion import Array, TrajectoryError


class Samples(NamedTuple):
    """One value a row, all (n,)."""

    time: Array  # s
    position: Array  # m of travel (rad where it is an angle), relative to the axis' position at the start
    current: Array  # A, to be added to the command


def sampled(experiment: Experiment, dt: float, settle: float) -> Samples:
    """Rows every `dt` (s), an even number of them, with `settle` (s) of standstill at the end.

    Raises TrajectoryError where the axis is let go: rows of a reference cannot say so.
    """
    if isinstance(experiment, Released):
        raise TrajectoryError("a release switches the current off, which rows of a reference cannot express: use `run`")
    parts = phases(experiment)
    t: Array = dt * np.arange(2 * math.ceil((parts.duration + settle) / (2.0 * dt)), dtype=np.float64)
    current = np.zeros(len(t)) if parts.current is None else np.asarray(parts.current.at(t - parts.start))
    return Samples(t, parts.motion.at(t).position, current)
