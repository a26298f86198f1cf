"""A log as it is, made fit to be read: every repair is one note, and no repair is made without one.

::

    rows without a number --> rows written twice --> rounded stamps --> stamps of two rows --> spikes --> wraps
    --> what is clipped (named)

A rounded clock hides equal spacing, and equal spacing can be recovered: row k was taken at ``start + k dt``, and no
stamp is further from it than one step of the clock.  Stamps that scatter by more are real instants and stay.

Two rows that differ and have one stamp cannot both be right, and the log does not say which is: a few of them are left
out, both.  Many are no slips of a clock, and stay: such a log has no times.

A spike is one row that leaves its neighbours and comes back: ``x - (x[k-1] + x[k+1])/2`` is large there, minus half as
large in the rows beside it, and small elsewhere.  One of a command that the current follows is real.  A wrap is a jump
that stays, as large as the counter's whole range, which the positions fill.
"""

import itertools
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from stagectl.number_format import duration
from stagectl.recording import constants
from stagectl.recording.clipping import clipped
from stagectl.recording.columns import Array, Log
from stagectl.units import unit_on

_POSITIONS = ("measured", "reference")
_EFFORTS = ("measured_current", "command")


def repaired(log: Log) -> Log:
    """The log on sound rows, with a note for all that was done to it."""
    log, notes = _with_position(log), list[str]()
    columns = _on_position_rows(log, notes)
    columns = _without_repeats(columns, notes)
    columns["time"] = recovered(columns["time"], notes)
    columns = _without_conflicts(columns, notes)
    columns = _without_spikes(log, columns, notes)
    _unwrap(log, columns, notes)
    _note_clipped(log, columns, notes)
    return log._replace(columns=columns, notes=[*log.notes, *notes])


def _with_position(log: Log) -> Log:
    """A log of a velocity with the position that is its integral."""
    if "measured" in log.columns or "velocity" not in log.columns:
        return log
    columns = {name: column for name, column in log.columns.items() if name != "velocity"}
    speed, steps = log.columns["velocity"], np.diff(log.columns["time"])
    way = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * steps)
    words = f"no position: it is the integral of {label(log, 'velocity')}, from 0"
    return log._replace(columns={**columns, "measured": np.concatenate([[0.0], way])}, notes=[*log.notes, words])


def label(log: Log, name: str) -> str:
    """The log's own name of our column `name`."""
    return log.labels.get(name, name)


def _on_position_rows(log: Log, notes: list[str]) -> dict[str, Array]:
    """Rows with a time and a position; columns that were sampled at other rows are interpolated."""
    sound = np.isfinite(log.columns["time"]) & np.isfinite(log.columns["measured"])
    count = int(np.count_nonzero(sound))
    if count == len(sound) or count < 2:
        return dict(log.columns)
    row, columns = int(np.argmin(sound)) + 1, {}
    words = f"{len(sound) - count} of {len(sound)} rows have no time or no position, the first is row {row}: left out"
    notes.append(words)
    for name, column in log.columns.items():
        columns[name] = column[sound]
        if name in _POSITIONS[:1] or np.mean(np.isfinite(columns[name])) >= 0.5:
            continue
        there = np.isfinite(column) & np.isfinite(log.columns["time"])
        if np.count_nonzero(there) > 1:
            columns[name] = np.interp(log.columns["time"][sound], log.columns["time"][there], column[there])
            notes.append(f"{label(log, name)} was sampled at other rows than the position: interpolated linearly")
    return columns


def _without_repeats(columns: dict[str, Array], notes: list[str]) -> dict[str, Array]:
    again = written_twice(columns["time"], {name: column for name, column in columns.items() if name != "time"})
    if not np.any(again):
        return columns
    first = float(columns["time"][int(np.argmax(again))] - columns["time"][0])
    words = f"{np.count_nonzero(again)} of {len(again)} rows repeat the row before them, the first at {first:.6g} s"
    notes.append(f"{words}: left out")
    return {name: column[~again] for name, column in columns.items()}


def _without_conflicts(columns: dict[str, Array], notes: list[str]) -> dict[str, Array]:
    time = columns["time"]
    same = np.diff(time) == 0.0
    bad = np.concatenate([[False], same]) | np.concatenate([same, [False]])
    if not np.any(bad) or np.count_nonzero(same) > constants.MOST_MISREAD * len(time):
        return columns
    words = f"{np.count_nonzero(bad)} of {len(time)} rows share their time with another row and differ from it"
    notes.append(f"{words}, the first at {time[int(np.argmax(bad))] - time[0]:.6g} s: left out")
    return {name: column[~bad] for name, column in columns.items()}


def _without_spikes(log: Log, columns: dict[str, Array], notes: list[str]) -> dict[str, Array]:
    time, bad = columns["time"], np.zeros(len(columns["time"]), dtype=np.bool_)
    present = [name for name in (*_POSITIONS, *_EFFORTS) if name in columns]
    found = {name: spikes(columns[name], name in _EFFORTS) for name in present}
    for name, rows in _unanswered(columns, found).items():
        if len(rows):
            bad[rows] = True
            notes.append(f"{label(log, name)} {_spike_words(time - time[0], rows)}")
    return {name: column[~bad] for name, column in columns.items()} if np.any(bad) else columns


def _unanswered(columns: Mapping[str, Array], found: Mapping[str, NDArray[np.intp]]) -> dict[str, NDArray[np.intp]]:
    """The spikes that were `found`, without those of a command that the current follows: these are real."""
    signed = {name: rows * np.sign(columns[name][rows]) for name, rows in found.items()}
    left = dict(found)
    for name, other in itertools.permutations([name for name in _EFFORTS if name in found], 2):
        apart = np.abs(signed[name][:, None] - signed[other])
        left[name] = found[name][~np.any(apart <= constants.ANSWER_ROWS, axis=1)]
    return left


def _spike_words(time: Array, rows: NDArray[np.intp]) -> str:
    shown = ", ".join(f"{time[row]:.6g} s" for row in rows[: constants.SHOWN_ROWS])
    more = f" and {len(rows) - constants.SHOWN_ROWS} more" if len(rows) > constants.SHOWN_ROWS else ""
    return f"has {len(rows)} single misread value{'s' if len(rows) > 1 else ''} (at {shown}{more}): left out"


def _unwrap(log: Log, columns: dict[str, Array], notes: list[str]) -> None:
    for name in _POSITIONS:
        if name in columns and (size := wrap_of(columns[name], log.scales.encoder_step)):
            wraps = int(np.count_nonzero(np.abs(np.diff(columns[name])) > 0.5 * size))
            columns[name] = unwrapped(columns[name], size)
            unit = unit_on(log.scales.kind, "rad | m")
            notes.append(f"{label(log, name)} wraps {wraps} times at {size:.6g} {unit}: unwrapped")


def _note_clipped(log: Log, columns: dict[str, Array], notes: list[str]) -> None:
    for name in _EFFORTS:
        column = columns.get(name, np.zeros(0))
        if len(column) < constants.JUDGED_ROWS or not np.all(np.isfinite(column)) or not len(rows := clipped(column)):
            continue
        first = float(columns["time"][rows[0]] - columns["time"][0])
        span = duration(float(len(rows)) * float(np.median(np.diff(columns["time"]))))
        notes.append(f"{label(log, name)} is clipped at {abs(column[rows[0]]):.4g} A for {span}, from {first:.6g} s on")


def spikes(column: Array, effort: bool) -> NDArray[np.intp]:
    """Rows of single spikes in `column` (n,); of an `effort` only those that no other value comes near."""
    if len(column) < constants.JUDGED_ROWS or not np.all(np.isfinite(column)):
        return np.zeros(0, dtype=np.intp)
    away = column[2:] + column[:-2]  # in place: a long log has little room
    away *= -0.5
    away += column[1:-1]
    limit = constants.SPIKE * max(_high(np.abs(away)), smallest_step(column))
    rows = np.flatnonzero((away > limit) | (away < -limit)) + 1
    rows = rows[(rows > 1) & (rows < len(column) - 2)]
    before, here, after = (away[rows - 1 + shift] for shift in (-1, 0, 1))
    back = np.maximum(np.abs(before + 0.5 * here), np.abs(after + 0.5 * here)) <= constants.SPIKE_FORM * np.abs(here)
    rows = rows[back]
    if effort:
        middle = float(np.median(column))
        rows = rows[np.abs(column[rows] - middle) > constants.SPIKE_EFFORT * _high(np.abs(column - middle))]
    return rows if len(rows) <= constants.MOST_MISREAD * len(column) else rows[:0]


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
    known = _known_range(estimate, usual, step or smallest_step(position))
    return known or (estimate if len(sizes) > 1 else 0.0)


def unwrapped(position: Array, size: float) -> Array:
    """The position (n,) without its wraps at a range of `size`."""
    turns = np.concatenate([[0.0], np.cumsum(-np.rint(np.diff(position) / size))])
    return np.asarray(position + size * turns, dtype=np.float64)


def _high(values: Array) -> float:
    """The usual size of `values`, of a long log from every so many rows."""
    return float(np.quantile(values[:: 1 + len(values) // constants.QUANTILE_ROWS], constants.USUAL))


def smallest_step(column: Array) -> float:
    """The smallest change of a column (n,) from row to row, within its first rows; 0 where it does not change."""
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


def written_twice(time: Array, columns: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Rows (n,) that repeat the row before them in every column; none where a rounded clock repeats its stamps."""
    again = np.concatenate([[False], time[1:] == time[:-1]])
    if not np.any(again):
        return again
    same = again.copy()
    for column in columns.values():
        same[1:] &= (column[1:] == column[:-1]) | ~np.isfinite(column[1:])
    if np.array_equal(same, again):
        distinct = any(np.any(np.diff(column)[~again[1:]] != 0.0) for column in columns.values())
    else:  # an axis at rest repeats its values
        distinct = recovered(time, []) is time
    return same if distinct else np.zeros(len(time), dtype=np.bool_)


def recovered(time: Array, notes: list[str]) -> Array:
    """The instants (n,) s behind rounded stamps, noted; the stamps themselves where they are not rounded."""
    steps = np.diff(time)
    if len(time) < constants.JUDGED_ROWS or not np.all(steps >= 0.0) or _even(steps):
        return time
    clock = float(np.min(steps[steps > 0.0], initial=np.inf))
    exact = float(np.mean(np.abs(steps - clock) > constants.CLOCK_DIGITS * clock)) < constants.LOST_ROWS
    if exact or not _multiples(steps, clock):
        return time
    instants, dt = _on_grid(time, steps, clock)
    if dt <= 0.0 or float(np.max(np.abs(instants - time))) > constants.CLOCK_ERROR * clock:
        return time
    words = f"time stamps are rounded to {duration(clock)}: rows are taken every {duration(dt)}, as their number shows"
    notes.append(words)
    return instants


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
