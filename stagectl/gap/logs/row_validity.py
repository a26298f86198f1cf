"""Which rows of a log must not count: gaps, saturation, faults; each with a note."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.logs import thresholds
from stagectl.gap.logs.session import Array
from stagectl.number_format import duration, percent
from stagectl.recording.true_rows import stretches

Rows = NDArray[np.bool_]
Excluded = tuple[Rows, str]  # rows (n,) that do not count, and why


def row_validity(columns: dict[str, Array], dt: float, limit: float, step: float) -> tuple[Rows, list[str]]:
    """The rows (n,) of a log that count, and notes on the others.

    `limit` (A) is the largest known current, `step` that of the encoder (rad | m).
    """
    valid = np.ones(len(columns["position"]), dtype=np.bool_)
    notes: list[str] = []
    for rows, words in _exclusions(columns, dt, limit, step):
        if np.any(rows):
            share = float(np.mean(rows))
            notes.append(f"{words} (from {float(np.argmax(rows)) * dt:.6g} s, {percent(share)} of it): not used")
            valid &= ~rows
    return valid, notes + _plateau(columns, limit)


def _exclusions(columns: dict[str, Array], dt: float, limit: float, step: float) -> Iterator[Excluded]:
    count = len(columns["position"])
    yield _missing(columns)
    if "reference" in columns:
        yield _reference_gap(columns["reference"], dt)
    command = columns.get("command", np.zeros(count))
    yield (np.abs(command) > limit, f"the command exceeds the limit of {limit:g} A")
    fault = columns.get("fault", np.zeros(count))
    yield (np.cumsum(np.nan_to_num(fault) != 0.0) > 0, "a fault stopped the run")
    if "command" in columns and "current" in columns:
        yield _switched_off(columns, dt)
    if "reference" in columns:
        yield _frozen(columns, dt, step)
    if "command" in columns and "current" in columns:
        yield _run_away(columns)


def _sizes(columns: dict[str, Array]) -> tuple[Array, Array]:
    """(n,) A, sizes of command and current."""
    return np.abs(np.nan_to_num(columns["command"])), np.abs(np.nan_to_num(columns["current"]))


def _missing(columns: dict[str, Array]) -> Excluded:
    """Rows without a number in a column that has some."""
    absent = np.zeros(len(columns["position"]), dtype=np.bool_)
    empty = []
    for name in ("position", "command", "current"):
        if name in columns and np.any(lost := np.isnan(columns[name])):
            absent |= lost
            empty.append(name)
    return absent, f"rows without {' and '.join(empty)}"


def _reference_gap(reference: Array, dt: float) -> Excluded:
    """A longer gap: neither the reference in it is known, nor the loop's state after it."""
    rows = np.zeros(len(reference), dtype=np.bool_)
    for begin, end in stretches(np.isnan(reference)):
        if (end - begin) * dt > thresholds.BRIDGED:
            rows[begin : end + round(thresholds.LOOP_SETTLED / dt)] = True
    return rows, f"a gap of the reference, and {duration(thresholds.LOOP_SETTLED)} after it"


def _switched_off(columns: dict[str, Array], dt: float) -> Excluded:
    """No current under a command, to the end."""
    command, current = _sizes(columns)
    rows = np.zeros(len(command), dtype=np.bool_)
    flowing = np.flatnonzero(current > thresholds.NO_CURRENT * current.max(initial=0.0))
    begin = int(flowing[-1]) + 1 if flowing.size else len(rows)
    if (len(rows) - begin) * dt > thresholds.SWITCHED_OFF and np.median(
        command[begin:]
    ) > thresholds.COMMANDED * command.max():
        rows[begin:] = True
    return rows, "no current flows although the controller commands it, as after a fault of the drive"


def _frozen(columns: dict[str, Array], dt: float, step: float) -> Excluded:
    """The position does not change while the reference moves far."""
    position, reference = columns["position"], columns["reference"]
    rows = np.zeros(len(position), dtype=np.bool_)
    fastest = 0.0 if step > 0.0 else thresholds.FROZEN_SPEED * float(np.nanmax(np.abs(np.diff(reference))))
    far = thresholds.FROZEN_MOTION * step if step > 0.0 else fastest * thresholds.FROZEN / dt
    for begin, end in stretches(np.concatenate([[False], np.diff(position) == 0.0])):
        part = reference[begin:end]
        if (
            (end - begin) * dt > thresholds.FROZEN
            and np.any(np.isfinite(part))
            and np.nanmax(part) - np.nanmin(part) > far > 0
        ):
            rows[begin - 1 : end] = True
    return rows, "the position stays the same while the reference moves"


def _run_away(columns: dict[str, Array]) -> Excluded:
    """A command far beyond any measured current: control is lost, and the motion is no longer that of the loop."""
    command, current = _sizes(columns)
    largest = float(current.max(initial=0.0))
    words = f"the command exceeds {thresholds.RUN_AWAY:g} times the largest current: the loop has lost control"
    return np.cumsum((command > thresholds.RUN_AWAY * largest) & (largest > 0.0)) > 0, words


def _plateau(columns: dict[str, Array], limit: float) -> list[str]:
    """A note on a current that stays at its largest value under a larger command: a limit that is not described."""
    if "command" not in columns or "current" not in columns:
        return []
    command, current = _sizes(columns)
    largest = float(current.max(initial=0.0))
    if largest == 0.0 or largest > thresholds.KNOWN_LIMIT * limit:
        return []
    cut = (current > thresholds.PLATEAU_CURRENT * largest) & (command > thresholds.PLATEAU_COMMAND * largest)
    rows = sum(end - begin for begin, end in stretches(cut) if end - begin >= thresholds.PLATEAU)
    if not rows:
        return []
    return [f"its current stays at {largest:.4g} A in {rows} rows under a larger command: a limit not described"]


def filled(column: Array) -> Array:
    """A column with its gaps bridged by straight lines; all zero where it has no number."""
    sound = np.isfinite(column)
    if np.all(sound):
        return column
    if not np.any(sound):
        return np.zeros(len(column))
    rows = np.arange(len(column), dtype=np.float64)
    return np.asarray(np.interp(rows, rows[sound], column[sound]), dtype=np.float64)
