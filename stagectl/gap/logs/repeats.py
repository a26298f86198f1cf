"""Repeats of one experiment: brought to one length and checked for one reference; gaps filled from each other."""

from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.grid import GriddedLog, LoggedReference
from stagectl.gap.logs.session import Array, LogError
from stagectl.gap.logs.sources import RawLog
from stagectl.gap.logs.thresholds import LEAST_LENGTH, SAME_SIGNAL


class Repeat(NamedTuple):
    """A log and its rows on the control periods."""

    log: RawLog
    grid: GriddedLog


def reconciled(repeats: list[Repeat]) -> tuple[list[Repeat], list[str]]:
    """All `repeats`, those of one experiment cut to their common length, with gaps of the reference filled; and notes.

    Raises LogError where repeats of one experiment differ in reference or injection.
    """
    kept: dict[str, Repeat] = {}
    notes: list[str] = []
    for name in dict.fromkeys(repeat.log.experiment for repeat in repeats):
        members, cut_notes = _cut([repeat for repeat in repeats if repeat.log.experiment == name])
        notes += cut_notes
        for column in ("reference", "injection"):
            members = _with_common(members, column)
        kept |= {member.log.name: member for member in members}
    return [kept[repeat.log.name] for repeat in repeats if repeat.log.name in kept], notes


def _cut(members: list[Repeat]) -> tuple[list[Repeat], list[str]]:
    """The repeats as long as the shortest of them, without those that ended long before; and notes."""
    longest = max(member.grid.rows for member in members)
    enough = [member for member in members if member.grid.rows >= LEAST_LENGTH * longest]
    notes = [
        f"{member.log.name} is left out: it has {member.grid.rows} rows, another repeat of {member.log.experiment} "
        f"has {longest}"
        for member in members
        if member not in enough
    ]
    shortest = min(enough, key=lambda member: member.grid.rows)
    rows = shortest.grid.rows
    if rows < longest:
        notes.append(
            f"repeats of {shortest.log.experiment} have {rows} to {longest} rows: all are cut to {rows}, the length of "
            f"{shortest.log.name}"
        )
    return [_shortened(member, rows) for member in enough], notes


def _shortened(repeat: Repeat, rows: int) -> Repeat:
    columns = {name: column[:rows] for name, column in repeat.grid.columns.items()}
    return repeat._replace(grid=repeat.grid._replace(columns=columns))


def _with_common(members: list[Repeat], column: str) -> list[Repeat]:
    """Check that all have the same reference or injection; a gap takes what another repeat has there."""
    having = [member for member in members if column in member.grid.columns]
    if column == "injection" and 0 < len(having) < len(members):
        without = next(member for member in members if member not in having)
        raise LogError(
            "signal",
            (having[0].log.name, without.log.name),
            f"{having[0].log.name} has an injection, {without.log.name} of the same experiment has none; give it an "
            "experiment of its own",
        )
    if len(having) < 2:
        return members
    first = having[0].grid.columns[column]
    # A reference is relative to where the axis was at its start.
    offsets = {
        member.log.name: _offset(first, member.grid.columns[column]) if column == "reference" else 0.0
        for member in having
    }
    known = first.copy()
    for member in having:
        signal = member.grid.columns[column] - offsets[member.log.name]
        _check(column, having[0], member, signal)
        known = np.where(np.isnan(known), signal, known)
    return [
        _filled(member, column, known + offsets[member.log.name]) if member.log.name in offsets else member
        for member in members
    ]


def _offset(first: Array, other: Array) -> float:
    both = np.isfinite(first) & np.isfinite(other)
    return float(np.median(other[both] - first[both])) if np.any(both) else 0.0


def _check(column: str, first: Repeat, other: Repeat, signal: Array) -> None:
    """Raise LogError where the `signal` of `other`, without its offset, differs from that of the `first` repeat."""
    expected = first.grid.columns[column]
    apart = np.nan_to_num(np.abs(signal - expected))
    if not np.any(apart):
        return
    allowed = SAME_SIGNAL * (float(np.nanmax(expected) - np.nanmin(expected)) or float(np.nanmax(np.abs(expected))))
    if float(apart.max()) > allowed:
        row = int(np.argmax(apart))
        raise LogError(
            "signal",
            (other.log.name, first.log.name),
            f"the {column} of {other.log.name} differs from that of {first.log.name} by up to {apart[row]:.3g} at "
            f"{row * first.grid.dt:.6g} s; repeats of one experiment ({first.log.experiment}) may differ by "
            f"{allowed:.3g}: give it an experiment of its own",
        )


def _filled(repeat: Repeat, name: str, known: Array) -> Repeat:
    """One repeat with the gaps of the column `name` filled from what is `known` of it."""
    grid = repeat.grid
    column = grid.columns[name]
    lost = np.isnan(column) & np.isfinite(known)
    if not grid.exact or not np.any(lost):
        return repeat
    whole = np.where(lost, known, column)
    filled = grid._replace(columns={**grid.columns, name: whole})
    return repeat._replace(grid=filled._replace(reference=_extended(grid, whole)) if name == "reference" else filled)


def _extended(grid: GriddedLog, whole: Array) -> LoggedReference:
    """The reference `whole` (n,) at the control periods, and what was logged beyond them."""
    beyond = grid.reference.time > (len(whole) - 0.5) * grid.dt
    sound = np.flatnonzero(np.isfinite(whole))
    return LoggedReference(
        np.concatenate([grid.dt * sound, grid.reference.time[beyond]]),
        np.concatenate([whole[sound], grid.reference.value[beyond]]),
    )
