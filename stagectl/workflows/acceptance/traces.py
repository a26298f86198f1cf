"""What the axis did in one trial, few enough points to be signed and drawn."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.kernels import rollout
from stagectl.workflows.acceptance.limits import TRACE_DIGITS, TRACE_LEAD, TRACE_POINTS

MEASURED, CURRENT, FLOWING = (rollout.COLUMNS.index(name) for name in ("measured", "current", "measured_current"))
Path = list[tuple[float, float]]  # s after the axis was left, and position (rad | m), read over SDO


class Trace(NamedTuple):
    """Position and current of one trial; positions in m of the table, or in rad, from where it began."""

    name: str  # which of the step's trials; empty: the only one
    time: list[float]  # (n,) s, from the event, else from the first period
    position: list[float]  # (n,)
    current: list[float]  # (n,) A, commanded
    flowing: list[float]  # (n,) A, measured; empty where the drive reports none
    after: list[tuple[float, float]]  # s and position, read from the drive once its controller is gone
    event: str = ""  # what happened at time 0
    origin: float | None = None  # position from which the step's bound counts
    least: float | None = None  # position at which a motion counts as one
    limit: float | None = None  # A, of the current


class Mark(NamedTuple):
    """What a step knows of its trial besides the rows; positions in rad | m, absolute."""

    name: str = ""
    event: str = ""
    row: int | None = None  # in which the event happened
    origin: float | None = None
    least: float | None = None  # rad | m, a way
    limit: float | None = None  # A


def traced(rows: NDArray[np.float64], first: int, grid: tuple[float, float, float], mark: Mark, after: Path) -> Trace:
    """The trace of ring `rows` (n, WIDTH), the first of them number `first`.

    `grid` is the period (s), where the trial began (rad | m), and m of the table per rad, or 1.
    """
    dt, here, per = grid
    number = first + np.arange(len(rows))
    zero = first if mark.row is None else mark.row
    if mark.row is not None:
        rows, number = rows[number >= zero - TRACE_LEAD / dt], number[number >= zero - TRACE_LEAD / dt]
    kept = _thinned(rows)
    rows, number = rows[kept], number[kept]
    watched = [(time, (place - here) * per) for time, place in after[:: 1 + len(after) // TRACE_POINTS]]
    return Trace(
        name=mark.name,
        time=_short((number - zero) * dt),
        position=_short((rows[:, MEASURED] - here) * per),
        current=_short(rows[:, CURRENT]),
        flowing=[] if np.isnan(rows[:, FLOWING]).any() else _short(rows[:, FLOWING]),
        after=[(time, place) for time, place in map(_short, watched)],
        event=mark.event,
        origin=None if mark.origin is None else (mark.origin - here) * per,
        least=None if mark.least is None else mark.least * per,
        limit=mark.limit,
    )


def _thinned(rows: NDArray[np.float64]) -> NDArray[np.intp]:
    """Rows to keep: evenly spaced, and those with the extremes, which an acceptance is judged by."""
    if not len(rows):
        return np.zeros(0, np.intp)
    even = np.linspace(0, len(rows) - 1, min(len(rows), TRACE_POINTS)).astype(np.intp)
    watched = np.nan_to_num(rows[:, [MEASURED, CURRENT, FLOWING]])
    return np.unique(np.concatenate([even, watched.argmax(axis=0), watched.argmin(axis=0)]))


def _short(values: Any) -> list[float]:
    return [float(f"{value:.{TRACE_DIGITS}g}") for value in values]
