"""Which rows of a log must not count: gaps, saturation, faults; each with a note that says so."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.logs.session import Array
from stagectl.number_format import duration

Rows = NDArray[np.bool_]

SETTLED = 0.2  # s after a gap of the reference, until the loop has forgotten what it was not told
SHORT = 0.02  # s of a gap that a spline through the reference bridges
OFF = 0.05  # s without current, under a command, at the end: the drive is off
FROZEN = 0.1  # s of one and the same position while the reference moves
_NOTHING = 1e-3  # of the largest current
_ASKED = 0.05  # of the largest command: this much and no current
_MOVED = 100.0  # encoder steps
_TOP = 0.95  # of the largest current: at its limit, but for noise
AWAY = 5.0  # times the largest current: a command that no drive answers any more
_PLATEAU = 5  # rows in a row at the limit


class Judged(NamedTuple):
    """Rows that count, and what was found."""

    valid: Rows
    notes: list[str]


def judged(columns: dict[str, Array], dt: float, limit: float, step: float) -> Judged:
    """The rows of a log that count; `limit` (A) is the largest current that is known, `step` the encoder's."""
    valid = np.ones(len(columns["position"]), dtype=np.bool_)
    notes: list[str] = []
    for rows, words in (
        _missing(columns),
        _unasked(columns, dt),
        _saturated(columns, limit),
        _faulted(columns),
        _switched_off(columns, dt),
        _frozen(columns, dt, step),
        _ran_away(columns),
    ):
        if np.any(rows):
            share = 100.0 * float(np.mean(rows))
            notes.append(f"{words} (from {float(np.argmax(rows)) * dt:.6g} s, {share:.2g} % of it): not used")
            valid &= ~rows
    return Judged(valid, notes + _plateau(columns, limit))


def _missing(columns: dict[str, Array]) -> tuple[Rows, str]:
    """Rows without a number where there are some."""
    absent = np.zeros(len(columns["position"]), dtype=np.bool_)
    empty = []
    for name in ("position", "command", "current"):
        if name in columns and np.any(lost := np.isnan(columns[name])):
            absent |= lost
            empty.append(name)
    return absent, f"rows without {' and '.join(empty)}"


def _unasked(columns: dict[str, Array], dt: float) -> tuple[Rows, str]:
    """A longer gap of the reference: what was asked for there is not known, nor how the loop came out of it."""
    lost = np.isnan(columns["reference"]) if "reference" in columns else np.zeros(len(columns["position"]), np.bool_)
    found = np.zeros(len(lost), dtype=np.bool_)
    for begin, end in stretches(lost):
        if (end - begin) * dt > SHORT:
            found[begin : end + round(SETTLED / dt)] = True
    return found, f"a gap of the reference, and {duration(SETTLED)} after it"


def _saturated(columns: dict[str, Array], limit: float) -> tuple[Rows, str]:
    command = columns.get("command", np.zeros(len(columns["position"])))
    return np.abs(command) > limit, f"the command exceeds the limit of {limit:g} A"


def _faulted(columns: dict[str, Array]) -> tuple[Rows, str]:
    """From the first fault that the recording tells of."""
    fault = columns.get("fault", np.zeros(len(columns["position"])))
    return np.cumsum(np.nan_to_num(fault) != 0.0) > 0, "a fault stopped the run"


def _switched_off(columns: dict[str, Array], dt: float) -> tuple[Rows, str]:
    """No current under a command, to the end."""
    words = "no current flows while the controller asks for it, as after a fault of the drive"
    none = np.zeros(len(columns["position"]), dtype=np.bool_)
    if "command" not in columns or "current" not in columns:
        return none, words
    command, current = np.abs(np.nan_to_num(columns["command"])), np.abs(np.nan_to_num(columns["current"]))
    flowing = np.flatnonzero(current > _NOTHING * current.max(initial=0.0))
    begin = int(flowing[-1]) + 1 if flowing.size else len(none)
    if (len(none) - begin) * dt > OFF and np.median(command[begin:]) > _ASKED * command.max():
        none[begin:] = True
    return none, words


def _frozen(columns: dict[str, Array], dt: float, step: float) -> tuple[Rows, str]:
    """The position does not change while the reference moves far."""
    words = "the position stays the same while the reference moves"
    position = columns["position"]
    none = np.zeros(len(position), dtype=np.bool_)
    if "reference" not in columns:
        return none, words
    far = _MOVED * step if step > 0.0 else 0.05 * float(np.nanmax(np.abs(np.diff(columns["reference"])))) * FROZEN / dt
    for begin, end in stretches(np.concatenate([[False], np.diff(position) == 0.0])):
        asked = columns["reference"][begin:end]
        if (end - begin) * dt > FROZEN and np.any(np.isfinite(asked)) and np.nanmax(asked) - np.nanmin(asked) > far > 0:
            none[begin - 1 : end] = True
    return none, words


def _ran_away(columns: dict[str, Array]) -> tuple[Rows, str]:
    """A command far beyond any current that ever flowed: the loop is lost, and what follows is not its motion."""
    words = f"the command exceeds {AWAY:g} times the largest current, the loop is lost"
    if "command" not in columns or "current" not in columns:
        return np.zeros(len(columns["position"]), dtype=np.bool_), words
    command, current = np.abs(np.nan_to_num(columns["command"])), np.abs(np.nan_to_num(columns["current"]))
    largest = float(current.max(initial=0.0))
    return np.cumsum((command > AWAY * largest) & (largest > 0.0)) > 0, words


def _plateau(columns: dict[str, Array], limit: float) -> list[str]:
    """A current that stands at its largest value while more is asked for: a limit that nobody told of."""
    if "command" not in columns or "current" not in columns:
        return []
    current, command = np.abs(np.nan_to_num(columns["current"])), np.abs(np.nan_to_num(columns["command"]))
    largest = float(current.max(initial=0.0))
    if largest == 0.0 or largest > 0.99 * limit:
        return []
    cut = (current > _TOP * largest) & (command > 1.05 * largest)
    rows = sum(end - begin for begin, end in stretches(cut) if end - begin >= _PLATEAU)
    if not rows:
        return []
    return [
        f"its current stands at {largest:.4g} A in {rows} rows while the command asks for more: a limit not told of"
    ]


def stretches(rows: Rows) -> list[tuple[int, int]]:
    """Begin and end (beyond) of all stretches of true rows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def filled(column: Array) -> Array:
    """A column with its gaps bridged by straight lines; all zero where it has no number."""
    sound = np.isfinite(column)
    if np.all(sound):
        return column
    if not np.any(sound):
        return np.zeros(len(column))
    at = np.arange(len(column), dtype=np.float64)
    return np.asarray(np.interp(at, at[sound], column[sound]), dtype=np.float64)
