"""A log as it is, made fit to be read: every repair is one note, and no repair is made without one.

::

    rows without a number --> rows written twice --> rounded stamps --> spikes --> wraps --> what is clipped (named)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stagectl.number_format import duration
from stagectl.recording import constants
from stagectl.recording.clipping import clipped
from stagectl.recording.columns import Array, Log
from stagectl.recording.misread_values import spikes, unwrapped, wrap_of
from stagectl.recording.time_stamps import recovered, written_twice
from stagectl.units import ROTARY

_POSITIONS = ("measured", "reference")
_EFFORTS = ("measured_current", "command")


def repaired(log: Log) -> Log:
    """The log on sound rows, with a note for all that was done to it."""
    log = _with_position(log)
    columns, notes = _on_position_rows(log)
    columns, notes = _without_repeats(columns, notes)
    columns["time"], words = recovered(columns["time"])
    notes += [words] if words else []
    columns, notes = _without_spikes(log, columns, notes)
    notes += _unwrap(log, columns)
    notes += _clipped_notes(log, columns)
    return log._replace(columns=columns, notes=notes)


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


def _on_position_rows(log: Log) -> tuple[dict[str, Array], list[str]]:
    """Rows with a time and a position; columns that were sampled at other rows are interpolated."""
    sound = np.isfinite(log.columns["time"]) & np.isfinite(log.columns["measured"])
    count = int(np.count_nonzero(sound))
    if count == len(sound) or count < 2:
        return dict(log.columns), [*log.notes]
    columns, notes = {}, []
    for name, column in log.columns.items():
        columns[name] = column[sound]
        if name in _POSITIONS[:1] or np.mean(np.isfinite(columns[name])) >= 0.5:
            continue
        there = np.isfinite(column) & np.isfinite(log.columns["time"])
        if np.count_nonzero(there) > 1:
            columns[name] = np.interp(log.columns["time"][sound], log.columns["time"][there], column[there])
            notes.append(f"{label(log, name)} was sampled at other rows than the position: interpolated linearly")
    row = int(np.argmin(sound)) + 1
    words = f"{len(sound) - count} of {len(sound)} rows have no time or no position, the first is row {row}: left out"
    return columns, [*log.notes, words, *notes]


def _without_repeats(columns: dict[str, Array], notes: list[str]) -> tuple[dict[str, Array], list[str]]:
    again = written_twice(columns["time"], {name: column for name, column in columns.items() if name != "time"})
    if not np.any(again):
        return columns, notes
    words = f"{np.count_nonzero(again)} of {len(again)} rows repeat the row before them: left out"
    return {name: column[~again] for name, column in columns.items()}, [*notes, words]


def _without_spikes(log: Log, columns: dict[str, Array], notes: list[str]) -> tuple[dict[str, Array], list[str]]:
    time, bad = columns["time"], np.zeros(len(columns["time"]), dtype=np.bool_)
    for name in (*_POSITIONS, *_EFFORTS):
        if name in columns and len(rows := spikes(columns[name], name in _EFFORTS)):
            bad[rows] = True
            notes = [*notes, f"{label(log, name)} {_spike_words(time - time[0], rows)}"]
    return ({name: column[~bad] for name, column in columns.items()} if np.any(bad) else columns), notes


def _spike_words(time: Array, rows: NDArray[np.intp]) -> str:
    shown = ", ".join(f"{time[row]:.6g} s" for row in rows[: constants.SHOWN_ROWS])
    more = f" and {len(rows) - constants.SHOWN_ROWS} more" if len(rows) > constants.SHOWN_ROWS else ""
    return f"has {len(rows)} single misread value{'s' if len(rows) > 1 else ''} (at {shown}{more}): left out"


def _unwrap(log: Log, columns: dict[str, Array]) -> list[str]:
    notes = []
    for name in _POSITIONS:
        if name in columns and (size := wrap_of(columns[name], log.scales.encoder_step)):
            wraps = int(np.count_nonzero(np.abs(np.diff(columns[name])) > 0.5 * size))
            columns[name] = unwrapped(columns[name], size)
            unit = "rad" if log.scales.kind == ROTARY else "m"
            notes.append(f"{label(log, name)} wraps {wraps} times at {size:.6g} {unit}: unwrapped")
    return notes


def _clipped_notes(log: Log, columns: dict[str, Array]) -> list[str]:
    notes = []
    for name in _EFFORTS:
        column = columns.get(name, np.zeros(0))
        if len(column) < constants.JUDGED_ROWS or not np.all(np.isfinite(column)) or not len(rows := clipped(column)):
            continue
        first = float(columns["time"][rows[0]] - columns["time"][0])
        span = duration(float(len(rows)) * float(np.median(np.diff(columns["time"]))))
        notes.append(f"{label(log, name)} is clipped at {abs(column[rows[0]]):.4g} A for {span}, from {first:.6g} s on")
    return notes
