"""Checks of a trajectory before anything moves: whether it can be run, how far it goes and how fast."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from stagectl.problem import Problem, ProblemKind, below
from stagectl.trajectories import bounds
from stagectl.trajectories.motion import TrajectoryError
from stagectl.trajectories.periodic import FLAT, Multisine
from stagectl.trajectories.profiles import SCurve, Trapezoid
from stagectl.trajectories.recorded import Recorded
from stagectl.trajectories.sequence import Sequence, Sum, Trajectory
from stagectl.units import quantities_of


class Peaks(NamedTuple):
    """Extreme values over a whole trajectory."""

    lowest: float  # m, from where the axis stood
    highest: float  # m
    speed: float  # m/s, largest magnitude
    acceleration: float  # m/s^2, largest magnitude


def peaks(trajectory: Trajectory, dt: float) -> Peaks:
    """Extremes of `trajectory`, sampled at a quarter of the control period `dt` (s) and at both ends."""
    motions = (trajectory.at(t) for t in _blocks(trajectory.duration, bounds.SAMPLING * dt))
    extremes = np.array([(x.min(), x.max(), np.abs(v).max(), np.abs(a).max()) for x, v, a in motions])
    lowest, (highest, speed, acceleration) = extremes[:, 0].min(), extremes[:, 1:].max(axis=0)
    return Peaks(float(lowest), float(highest), float(speed), float(acceleration))


def _blocks(duration: float, step: float) -> Iterator[Any]:
    """All sampling times, in blocks; then the last instant in motion, and the first at rest."""
    count = math.ceil(duration / step)
    for first in range(0, count, bounds.BLOCK):
        yield step * np.arange(first, min(first + bounds.BLOCK, count))
    yield np.array([0.0, np.nextafter(duration, 0.0), duration])


def check(trajectory: Trajectory, place: str = "") -> None:
    """Refuse a trajectory that cannot be run; `place` is its key path in a file, such as ``parts[1]``.

    Raises TrajectoryError with key, value, unit, what is admissible and what to change.
    """
    check_intervals(trajectory, place)
    if isinstance(trajectory, Trapezoid | SCurve):
        _check_distance(trajectory.distance, place)
    elif isinstance(trajectory, Multisine):
        _check_band(trajectory, place)
    elif isinstance(trajectory, Recorded):
        _check_samples(trajectory, place)
    elif isinstance(trajectory, Sequence | Sum):
        _check_parts(trajectory, place)
    check_duration(trajectory.duration, place)


def check_intervals(trajectory: Any, place: str) -> None:
    """Every number of a block against the interval of its field.  Raises TrajectoryError."""
    for name, quantity in quantities_of(type(trajectory)).items():
        values = getattr(trajectory, name)
        for row, value in enumerate(np.ravel(values).tolist()):
            if not (quantity.admits(value) and math.isfinite(value)):
                key = below(place, f"{name}[{row}]" if np.ndim(values) else name)
                written = f"{value} {quantity.unit}".rstrip()
                problem = Problem("must be finite", ProblemKind.RANGE, key, written, quantity.unit, quantity.interval)
                raise TrajectoryError(problem._replace(remedy=quantity.meaning))


def check_duration(duration: float, place: str) -> None:
    """Refuse a duration (s) that would fill the memory.  Raises TrajectoryError."""
    if not duration <= bounds.LONGEST:
        value, interval = f"{duration:g} s", f"[0, {bounds.LONGEST:g}]"
        problem = Problem("", ProblemKind.RANGE, below(place, "duration"), value, "s", interval)
        raise TrajectoryError(problem._replace(remedy="run fewer periods or cycles"))


def _check_distance(distance: float, place: str) -> None:
    if abs(distance) < bounds.SHORTEST:
        reason = f"must be at least {bounds.SHORTEST:g} m either way"
        problem = Problem(reason, ProblemKind.RANGE, below(place, "distance"), f"{distance:g} m", "m")
        raise TrajectoryError(problem._replace(remedy="use a dwell to stand still"))


def _check_band(p: Multisine, place: str) -> None:
    if p.flat not in FLAT:
        raise TrajectoryError(Problem("", ProblemKind.VALUE, below(place, "flat"), p.flat, choices=FLAT))
    if p.low > p.high:
        low, value, interval = below(place, "low"), f"{p.low:g} Hz", f"(0, {p.high:g}]"
        raise TrajectoryError(Problem("", ProblemKind.CONFLICT, low, value, "Hz", interval, remedy="up to high"))
    base = Problem("", ProblemKind.CONFLICT, below(place, "base"), f"{p.base:g} s", "s")
    if p.high * p.base > bounds.MOST_PERIODS:
        reason = f"must be at most {bounds.MOST_PERIODS / p.high:g} s with high = {p.high:g} Hz"
        raise TrajectoryError(base._replace(reason=reason, remedy="shorten base, or lower high"))
    count = len(p.lines)
    if not 1 <= count <= bounds.MOST_LINES:
        reason = f"puts {count} odd lines in [{p.low:g}, {p.high:g}] Hz; must be 1 to {bounds.MOST_LINES}"
        remedy = f"lines are {2.0 / p.base:g} Hz apart, so change base, low or high"
        raise TrajectoryError(base._replace(reason=reason, remedy=remedy))


def _check_samples(p: Recorded, place: str) -> None:
    rows, others = np.size(p.time), np.size(p.position)
    if rows != others or np.ndim(p.time) != 1 or np.ndim(p.position) != 1:
        reason = f"has {others} values; must have one for each of {rows} times"
        raise TrajectoryError(Problem(reason, ProblemKind.SHAPE, below(place, "position")))
    if rows < bounds.LEAST_ROWS:
        reason = f"the motion has {rows} rows; must have at least {bounds.LEAST_ROWS}"
        raise TrajectoryError(Problem(reason, ProblemKind.SHAPE, place, remedy="give more rows"))
    steps = np.diff(p.time)
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 1
        reason = f"must be later than the row before it, {p.time[row - 1]:g} s"
        problem = Problem(reason, ProblemKind.CONFLICT, below(place, f"time[{row}]"), f"{p.time[row]:g} s", "s")
        raise TrajectoryError(problem._replace(remedy="remove repeated rows or sort the file"))
    if steps.min() < bounds.LEAST_STEP * steps.max():
        span = f"{steps.min():g} s to {steps.max():g} s"
        reason = f"has steps of {span}; the shortest must be at least {bounds.LEAST_STEP:g} of the longest"
        remedy = "resample the file, or split it at its gaps"
        raise TrajectoryError(Problem(reason, ProblemKind.CONFLICT, below(place, "time"), remedy=remedy))


def _check_parts(p: Sequence | Sum, place: str) -> None:
    if not p.parts:
        reason = "is empty; must hold at least one trajectory"
        raise TrajectoryError(Problem(reason, ProblemKind.SHAPE, below(place, "parts")))
    for number, part in enumerate(p.parts):
        check(part, below(place, f"parts[{number}]"))
