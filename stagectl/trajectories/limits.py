"""What must be known of a trajectory before anything moves: is it sound, how far and how fast does it go."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from stagectl.trajectories.motion import TrajectoryError
from stagectl.trajectories.periodic import Multisine
from stagectl.trajectories.profiles import SCurve, Trapezoid
from stagectl.trajectories.recorded import LEAST_ROWS, LEAST_STEP, Recorded
from stagectl.trajectories.sequence import TYPES, Sequence, Sum, Trajectory
from stagectl.units import quantity_of

SHORTEST = 1e-12  # m, of a move
LONGEST = 86400.0  # s; what is longer is a slip of a unit, and would fill the memory
MOST_LINES = 5000  # of a multisine
MOST_PERIODS = 2e5  # of its fastest line within its base: what one evaluation holds in memory
_BLOCK = 65536  # samples evaluated at once


class Peaks(NamedTuple):
    """Extreme values over a whole trajectory."""

    lowest: float  # m, from where the axis stood
    highest: float  # m
    speed: float  # m/s, largest magnitude
    acceleration: float  # m/s^2, largest magnitude


def peaks(trajectory: Trajectory, dt: float) -> Peaks:
    """Extremes of `trajectory`, sampled at a quarter of the control period `dt` (s) and at both ends."""
    found = np.array([_extremes(trajectory, t) for t in _blocks(trajectory.duration, 0.25 * dt)])
    lowest, (highest, speed, acceleration) = found[:, 0].min(), found[:, 1:].max(axis=0)
    return Peaks(float(lowest), float(highest), float(speed), float(acceleration))


def _blocks(duration: float, step: float) -> Iterator[Any]:
    """All sampling times, in blocks; then the last instant in motion, and the first at rest."""
    count = math.ceil(duration / step)
    for first in range(0, count, _BLOCK):
        yield step * np.arange(first, min(first + _BLOCK, count))
    yield np.array([0.0, np.nextafter(duration, 0.0), duration])


def _extremes(trajectory: Trajectory, t: Any) -> tuple[float, float, float, float]:
    x, v, a = trajectory.at(t)
    return x.min(), x.max(), np.abs(v).max(), np.abs(a).max()


def check(trajectory: Trajectory, place: str = "") -> None:
    """Say what is wrong with `trajectory`, if anything; `place` names it in a file.

    Raises TrajectoryError with field, value, unit, what is admissible and what to change.
    """
    place = place or next(name for name, kind in TYPES.items() if isinstance(trajectory, kind))
    check_intervals(trajectory, place)
    if isinstance(trajectory, Trapezoid | SCurve) and abs(trajectory.distance) < SHORTEST:
        raise TrajectoryError(
            f"{place}.distance = {trajectory.distance:g} m; must be at least {SHORTEST:g} m either way: "
            "use a dwell to stand still"
        )
    if isinstance(trajectory, Multisine):
        _check_band(trajectory, place)
    if isinstance(trajectory, Recorded):
        _check_samples(trajectory, place)
    if isinstance(trajectory, Sequence | Sum):
        _check_parts(trajectory, place)
    if not trajectory.duration <= LONGEST:
        raise TrajectoryError(
            f"{place}.duration = {trajectory.duration:g} s; must lie in [0, {LONGEST:g}] s: run fewer periods or cycles"
        )


def check_intervals(trajectory: Any, place: str) -> None:
    """Every number of a block against the interval beside its field."""
    for name, hint in get_type_hints(type(trajectory), include_extras=True).items():
        quantity, value = quantity_of(hint), getattr(trajectory, name)
        if quantity is None:
            continue
        for row, one in enumerate(np.ravel(value).tolist()):
            if not (quantity.admits(one) and math.isfinite(one)):
                which = f"{name}[{row}]" if np.ndim(value) else name
                raise TrajectoryError(
                    f"{place}.{which} = {one} {quantity.unit}".rstrip()
                    + f"; must be finite and lie in {quantity.interval} {quantity.unit}".rstrip()
                    + f": {quantity.meaning}"
                )


def _check_band(p: Multisine, place: str) -> None:
    if p.flat not in ("position", "velocity", "acceleration"):
        raise TrajectoryError(f"{place}.flat = {p.flat}; must be position, velocity or acceleration")
    if p.low > p.high:
        raise TrajectoryError(f"{place}.low = {p.low:g} Hz; must lie in (0, {p.high:g}] Hz, up to high")
    if p.high * p.base > MOST_PERIODS:
        raise TrajectoryError(
            f"{place}.base = {p.base:g} s; must be at most {MOST_PERIODS / p.high:g} s with high = {p.high:g} Hz: "
            "shorten base, or lower high"
        )
    count = len(p.lines)
    if not 1 <= count <= MOST_LINES:
        raise TrajectoryError(
            f"{place}.base = {p.base:g} s; puts {count} odd lines in [{p.low:g}, {p.high:g}] Hz; must be "
            f"1 to {MOST_LINES}, and lines are {2.0 / p.base:g} Hz apart, so change base, low or high"
        )


def _check_samples(p: Recorded, place: str) -> None:
    rows, others = np.size(p.time), np.size(p.position)
    if rows != others or np.ndim(p.time) != 1 or np.ndim(p.position) != 1:
        raise TrajectoryError(f"{place}.position has {others} values; must have one for each of {rows} times")
    if rows < LEAST_ROWS:
        raise TrajectoryError(f"{place} has {rows} rows; must have at least {LEAST_ROWS}: record longer")
    steps = np.diff(p.time)
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 1
        raise TrajectoryError(
            f"{place}.time = {p.time[row]:g} s in row {row}, after {p.time[row - 1]:g} s; times must "
            "increase strictly: remove repeated rows or sort the file"
        )
    if steps.min() < LEAST_STEP * steps.max():
        raise TrajectoryError(
            f"{place}.time has steps of {steps.min():g} s to {steps.max():g} s; the shortest must be at "
            f"least {LEAST_STEP:g} of the longest: resample the file, or split it at its gaps"
        )


def _check_parts(p: Sequence | Sum, place: str) -> None:
    if not p.parts:
        raise TrajectoryError(f"{place}.parts is empty; must hold at least one trajectory")
    for number, part in enumerate(p.parts):
        check(part, f"{place}.parts[{number}]")
