"""A motion that was recorded: a smooth curve through every sample."""

import re
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stagectl.problem import Problem, ProblemKind
from stagectl.trajectories.motion import Array, Motion, TrajectoryError, contained
from stagectl.units import Quantity


class Recorded(NamedTuple):
    r"""Quintic spline (not-a-knot) through recorded positions, shifted so that the axis is at 0 at t = 0.

    ::

        velocity    __ run-up  ____ recorded _____  run-out
                   |          /                   \ |
               0 __|____-----´                     `----____

    Velocity and acceleration are the spline's own derivatives.  A record that begins or ends in motion begins
    or ends with a jump of the velocity, unless `run_up` and `run_out` give it time: then the velocity rises from 0
    and falls to 0 as ``3 s^2 - 2 s^3``, in front of and behind the record, which itself is not changed.  The
    acceleration jumps where they join, as a trapezoid's does: a record's own is too rough at its ends to lean on.
    """

    time: Annotated[Any, Quantity("s", "[-1e12, 1e12]", "(n,) increasing")]
    position: Annotated[Any, Quantity("m", "[-1e6, 1e6]", "(n,) at these times")]
    run_up: Annotated[float, Quantity("s", "[0, 60]", "time to reach the record's first velocity; 0: at once")] = 0.0
    run_out: Annotated[float, Quantity("s", "[0, 60]", "time to stop from the record's last velocity; 0: at once")] = (
        0.0
    )

    @property
    def duration(self) -> float:
        """From the first to the last sample, with run-up and run-out (s)."""
        return self.run_up + self._length + self.run_out

    @property
    def end(self) -> float:
        """Position afterwards (m)."""
        first, last = self._end_velocities() if self.run_up or self.run_out else (0.0, 0.0)
        return 0.5 * first * self.run_up + self._distance + 0.5 * last * self.run_out

    @property
    def steady(self) -> tuple[float, float]:
        """The recorded part (s)."""
        return self.run_up, self.run_up + self._length

    @property
    def initial_velocity(self) -> float:
        """Velocity that is demanded at once at t = 0 (m/s); the caller decides whether it is small."""
        return 0.0 if self.run_up else self._end_velocities()[0]

    @property
    def final_velocity(self) -> float:
        """Velocity that ends at once with the motion (m/s)."""
        return 0.0 if self.run_out else self._end_velocities()[1]

    def at(self, t: npt.ArrayLike) -> Motion:
        """Motion at the times `t` (n,) s."""
        return contained(self._inside, t, self.duration, self.end)

    @property
    def _length(self) -> float:
        return float(self.time[-1] - self.time[0])

    @property
    def _distance(self) -> float:
        return float(self.position[-1] - self.position[0])

    def _end_velocities(self) -> tuple[float, float]:
        first, last = self._curve()(np.array([0.0, self._length]), nu=1)
        return float(first), float(last)

    def _curve(self) -> Any:
        from scipy.interpolate import make_interp_spline  # not in the memory of a process that needs none

        times = np.asarray(self.time, dtype=np.float64)
        positions = np.asarray(self.position, dtype=np.float64)
        return make_interp_spline(times - times[0], positions - positions[0], k=5)

    def _inside(self, t: Array) -> Motion:
        curve, since = self._curve(), t - self.run_up
        inner = np.clip(since, 0.0, self._length)
        motion = Motion(curve(inner), curve(inner, nu=1), curve(inner, nu=2))
        if not (self.run_up or self.run_out):
            return motion
        first, last = curve(np.array([0.0, self._length]), nu=1)
        start, stop = 0.5 * first * self.run_up, self._distance
        up, out = since < 0.0, since > self._length
        motion.position[~up] += start
        _put(motion, up, _rise(t[up], self.run_up, first))
        # The run-out is a run-up that is watched backwards from its end.
        left = self._length + self.run_out - since[out]
        x, v, a = _rise(left, self.run_out, last)
        _put(motion, out, Motion(start + stop + 0.5 * last * self.run_out - x, v, -a))
        return motion


class Csv(NamedTuple):
    """A recorded motion from a CSV file with the columns ``time_s`` and ``reference_mm`` (or another unit)."""

    file: Annotated[str, "the CSV file, relative to this one"]
    run_up: Annotated[
        float, Quantity("s", "[0, 60]", "time to reach the first velocity from rest; 0: it begins at rest")
    ] = 0.0
    run_out: Annotated[
        float, Quantity("s", "[0, 60]", "time to come to rest from the last velocity; 0: it ends at rest")
    ] = 0.0
    part: Annotated[
        tuple[float, float] | None, Quantity("s", "[-1e12, 1e12]", "first and last time to run, as in the file")
    ] = None


def _rise(t: Array, duration: float, velocity: float) -> Motion:
    """From rest at 0 to `velocity` (m/s) within `duration` (s), over ``velocity duration / 2``."""
    s = t / (duration or 1.0)
    place = velocity * duration * s * s * s * (1.0 - 0.5 * s)
    return Motion(place, velocity * s * s * (3.0 - 2.0 * s), 6.0 * velocity * s * (1.0 - s) / (duration or 1.0))


def _put(whole: Motion, where: npt.NDArray[np.bool_], part: Motion) -> None:
    for column, values in zip(whole, part, strict=True):
        column[where] = values


class Columns(NamedTuple):
    """Numbers of the columns of a CSV file that hold time and position."""

    time: int
    position: int
    unit: str  # of the position: m, mm, um, rad or counts


_POSITION = re.compile(r"(reference|position)_(m|mm|um|rad|counts)")


def columns(header: Sequence[str]) -> Columns:
    """Columns of a CSV file by their names: ``time_s``, and ``reference_mm`` before ``position_mm``.

    Raises TrajectoryError where one of them is missing or there are two of a kind.
    """
    names = [name.strip() for name in header]
    if len(names) == 1 and ";" in names[0]:
        reason = "the columns are separated by `;`, and a trajectory needs `,` and decimal points"
        remedy = "write the file with them, or import it: `stagectl import`"
        raise TrajectoryError(Problem(reason, ProblemKind.SYNTAX, remedy=remedy))
    positions = [match for match in map(_POSITION.fullmatch, names) if match]
    wanted = [match for match in positions if match[1] == "reference"] or positions
    if names.count("time_s") != 1 or len(wanted) != 1:
        reason = (
            "must hold one time_s and one reference_<unit> (or, without it, one position_<unit>), the unit being m, "
            "mm, um, rad or counts"
        )
        problem = Problem(reason, ProblemKind.MISSING, "columns", ", ".join(names), remedy="rename or remove columns")
        raise TrajectoryError(problem)
    return Columns(names.index("time_s"), names.index(wanted[0][0]), wanted[0][2])
