"""Rows of a record that follow each other at equal steps: gaps split it, a slight irregularity is resampled."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from stagectl.identification.capture import Array, IdentificationError
from stagectl.number_format import duration

GAP = 3.5  # median steps: a row or two may be lost without one
JITTER = 1e-3  # of the mean step: digits of the time stamps, not their irregularity
LEAST_ROWS = 100  # of a part
LEAST_SHARE = 0.02  # of the longest part's rows


class Part(NamedTuple):
    """Rows without a gap, equally spaced."""

    start: float  # s, of its first row in the record's own time
    dt: float  # s
    columns: dict[str, Array]  # (n,) each
    note: str  # empty where the rows are as they were recorded


def parts(time: Array, columns: dict[str, Array], smooth: frozenset[str]) -> tuple[list[Part], list[str]]:
    """The record's parts without gaps, and what was done in words; a row is used where all `columns` are numbers.

    Where the time stamps vary, columns named in `smooth` are resampled by a cubic spline, the others linearly.
    Raises IdentificationError where time does not increase, or too few rows are left.
    """
    checked(time)
    sound = np.all([np.isfinite(column) for column in columns.values()], axis=0)
    notes = [words for name, column in columns.items() if (words := _missing(name, column, time))]
    if np.count_nonzero(sound) < LEAST_ROWS:
        raise IdentificationError(
            f"{np.count_nonzero(sound)} of {len(time)} rows have a number in {' and '.join(columns)} at once; at least "
            f"{LEAST_ROWS} must: record longer (stagectl run with more periods, stagectl record --for 10s), or bring "
            "the columns to the same instants" + "".join(f"; {note}" for note in notes)
        )
    step = float(np.median(np.diff(time)))
    kept = np.flatnonzero(sound)
    breaks = np.flatnonzero(np.diff(time[kept]) > GAP * step) + 1
    pieces = np.split(kept, breaks)
    notes += _gaps(time, pieces, step)
    least = max(LEAST_ROWS, round(LEAST_SHARE * max(map(len, pieces))))
    used = [rows for rows in pieces if len(rows) >= least]
    if len(used) < len(pieces):
        short = sum(len(rows) < least for rows in pieces)
        notes.append(f"{short} of {len(pieces)} parts between gaps are shorter than {least} rows and are left out")
    if not used:
        raise IdentificationError(
            f"gaps leave no part of {LEAST_ROWS} rows; record without gaps{''.join(f'; {note}' for note in notes)}"
        )
    cut = [_rows(rows) for rows in used]
    return [_equally_spaced(time[rows], {n: c[rows] for n, c in columns.items()}, smooth) for rows in cut], notes


def _rows(rows: NDArray[np.intp]) -> slice | NDArray[np.intp]:
    """The same rows as a slice where none is left out: no copy is made of them."""
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first + 1 == len(rows) else rows


def checked(time: Array) -> None:
    """Raises IdentificationError, with row and value, where time is no number or does not increase."""
    if len(time) < 2:
        raise IdentificationError(
            f"{len(time)} rows; must have at least {LEAST_ROWS}: record longer (stagectl record --for 10s)"
        )
    if not np.all(finite := np.isfinite(time)):
        row = int(np.argmin(finite))
        raise IdentificationError(f"time in row {row + 1} is {time[row]}; must be a number: remove the row")
    if np.any(backwards := np.diff(time) <= 0.0):
        row = int(np.argmax(backwards)) + 1
        count = int(np.count_nonzero(backwards))
        how = "repeats" if time[row] == time[row - 1] else "goes back"
        raise IdentificationError(
            f"time {time[row]:.9g} s in row {row + 1} {how} ({time[row - 1]:.9g} s before it), and so in {count} of "
            f"{len(time)} rows; times must increase strictly: remove repeated rows, or sort the log by time"
        )


def _missing(name: str, column: Array, time: Array) -> str:
    finite = np.isfinite(column)
    if np.all(finite):
        return ""
    row = int(np.argmin(finite))
    return (
        f"{name} is no number in {len(column) - np.count_nonzero(finite)} of {len(column)} rows, the first is row "
        f"{row + 1} at {time[row]:.6g} s: these rows are not used"
    )


def _gaps(time: Array, pieces: list[NDArray[np.intp]], step: float) -> list[str]:
    if len(pieces) < 2:
        return []
    ends = [(float(time[a[-1]]), float(time[b[0]])) for a, b in itertools.pairwise(pieces)]
    begin, end = max(ends, key=lambda gap: gap[1] - gap[0])
    return [
        f"{len(ends)} {'gap' if len(ends) == 1 else 'gaps'}, the longest from {begin:.6g} to {end:.6g} s at steps of "
        f"{duration(step)}: split there into {len(pieces)} parts"
    ]


def _equally_spaced(time: Array, columns: dict[str, Array], smooth: frozenset[str]) -> Part:
    start, count = float(time[0]), len(time)
    dt = (float(time[-1]) - start) / (count - 1)
    steps = np.diff(time)
    if float(np.max(np.abs(steps - dt))) <= JITTER * dt or _only_digits(time, start, dt):
        return Part(start, dt, columns, "")
    grid = start + dt * np.arange(count)
    grid[-1] = time[-1]
    resampled = {
        name: np.asarray(CubicSpline(time, column)(grid) if name in smooth else np.interp(grid, time, column))
        for name, column in columns.items()
    }
    note = (
        f"time stamps are {duration(float(steps.min()))} to {duration(float(steps.max()))} apart: resampled every "
        f"{duration(dt)}, {' and '.join(n for n in columns if n in smooth)} by a cubic spline, the rest linearly"
    )
    return Part(start, dt, resampled, note)


def _only_digits(time: Array, start: float, dt: float) -> bool:
    """Whether the stamps stay within a fiftieth of a step of equal spacing: rounded, not irregular."""
    return bool(np.max(np.abs(time - (start + dt * np.arange(len(time))))) <= 0.02 * dt)
