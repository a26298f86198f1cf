"""Rows of a log on the control periods: each row in its period; resampled where the rows were not taken there.

A row that was lost leaves its period empty (NaN).  Where time stamps scatter by more than their digits, they are real
instants: smooth columns are then resampled by a cubic spline, the others linearly.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from stagectl.gap.logs import thresholds
from stagectl.gap.logs.session import Array, LogError
from stagectl.number_format import duration

SMOOTH = frozenset({"position", "reference"})


class LoggedReference(NamedTuple):
    """The reference as it was logged."""

    time: Array  # (m,) s; row k of the log is at k Ts
    value: Array  # (m,) rad | m


class GriddedLog(NamedTuple):
    """Columns (n,) at the control periods k Ts; NaN where nothing was logged."""

    columns: dict[str, Array]
    dt: float  # s
    exact: bool  # rows are the periods themselves; else resampled
    reference: LoggedReference  # empty where there is none
    notes: list[str]

    @property
    def rows(self) -> int:
        """Control periods."""
        return len(self.columns["position"])


def on_control_periods(name: str, time: Array, columns: Mapping[str, Array], dt: float) -> GriddedLog:
    """The columns (m,) of the log `name` at `time` (m,) s, on periods of `dt` (s).

    Raises LogError where too few rows are left.
    """
    if len(time) < thresholds.LEAST_ROWS or time[-1] < thresholds.LEAST_ROWS * dt:
        words = f"must be at least {thresholds.LEAST_ROWS} of {duration(dt)}: record longer"
        raise LogError("short", (name,), f"{name}: {len(time)} rows over {time[-1]:.6g} s; {words}")
    rows, notes = _periods(time, dt)
    if rows is None:
        return _resampled(time, columns, dt, notes)
    placed = {column_name: _placed(rows, column) for column_name, column in columns.items()}
    reference = _reference(dt * rows.astype(np.float64), columns)
    return GriddedLog(placed, dt, True, reference, [*notes, *_lost_rows(rows, dt)])


def _lost_rows(rows: NDArray[np.intp], dt: float) -> list[str]:
    count = int(rows[-1]) + 1
    if len(rows) == count:
        return []
    steps = np.diff(rows)
    first = float(rows[int(np.argmax(steps > 1))] + 1) * dt
    return [
        f"{count - len(rows)} of {count} rows are missing, up to {int(np.max(steps)) - 1} in a row, the first at "
        f"{first:.6g} s: not used"
    ]


def _reference(time: Array, columns: Mapping[str, Array]) -> LoggedReference:
    reference = columns.get("reference", np.zeros(0))
    sound = np.isfinite(reference)
    return LoggedReference(time[sound] if len(reference) else reference, reference[sound])


def _placed(rows: NDArray[np.intp], column: Array) -> Array:
    placed = np.full(int(rows[-1]) + 1, np.nan)
    placed[rows] = column
    return placed


def _periods(time: Array, dt: float) -> tuple[NDArray[np.intp] | None, list[str]]:
    """The control period of each row, or None where the rows must be resampled; and notes."""
    steps = np.diff(time)
    step = float(np.median(steps))
    if abs(step / dt - 1.0) > thresholds.SAME_STEP:
        return None, [f"rows are {duration(step)} apart, the control period is {duration(dt)}: resampled"]
    counted = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(steps / step), 1.0))])
    slope = float(np.polyfit(counted, time, 1)[0])
    rows = np.rint((time - time[0]) / slope).astype(np.intp)
    if np.any(np.diff(rows) < 1):
        if len(time) != round((time[-1] - time[0]) / slope) + 1:
            return None, [f"several rows fall into one control period of {duration(dt)}: resampled"]
        rows = np.arange(len(time), dtype=np.intp)
    scatter = float(np.std(time - slope * rows))
    if scatter > thresholds.SCATTER * dt:
        words = f"time stamps scatter by {duration(scatter)} rms around periods of {duration(dt)}: resampled"
        return None, [f"{words}, position and reference by a cubic spline, the other columns linearly"]
    return rows, _clock_notes(scatter, slope, dt)


def _clock_notes(scatter: float, slope: float, dt: float) -> list[str]:
    notes = []
    if scatter > thresholds.NOTED_SCATTER * dt:
        notes.append(f"time stamps scatter by {duration(scatter)} rms: each row is taken as its control period")
    if abs(slope / dt - 1.0) > thresholds.NOTED_DRIFT:
        notes.append(f"its clock counts {slope / dt:.6g} s per second of the controller: rows are taken as periods")
    return notes


def _resampled(time: Array, columns: Mapping[str, Array], dt: float, notes: list[str]) -> GriddedLog:
    grid: Array = dt * np.arange(int(time[-1] / dt + 1e-6) + 1, dtype=np.float64)
    resampled = {name: _interpolated(grid, time, column, name in SMOOTH) for name, column in columns.items()}
    return GriddedLog(resampled, dt, False, _reference(time, columns), notes)


def _interpolated(grid: Array, time: Array, column: Array, smooth: bool) -> Array:
    """A column at the times of `grid`; NaN within its gaps."""
    sound = np.isfinite(column)
    t, values = time[sound], column[sound]
    if len(t) < thresholds.LEAST_ROWS:
        return np.full(len(grid), np.nan)
    signal = np.asarray(CubicSpline(t, values)(grid) if smooth else np.interp(grid, t, values), dtype=np.float64)
    steps = np.diff(t)
    after = np.clip(np.searchsorted(t, grid, side="left"), 1, len(t) - 1)
    between = np.abs(t[after] - grid) > thresholds.SAME_INSTANT
    signal[between & (steps[after - 1] > thresholds.GAP_STEPS * float(np.median(steps)))] = np.nan
    signal[(grid < t[0] - thresholds.SAME_INSTANT) | (grid > t[-1] + thresholds.SAME_INSTANT)] = np.nan
    return signal
