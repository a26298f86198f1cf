"""Time stamps as they are: rows that were written twice, and a clock that was rounded to coarser steps than the rows.

A rounded clock hides equal spacing, and equal spacing can be recovered: row k was taken at ``start + k dt``, and no
stamp is further from it than one step of the clock.  Stamps that scatter by more are real instants and stay.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from stagectl.number_format import duration
from stagectl.recording import constants
from stagectl.recording.columns import Array


def written_twice(time: Array, columns: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Rows (n,) that repeat the row before them in every column; none where only the stamps repeat."""
    again = np.concatenate([[False], time[1:] == time[:-1]])
    if not np.any(again):
        return again
    same = again.copy()
    for column in columns.values():
        same[1:] &= (column[1:] == column[:-1]) | ~np.isfinite(column[1:])
    moved = [np.any(np.diff(column)[~again[1:]] != 0.0) for column in columns.values()]
    return same if np.array_equal(same, again) and any(moved) else np.zeros(len(time), dtype=np.bool_)


def recovered(time: Array) -> tuple[Array, str]:
    """The instants (n,) s behind rounded stamps and a note; the stamps themselves where they are not rounded."""
    steps = np.diff(time)
    if len(time) < constants.JUDGED_ROWS or not np.all(steps >= 0.0) or _even(steps):
        return time, ""
    clock = float(np.min(steps[steps > 0.0], initial=np.inf))
    if not _multiples(steps, clock):
        return time, ""
    instants, dt = _on_grid(time, steps, clock)
    if dt <= 0.0 or float(np.max(np.abs(instants - time))) > constants.CLOCK_ERROR * clock:
        return time, ""
    words = f"time stamps are rounded to {duration(clock)}: rows are taken every {duration(dt)}, as their number shows"
    return instants, words


def _even(steps: Array) -> bool:
    usual = float(np.median(steps))
    return bool(np.max(steps) - usual <= constants.EVEN_STEPS * usual >= usual - np.min(steps))


def _multiples(steps: Array, clock: float) -> bool:
    counts = steps / clock
    return bool(np.isfinite(clock) and np.all(np.abs(counts - np.rint(counts)) < constants.CLOCK_DIGITS))


def _on_grid(time: Array, steps: Array, clock: float) -> tuple[Array, float]:
    """Equally spaced instants, a start for each stretch between gaps; and their spacing."""
    block = min(constants.CLOCK_BLOCK, len(steps) // 2)
    dt = float(np.median(time[block:] - time[:-block])) / block
    starts = np.flatnonzero(steps > clock + constants.CLOCK_GAP * dt) + 1
    edges = [0, *starts.tolist(), len(time)]
    stretches = [slice(a, b) for a, b in itertools.pairwise(edges)]
    longest = max(stretches, key=lambda rows: rows.stop - rows.start)
    count = np.arange(longest.stop - longest.start, dtype=np.float64)
    if len(count) > 2:
        count -= count.mean()
        dt = float(count @ (time[longest] - time[longest].mean()) / (count @ count))
    instants = np.empty(len(time))
    for rows in stretches:
        own = dt * np.arange(rows.stop - rows.start)
        instants[rows] = own + float(np.mean(time[rows] - own))
    return instants, dt
