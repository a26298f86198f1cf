"""Rows of a log on the control periods: each in its period, gaps left open; resampled where they were not taken there.

A row that was lost leaves its period empty (NaN).  Time stamps that scatter by more than their digits are instants of
their own: then smooth columns are resampled by a cubic spline, the others linearly.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from stagectl.gap.logs.session import Array, GapError
from stagectl.number_format import duration

SMOOTH = frozenset({"position", "reference"})
SAME = 0.01  # share by which the steps of a log may differ from the control period and still be it
SCATTER = 0.02  # of the period, rms: above, stamps are instants of their own
SAID = 1e-3  # of the period, rms: above, the scatter is said
DRIFT = 1e-4  # share by which two clocks may differ before it is said
GAP = 3.5  # median steps, where rows are resampled
LEAST = 100  # rows of a log


class Gridded(NamedTuple):
    """Columns (n,) at the control periods k Ts; NaN where nothing was logged."""

    columns: dict[str, Array]
    dt: float  # s
    exact: bool  # rows are the periods themselves; else resampled
    samples: tuple[Array, Array]  # s and rad | m, (m,): the reference as it was logged
    notes: list[str]


def gridded(time: Array, columns: Mapping[str, Array], dt: float) -> Gridded:
    """`columns` (m,) at `time` (m,) s on periods of `dt` (s).

    Raises GapError where too little is left.
    """
    if len(time) < LEAST or time[-1] < LEAST * dt:
        raise GapError(
            f"{len(time)} rows over {time[-1]:.6g} s; must be at least {LEAST} of {duration(dt)}: record longer"
        )
    rows, notes = _periods(time, dt)
    if rows is None:
        return _resampled(time, columns, dt, notes)
    found = {name: _placed(rows, column) for name, column in columns.items()}
    lost = rows[-1] + 1 - len(rows)
    if lost:
        widest = int(np.max(np.diff(rows))) - 1
        first = float(rows[int(np.argmax(np.diff(rows) > 1))] + 1) * dt
        notes.append(
            f"{lost} of {rows[-1] + 1} rows are missing, up to {widest} in a row, the first at {first:.6g} s: not used"
        )
    return Gridded(found, dt, True, _samples(dt * rows.astype(np.float64), columns), notes)


def _samples(time: Array, columns: Mapping[str, Array]) -> tuple[Array, Array]:
    """The reference where there is one."""
    reference = columns.get("reference", np.zeros(0))
    sound = np.isfinite(reference)
    return (time[sound] if len(reference) else reference), reference[sound]


def _placed(rows: NDArray[np.intp], column: Array) -> Array:
    found = np.full(int(rows[-1]) + 1, np.nan)
    found[rows] = column
    return found


def _periods(time: Array, dt: float) -> tuple[NDArray[np.intp] | None, list[str]]:
    """The control period that each row belongs to, or None where rows are instants of their own; and words."""
    steps = np.diff(time)
    step = float(np.median(steps))
    if abs(step / dt - 1.0) > SAME:
        return None, [f"rows are {duration(step)} apart, the control period is {duration(dt)}: resampled"]
    counted = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(steps / step), 1.0))])
    slope = float(np.polyfit(counted, time, 1)[0])
    rows = np.rint((time - time[0]) / slope).astype(np.intp)
    if np.any(np.diff(rows) < 1):
        if len(time) != round((time[-1] - time[0]) / slope) + 1:
            return None, [f"several rows fall into one control period of {duration(dt)}: resampled"]
        rows = np.arange(len(time), dtype=np.intp)
    scatter = float(np.std(time - slope * rows))
    if scatter > SCATTER * dt:
        words = f"time stamps scatter by {duration(scatter)} rms around periods of {duration(dt)}: resampled"
        return None, [f"{words}, position and reference by a cubic spline, the rest linearly"]
    return rows, _words(scatter, slope, dt)


def _words(scatter: float, slope: float, dt: float) -> list[str]:
    notes = []
    if scatter > SAID * dt:
        notes.append(f"time stamps scatter by {duration(scatter)} rms: each row is taken as its control period")
    if abs(slope / dt - 1.0) > DRIFT:
        notes.append(f"its clock counts {slope / dt:.6g} s in a second of the controller's: rows are taken as periods")
    return notes


def _resampled(time: Array, columns: Mapping[str, Array], dt: float, notes: list[str]) -> Gridded:
    grid: Array = dt * np.arange(int(time[-1] / dt + 1e-6) + 1, dtype=np.float64)
    found = {name: _at(grid, time, column, name in SMOOTH) for name, column in columns.items()}
    return Gridded(found, dt, False, _samples(time, columns), notes)


def _at(grid: Array, time: Array, column: Array, smooth: bool) -> Array:
    """A column at the times of `grid`; NaN within its gaps."""
    sound = np.isfinite(column)
    t, values = time[sound], column[sound]
    if len(t) < LEAST:
        return np.full(len(grid), np.nan)
    found = np.asarray(CubicSpline(t, values)(grid) if smooth else np.interp(grid, t, values), dtype=np.float64)
    steps = np.diff(t)
    after = np.clip(np.searchsorted(t, grid, side="left"), 1, len(t) - 1)
    off = np.abs(t[after] - grid) > 1e-9
    found[off & (steps[after - 1] > GAP * float(np.median(steps)))] = np.nan
    found[(grid < t[0] - 1e-9) | (grid > t[-1] + 1e-9)] = np.nan
    return found
