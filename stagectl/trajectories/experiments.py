"""Experiments: a motion, a current, or both, and whether the loop is closed meanwhile.

::

    a trajectory    the loop is closed, nothing is injected
    a current       the loop is open: the axis moves as the current moves it
    excited         the loop is closed and follows a motion while a current is injected into the command
    released        the loop follows a motion, then lets the axis go: no current at all
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from stagectl.problem import Problem, ProblemKind
from stagectl.trajectories.currents import CURRENTS, Current, CurrentMultisine
from stagectl.trajectories.limits import check as check_trajectory
from stagectl.trajectories.limits import check_duration, check_intervals
from stagectl.trajectories.motion import Array, TrajectoryError
from stagectl.trajectories.profiles import Dwell
from stagectl.trajectories.sequence import Entry, Trajectory
from stagectl.units import Quantity, Tagged


class Excited(NamedTuple):
    """A motion in closed loop while a current is injected into the command."""

    motion: Entry
    current: Annotated[Current, Tagged("type", CURRENTS)]
    start: Annotated[float | None, Quantity("s", "[0, 86400]", "when the current begins; absent: at once")] = None


class Released(NamedTuple):
    """A motion in closed loop; then the axis is let go, without any current, and watched."""

    motion: Entry
    at: Annotated[float | None, Quantity("s", "[0, 86400]", "when the axis is let go; absent: at the motion's end")] = (
        None
    )
    watch: Annotated[float, Quantity("s", "(0, 3600]", "how long it is watched afterwards")] = 0.5


Experiment = Trajectory | Current | Excited | Released


class Phases(NamedTuple):
    """Any experiment in one form."""

    motion: Trajectory
    current: Current | None
    start: float  # s, of the current
    opens: float  # s, from when on the loop is open; infinity where it stays closed
    duration: float  # s
    steady: tuple[float, float]  # s, what is to be evaluated


def phases(experiment: Experiment) -> Phases:
    """What `experiment` is made of."""
    if isinstance(experiment, Current):
        duration = experiment.duration
        return Phases(Dwell(duration), experiment, 0.0, 0.0, duration, steady_of(experiment))
    if isinstance(experiment, Excited):
        start, current = experiment.start or 0.0, experiment.current
        duration = max(experiment.motion.duration, start + current.duration)
        begin, end = steady_of(current)
        return Phases(experiment.motion, current, start, math.inf, duration, (start + begin, start + end))
    if isinstance(experiment, Released):
        at = experiment.motion.duration if experiment.at is None else experiment.at
        return Phases(experiment.motion, None, 0.0, at, at + experiment.watch, (0.0, at))
    return Phases(experiment, None, 0.0, math.inf, experiment.duration, steady_of(experiment))


def steady_of(part: Trajectory | Current) -> tuple[float, float]:
    """Where a tracking error is taken (s): the periods at full amplitude, the recorded part, else all of it."""
    steady: tuple[float, float] = getattr(part, "steady", (0.0, part.duration))
    return steady


def check(experiment: Experiment) -> None:
    """Refuse an experiment that cannot be run.

    Raises TrajectoryError with key, value, unit, what is admissible and what to change.
    """
    if isinstance(experiment, Current):
        _check_current(experiment, "")
    elif isinstance(experiment, Excited):
        check_trajectory(experiment.motion, "motion")
        _check_current(experiment.current, "current")
    elif isinstance(experiment, Released):
        check_trajectory(experiment.motion, "motion")
        _check_release(experiment)
    else:
        check_trajectory(experiment)


def _check_release(experiment: Released) -> None:
    at, end = experiment.at, experiment.motion.duration
    if at is not None and at > end:
        reason = "the axis is released within the motion"
        raise TrajectoryError(Problem(reason, ProblemKind.CONFLICT, "at", f"{at:g} s", "s", f"[0, {end:g}]"))


def _check_current(current: Current, place: str) -> None:
    check_intervals(current, place)
    if isinstance(current, CurrentMultisine):
        check_trajectory(current.shape, place)
    check_duration(current.duration, place)


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
