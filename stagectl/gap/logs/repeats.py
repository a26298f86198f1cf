"""Repeats of one experiment: of one length, of one reference, each standing in for what another has lost of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.grid import Gridded
from stagectl.gap.logs.session import Array, GapError
from stagectl.gap.logs.sources import Found

ALIKE = 1e-3  # share of its range by which a repeated reference or injection may differ
HALF = 0.5  # of the longest repeat: a shorter one is left out, so that the others keep their rows


class Repeat(NamedTuple):
    """A log and its rows on the control periods."""

    log: Found
    grid: Gridded


def alike(repeats: list[Repeat]) -> tuple[list[Repeat], list[str]]:
    """All `repeats`, those of one experiment cut to their common length and their gaps of the reference filled.

    Raises GapError where repeats of one experiment are not of the same reference or injection.
    """
    kept: dict[str, Repeat] = {}
    notes = []
    for name in dict.fromkeys(one.log.experiment for one in repeats):
        members, said = _cut([one for one in repeats if one.log.experiment == name])
        notes += said
        for what in ("reference", "injection"):
            members = _same(members, what)
        kept |= {one.log.name: one for one in members}
    return [kept[one.log.name] for one in repeats if one.log.name in kept], notes


def _rows(one: Repeat) -> int:
    return len(one.grid.columns["position"])


def _cut(members: list[Repeat]) -> tuple[list[Repeat], list[str]]:
    """The repeats as long as the shortest of them, but for those that ended long before."""
    longest = max(map(_rows, members))
    enough = [one for one in members if _rows(one) >= HALF * longest]
    notes = [
        f"{one.log.name} is left out: it has {_rows(one)} rows, another repeat of {one.log.experiment} has {longest}"
        for one in members
        if one not in enough
    ]
    shortest = min(enough, key=_rows)
    if _rows(shortest) < longest:
        notes.append(
            f"repeats of {shortest.log.experiment} have {_rows(shortest)} to {longest} rows: all are cut to "
            f"{_rows(shortest)}, the length of {shortest.log.name}"
        )
    return [_shortened(one, _rows(shortest)) for one in enough], notes


def _shortened(one: Repeat, rows: int) -> Repeat:
    columns = {name: column[:rows] for name, column in one.grid.columns.items()}
    return one._replace(grid=one.grid._replace(columns=columns))


def _same(members: list[Repeat], what: str) -> list[Repeat]:
    """Check that all have the same reference or injection; a gap takes what another repeat has there."""
    having = [one for one in members if what in one.grid.columns]
    if what == "injection" and 0 < len(having) < len(members):
        without = next(one for one in members if one not in having)
        raise GapError(
            f"{having[0].log.name} has an injection, {without.log.name} of the same experiment has none; give it an "
            "experiment of its own"
        )
    if len(having) < 2:
        return members
    first = having[0].grid.columns[what]
    known = first.copy()
    offsets = {}
    for one in having:
        column = one.grid.columns[what]
        offset = _offset(first, column) if what == "reference" else 0.0  # relative to where the axis stood
        _check(what, (having[0], one), column - offset)
        known = np.where(np.isnan(known), column - offset, known)
        offsets[one.log.name] = offset
    return [_filled(one, what, known + offsets[one.log.name]) if what in one.grid.columns else one for one in members]


def _offset(first: Array, other: Array) -> float:
    both = np.isfinite(first) & np.isfinite(other)
    return float(np.median(other[both] - first[both])) if np.any(both) else 0.0


def _check(what: str, pair: tuple[Repeat, Repeat], other: Array) -> None:
    first = pair[0].grid.columns[what]
    apart = np.nan_to_num(np.abs(other - first))
    if not np.any(apart):
        return
    allowed = ALIKE * (float(np.nanmax(first) - np.nanmin(first)) or float(np.nanmax(np.abs(first))))
    if float(apart.max()) > allowed:
        row = int(np.argmax(apart))
        raise GapError(
            f"the {what} of {pair[1].log.name} differs from that of {pair[0].log.name} by up to {apart[row]:.3g} at "
            f"{row * pair[0].grid.dt:.6g} s; repeats of one experiment ({pair[0].log.experiment}) may differ by "
            f"{allowed:.3g}: give it an experiment of its own"
        )


def _filled(one: Repeat, what: str, known: Array) -> Repeat:
    """The gaps of one repeat's column from what is known of it."""
    column = one.grid.columns[what]
    lost = np.isnan(column) & np.isfinite(known)
    if not one.grid.exact or not np.any(lost):
        return one
    grid = one.grid._replace(columns={**one.grid.columns, what: np.where(lost, known, column)})
    if what == "reference":
        time, reference = grid.samples
        beyond = time > (len(column) - 0.5) * grid.dt
        added = np.flatnonzero(np.isfinite(grid.columns[what]))
        time = np.concatenate([grid.dt * added, time[beyond]])
        grid = grid._replace(samples=(time, np.concatenate([grid.columns[what][added], reference[beyond]])))
    return one._replace(grid=grid)
