"""A motion that was recorded: a smooth curve through every sample."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stagectl.trajectories.motion import Array, Motion, TrajectoryError, contained
from stagectl.units import Quantity

LEAST_ROWS = 6  # a polynomial of degree 5
LEAST_STEP = 1e-4  # shortest step of time over the longest; below, the spline's equations lose their digits


class Recorded(NamedTuple):
    """Quintic spline (not-a-knot) through recorded positions, shifted to begin at 0 at t = 0.

    Velocity and acceleration are the spline's own derivatives.  A record that begins or ends in motion begins
    or ends with a jump of the velocity: see `initial_velocity` and `final_velocity`.
    """

    time: Annotated[Any, Quantity("s", "[-1e12, 1e12]", "(n,) increasing")]
    position: Annotated[Any, Quantity("m", "[-1e6, 1e6]", "(n,) at these times")]

    @property
    def duration(self) -> float:
        """From the first to the last sample (s)."""
        return float(self.time[-1] - self.time[0])

    @property
    def end(self) -> float:
        """Last position, from the first (m)."""
        return float(self.position[-1] - self.position[0])

    @property
    def steady(self) -> tuple[float, float]:
        """All of it (s)."""
        return 0.0, self.duration

    @property
    def initial_velocity(self) -> float:
        """Velocity that the axis is asked for at once at t = 0 (m/s); what is small, the caller decides."""
        return float(self._inside(np.zeros(1)).velocity[0])

    @property
    def final_velocity(self) -> float:
        """Velocity that ends at once with the record (m/s)."""
        return float(self._inside(np.array([self.duration])).velocity[0])

    def at(self, t: npt.ArrayLike) -> Motion:
        """Motion at the times `t` (n,) s."""
        return contained(self._inside, t, self.duration, self.end)

    def _inside(self, t: Array) -> Motion:
        from scipy.interpolate import make_interp_spline  # not in the memory of a process that needs none

        times = np.asarray(self.time, dtype=np.float64)
        positions = np.asarray(self.position, dtype=np.float64)
        curve = make_interp_spline(times - times[0], positions - positions[0], k=5)
        return Motion(curve(t), curve(t, nu=1), curve(t, nu=2))


class Columns(NamedTuple):
    """Where a CSV file keeps time and position."""

    time: int
    position: int
    unit: str  # of the position: m, mm, um, rad or counts


_POSITION = re.compile(r"(reference|position)_(m|mm|um|rad|counts)")


def columns(header: Sequence[str]) -> Columns:
    """Columns of a CSV file by their names: ``time_s``, and ``reference_mm`` before ``position_mm``.

    Raises TrajectoryError where one of them is missing or there are two of a kind.
    """
    names = [name.strip() for name in header]
    found = [match for match in map(_POSITION.fullmatch, names) if match]
    wanted = [match for match in found if match[1] == "reference"] or found
    if names.count("time_s") != 1 or len(wanted) != 1:
        raise TrajectoryError(
            f"csv columns = {', '.join(names)}; must hold one time_s and one reference_<unit> (or, without "
            "it, one position_<unit>), the unit being m, mm, um, rad or counts: rename or remove columns"
        )
    return Columns(names.index("time_s"), names.index(wanted[0][0]), wanted[0][2])
