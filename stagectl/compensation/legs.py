r"""A motion cut at its standstills into legs, and the distance of each instant from the ends of its leg.

::

    velocity     leg 1                        leg 3
          ______________                    _________
         /              \     standing     /                 a standstill belongs to the leg before it;
    ----/----------------\---------------_/-----------> t    leg 0 is the rest at the beginning
                          \______________/
                               leg 2

A crossing lies between two samples: the velocity is interpolated linearly, which is exact under constant
acceleration; at the edge of a standstill it is extrapolated from the moving side.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.compensation.constants import ROUNDING

Array = NDArray[np.float64]


class Legs(NamedTuple):
    """The rows (n,) of a motion by their distance from its crossings, and its legs (m,).

    A record that begins or ends in motion has an infinite distance to the crossing it does not show.
    """

    leg: NDArray[np.intp]  # (n,) number of the leg
    since: Array  # (n,) s, from the leg's beginning; its duration while standing
    until: Array  # (n,) s, to the leg's end; 0 while standing
    covered: Array  # (n,) rad | m, from where the leg began, >= 0
    speed: Array  # (n,) rad/s | m/s; 0 while standing
    way: Array  # (m,) +1 or -1, direction of the leg; 0 for the rest at the beginning
    start: Array  # (m,) s, instant at which the leg begins
    end: Array  # (m,) s, instant at which it comes to a stop
    length: Array  # (m,) rad | m, from its beginning to its end
    period: float = math.nan  # s, between two rows; NaN where they are cut out of several motions

    @property
    def duration(self) -> Array:
        """Of each leg (m,) s."""
        return np.concatenate([[0.0], self.end[1:] - self.start[1:]])

    @property
    def path(self) -> Array:
        """Position (n + 1,) rad | m since the rest at the beginning, which comes first; a standstill is exactly still.

        For a reference: a record that begins in motion has no such beginning.
        """
        ends = np.cumsum(self.way * np.where(np.isfinite(self.length), self.length, 0.0))
        begins = np.concatenate([[0.0], ends[:-1]])
        return np.concatenate([[0.0], begins[self.leg] + self.way[self.leg] * self.covered])

    def reversals(self) -> NDArray[np.intp]:
        """Numbers of the legs that run against the leg before."""
        return np.flatnonzero(self.way[1:] * self.way[:-1] < 0.0) + 1


class Run(NamedTuple):
    """Rows `first` ... `last` that move in the same direction."""

    first: int
    last: int
    way: float


class _Edge(NamedTuple):
    row: float  # fractional
    place: float  # rad | m


def legs(position: Array, velocity: Array, dt: float) -> Legs:
    """Legs of a reference that begins at rest, sampled every `dt` (s); `position`, `velocity` (n,) in axis units.

    Its first row may already move, as it is computed ahead of time: the beginning is extrapolated from there.
    """
    band = ROUNDING * float(np.max(np.abs(velocity), initial=0.0))
    return _cut(position, velocity, dt, runs_of(velocity, band), from_rest=True)


def measured_legs(position: Array, velocity: Array, dt: float, band: float, least: float) -> Legs:
    """Legs of a measured motion, smoothed; a record that begins in motion has done so for long.

    Rows slower than `band` are at rest, and so are stretches between two standstills that never exceed `least`.  Both
    limits lie above the noise.
    """
    runs = [run for run in runs_of(velocity, band) if np.max(np.abs(velocity[run.first : run.last + 1])) > least]
    return _cut(position, velocity, dt, runs, from_rest=False)


def _cut(position: Array, velocity: Array, dt: float, runs: list[Run], from_rest: bool) -> Legs:
    x, v = np.asarray(position, dtype=np.float64), np.zeros(len(velocity))
    for run in runs:  # exactly zero outside of them
        v[run.first : run.last + 1] = velocity[run.first : run.last + 1]
    rest = _Edge(0.0, float(x[0]) if len(x) else 0.0)
    starts = [rest] + [_start(run, x, v, dt) for run in runs]
    ends = [rest] + [_end(run, x, v, dt) for run in runs]
    if from_rest and runs and runs[0].first == 0:
        starts[1] = _before(runs[0], x, v, dt)
    way = np.array([0.0] + [run.way for run in runs])
    firsts = np.array([run.first for run in runs], dtype=np.intp)
    return _measured_from(np.array(starts), np.array(ends), way, (firsts, x, v, dt))


def _measured_from(starts: Array, ends: Array, way: Array, rows: tuple[NDArray[np.intp], Array, Array, float]) -> Legs:
    """Distances of all rows from the edges (m, 2) of the leg that each belongs to."""
    firsts, x, v, dt = rows
    at = np.arange(len(x), dtype=np.float64)
    leg = np.searchsorted(firsts, at, side="right").astype(np.intp)
    length = np.abs(np.concatenate([[0.0], ends[1:, 1] - starts[1:, 1]]))
    start, end = starts[:, 0], ends[:, 0]
    moved = np.where(np.isinf(start[leg]) & (leg > 0), np.inf, np.abs(x - starts[leg, 1]))
    since = np.where(leg > 0, np.minimum(at, end[leg]) - start[leg], 0.0)
    until = np.where(leg > 0, np.maximum(end[leg] - at, 0.0), 0.0)
    covered = np.where(leg > 0, np.minimum(np.where(at < end[leg], moved, np.inf), length[leg]), 0.0)
    return Legs(leg, since * dt, until * dt, covered, np.abs(v), way, start * dt, end * dt, length, dt)


def runs_of(velocity: Array, band: float) -> list[Run]:
    """Stretches of one sign; rows at rest, at most as fast as `band`, are left out."""
    sign = np.where(np.abs(velocity) > band, np.sign(velocity), 0.0)
    if not len(sign):
        return []
    edges = np.flatnonzero(np.diff(sign)) + 1
    firsts, lasts = np.concatenate([[0], edges]), np.concatenate([edges - 1, [len(sign) - 1]])
    return [Run(int(a), int(b), float(sign[a])) for a, b in zip(firsts, lasts, strict=True) if sign[a] != 0.0]


def _start(run: Run, x: Array, v: Array, dt: float) -> _Edge:
    """Where the run left the crossing: between its first row and the row before."""
    a = run.first
    if a == 0:
        return _Edge(-np.inf, -run.way * np.inf)
    if v[a - 1] != 0.0:
        return _crossing(a - 1, x, v, dt)
    share = _share(v[a], v[a + 1] - v[a]) if run.last > a else 0.5
    return _Edge(a - share, float(x[a - 1]))


def _before(run: Run, x: Array, v: Array, dt: float) -> _Edge:
    """Where a run that is already moving in the first row left its rest, at constant acceleration."""
    change = float(v[1] - v[0]) if run.last > 0 else 0.0
    rows = float(v[0]) / change if v[0] * change > 0.0 else 0.5
    return _Edge(-rows, float(x[0] - 0.5 * v[0] * rows * dt))


def _end(run: Run, x: Array, v: Array, dt: float) -> _Edge:
    """Where the run reaches the next crossing: between its last row and the row after."""
    b = run.last
    if b == len(v) - 1:
        return _Edge(np.inf, run.way * np.inf)
    if v[b + 1] != 0.0:
        return _crossing(b, x, v, dt)
    share = _share(v[b], v[b - 1] - v[b]) if b > run.first else 0.5
    return _Edge(b + share, float(x[b + 1]))


def _crossing(k: int, x: Array, v: Array, dt: float) -> _Edge:
    share = float(v[k] / (v[k] - v[k + 1]))
    return _Edge(k + share, float(x[k] + 0.5 * v[k] * share * dt))


def _share(velocity: Any, change: Any) -> float:
    """Share of a period in which the velocity, with this change a period, was reached from zero."""
    return min(float(velocity / change), 1.0) if velocity * change > 0.0 else 0.5
