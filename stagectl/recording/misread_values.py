"""Values that were misread: single spikes, and positions that wrap at the end of their counter.

A spike is one row that leaves its neighbours and comes back: ``x - (x[k-1] + x[k+1])/2`` is large there, minus half as
large in the rows beside it, and small elsewhere.  A wrap is a jump that stays, as large as the counter's whole range,
which the positions fill.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stagectl.recording import constants
from stagectl.recording.columns import Array


def spikes(column: Array, effort: bool) -> NDArray[np.intp]:
    """Rows of single spikes in `column` (n,); of an `effort` only those that no other value comes near."""
    if len(column) < constants.JUDGED_ROWS or not np.all(np.isfinite(column)):
        return np.zeros(0, dtype=np.intp)
    away = column[2:] + column[:-2]  # in place: a long log has little room
    away *= -0.5
    away += column[1:-1]
    limit = constants.SPIKE * max(_high(np.abs(away)), _smallest_step(column))
    rows = np.flatnonzero((away > limit) | (away < -limit)) + 1
    rows = rows[(rows > 1) & (rows < len(column) - 2)]
    before, here, after = (away[rows - 1 + shift] for shift in (-1, 0, 1))
    back = np.maximum(np.abs(before + 0.5 * here), np.abs(after + 0.5 * here)) <= constants.SPIKE_FORM * np.abs(here)
    rows = rows[back]
    if effort:
        middle = float(np.median(column))
        rows = rows[np.abs(column[rows] - middle) > constants.SPIKE_EFFORT * _high(np.abs(column - middle))]
    return rows if len(rows) <= constants.MOST_SPIKES * len(column) else rows[:0]


def wrap_of(position: Array, step: float) -> float:
    """The range (in the unit of `position`) at whose end a counter wraps; 0 where none does.

    `step` is the encoder's, 0 where it is not known.
    """
    if len(position) < constants.JUDGED_ROWS:
        return 0.0
    changes = np.diff(position)
    width = float(np.ptp(position))
    far = np.abs(changes) > constants.WRAP_JUMP * width
    if not np.any(far) or np.mean(far) > constants.MOST_WRAPS:
        return 0.0
    usual = float(np.max(np.abs(changes[~far]), initial=0.0))
    if usual > constants.WRAP_STEP * width:
        return 0.0
    sizes = np.abs(changes[far])
    estimate = float(np.median(sizes)) + _speed_at(changes, far)
    if float(np.ptp(sizes)) > 4.0 * usual or not width <= estimate <= width + 4.0 * usual:
        return 0.0
    known = _known_range(estimate, usual, step or _smallest_step(position))
    return known or (estimate if len(sizes) > 1 else 0.0)


def unwrapped(position: Array, size: float) -> Array:
    """The position (n,) without its wraps at a range of `size`."""
    turns = np.concatenate([[0.0], np.cumsum(-np.rint(np.diff(position) / size))])
    return np.asarray(position + size * turns, dtype=np.float64)


def _high(values: Array) -> float:
    """The usual size of `values`, of a long log from every so many rows."""
    return float(np.quantile(values[:: 1 + len(values) // constants.QUANTILE_ROWS], constants.USUAL))


def _smallest_step(column: Array) -> float:
    steps = np.abs(np.diff(column[: constants.STEP_LOOK]))
    return float(np.min(steps[steps > 0.0], initial=np.inf)) if np.any(steps > 0.0) else 0.0


def _speed_at(changes: Array, far: NDArray[np.bool_]) -> float:
    """Mean size of the ordinary steps just before the jumps."""
    before = np.flatnonzero(far) - 1
    before = before[before >= 0]
    return float(np.median(np.abs(changes[before]))) if len(before) else 0.0


def _known_range(estimate: float, usual: float, step: float) -> float:
    """One turn, or a power of two of steps, where the jumps are as large as that."""
    known = [2.0 * math.pi]
    if step > 0.0:
        known.append(step * 2.0 ** round(math.log2(estimate / step)))
    nearest = min(known, key=lambda size: abs(size - estimate))
    return nearest if abs(nearest - estimate) <= 2.0 * usual + constants.WRAP_DIGITS * estimate else 0.0
