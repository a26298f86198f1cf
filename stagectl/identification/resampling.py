"""A record as parts of equally spaced rows: gaps split it, slightly irregular time stamps are resampled."""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from stagectl.identification import thresholds
from stagectl.identification.capture import Array, IdentificationError, Refusal
from stagectl.identification.result import Note, Topic
from stagectl.number_format import duration


class Part(NamedTuple):
    """Rows without a gap, equally spaced."""

    start: float  # s, of its first row in the record's own time
    dt: float  # s
    columns: dict[str, Array]  # (n,) each
    note: str  # empty where the rows are as they were recorded
    unevenness: float = 0.0  # s, rms of how far its time stamps were from equally spaced ones


def parts(time: Array, columns: dict[str, Array], smooth: frozenset[str]) -> tuple[list[Part], list[str]]:
    """Split a record at its gaps; returns the parts and notes on what was done.

    `time` is (n,) s, each column (n,).  A row is used where all `columns` are finite.  Where the time stamps vary,
    columns named in `smooth` are resampled by a cubic spline, the others linearly.
    Raises IdentificationError where time does not increase, or too few rows remain.
    """
    check_time(time)
    finite = np.all([np.isfinite(column) for column in columns.values()], axis=0)
    notes: list[str] = [note for name, column in columns.items() if (note := _missing(name, column, time))]
    if np.count_nonzero(finite) < thresholds.CAPTURE_LEAST_ROWS:
        some = f"{np.count_nonzero(finite)} of {len(time)} rows have a number in {' and '.join(columns)} at once"
        sparse = "" if finite.all() else ", or bring the columns to the same instants"
        raise _too_few(
            f"{f'{len(time)} rows' if finite.all() else some}; must be at least {thresholds.CAPTURE_LEAST_ROWS}: "
            f"record longer (stagectl run with more periods, stagectl record --for 10s), or more often{sparse}",
            notes,
            int(np.count_nonzero(finite)),
        )
    step = float(np.median(np.diff(time)))
    pieces = _pieces(time, finite, thresholds.GAP_STEPS * step)
    notes += _gaps(time, pieces, step)
    longest = max(map(len, pieces))
    least = max(thresholds.CAPTURE_LEAST_ROWS, round(thresholds.PART_LEAST_SHARE * longest))
    long_enough = [rows for rows in pieces if len(rows) >= least]
    if len(long_enough) < len(pieces):
        short = len(pieces) - len(long_enough)
        text = f"{short} of {len(pieces)} parts between gaps are shorter than {least} rows and are left out"
        notes.append(Note(Topic.LEFT_OUT, text))
    if not long_enough:
        text = f"no part between gaps has {thresholds.CAPTURE_LEAST_ROWS} rows; record without gaps"
        raise _too_few(text, notes, longest)
    selections = [_rows(rows) for rows in long_enough]
    return [
        _equally_spaced(time[rows], {name: column[rows] for name, column in columns.items()}, smooth)
        for rows in selections
    ], notes


def _pieces(time: Array, finite: NDArray[np.bool_], longest: float) -> list[NDArray[np.intp]]:
    """Rows between the gaps that are longer than `longest` (s)."""
    used_rows = np.flatnonzero(finite)
    used = time if len(used_rows) == len(time) else time[used_rows]
    return np.split(used_rows, np.flatnonzero(np.diff(used) > longest) + 1)


def _too_few(text: str, notes: list[str], rows: int) -> IdentificationError:
    return IdentificationError(
        "; ".join([text, *notes]),
        Refusal.TOO_SHORT,
        value=rows,
        admissible=f"[{thresholds.CAPTURE_LEAST_ROWS}, inf)",
    )


def _rows(rows: NDArray[np.intp]) -> slice | NDArray[np.intp]:
    """The same rows as a slice where they are consecutive, so that no copy is made of them."""
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first + 1 == len(rows) else rows


def check_time(time: Array) -> None:
    """Check that `time` (n,) s is finite and increases strictly.

    Raises IdentificationError, with row and value, where it does not.
    """
    if len(time) < 2:
        raise IdentificationError(
            f"{len(time)} rows; must have at least {thresholds.CAPTURE_LEAST_ROWS}: record longer "
            "(stagectl record --for 10s)",
            Refusal.TOO_SHORT,
            value=len(time),
        )
    if not np.all(finite := np.isfinite(time)):
        row = int(np.argmin(finite))
        text = f"time in row {row + 1} is {time[row]}; must be a number: remove the row"
        raise IdentificationError(text, Refusal.NOT_FINITE, value=float(time[row]), unit="s")
    if np.any(backwards := time[1:] <= time[:-1]):
        row = int(np.argmax(backwards)) + 1
        count = int(np.count_nonzero(backwards))
        how = "repeats" if time[row] == time[row - 1] else "goes back"
        text = (
            f"time {time[row]:.9g} s in row {row + 1} {how} ({time[row - 1]:.9g} s before it), and so in {count} of "
            f"{len(time)} rows; times must increase strictly: remove repeated rows, or sort the log by time"
        )
        raise IdentificationError(text, Refusal.TIME_ORDER, value=float(time[row]), unit="s")


def _missing(name: str, column: Array, time: Array) -> str:
    finite = np.isfinite(column)
    if np.all(finite):
        return ""
    row = int(np.argmin(finite))
    return Note(
        Topic.LEFT_OUT,
        f"{name} is not a number in {len(column) - np.count_nonzero(finite)} of {len(column)} rows, the first is row "
        f"{row + 1} at {time[row]:.6g} s: these rows are not used",
    )


def _gaps(time: Array, pieces: list[NDArray[np.intp]], step: float) -> list[str]:
    if len(pieces) < 2:
        return []
    gaps = [(float(time[before[-1]]), float(time[after[0]])) for before, after in itertools.pairwise(pieces)]
    begin, end = max(gaps, key=lambda gap: gap[1] - gap[0])
    text = (
        f"{len(gaps)} {'gap' if len(gaps) == 1 else 'gaps'}, the longest from {begin:.6g} to {end:.6g} s at steps of "
        f"{duration(step)}: split there into {len(pieces)} parts"
    )
    return [Note(Topic.GAPS, text)]


def _equally_spaced(time: Array, columns: dict[str, Array], smooth: frozenset[str]) -> Part:
    steps = np.diff(time)
    start, dt, count = _grid(time, steps)
    uneven = max(float(np.max(steps)) - dt, dt - float(np.min(steps)))
    grid = start + dt * np.arange(count)
    if count == len(time):
        rounded = bool(np.max(np.abs(time - grid)) <= thresholds.ROUNDED_STAMPS * dt)  # and not irregular
        if rounded or uneven <= thresholds.JITTER * dt:
            return Part(start, dt, columns, "")
    grid[-1] = time[-1]
    resampled = {
        name: np.asarray(CubicSpline(time, column)(grid) if name in smooth else np.interp(grid, time, column))
        for name, column in columns.items()
    }
    text = (
        f"time stamps are {duration(float(steps.min()))} to {duration(float(steps.max()))} apart: resampled every "
        f"{duration(dt)}, {' and '.join(name for name in columns if name in smooth)} by a cubic spline, the rest "
        "linearly"
    )
    away = time - start - dt * np.rint((time - start) / dt)
    return Part(start, dt, resampled, Note(Topic.RESAMPLED, text), float(np.sqrt(np.mean(away * away))))


def _grid(time: Array, steps: Array) -> tuple[float, float, int]:
    """Start (s), spacing (s) and rows: of the grid that single rows are missing from, else of as many rows as came."""
    start, length = float(time[0]), float(time[-1] - time[0])
    even = start, length / (len(time) - 1), len(time)
    usual = float(np.median(steps))
    if float(np.max(steps)) < 1.5 * usual:
        return even
    row = np.rint((time - start) / usual)
    dt = length / float(row[-1])
    missing = int(row[-1]) + 1 > len(time) and bool(np.all(np.diff(row) >= 1.0))
    if missing and float(np.max(np.abs(time - start - dt * row))) <= thresholds.ROUNDED_STAMPS * dt:
        return start, dt, int(row[-1]) + 1
    return even
