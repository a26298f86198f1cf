"""CSV files as logs: a header of quantities and units, our own exports, or columns that the user names."""

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stagectl.problem import ProblemKind
from stagectl.recording.columns import (
    EXAMPLE,
    POSITIONS,
    Choice,
    Log,
    Stated,
    check_kind,
    check_once,
    choices,
    header_unit,
    meaning,
    of_choices,
    parsed,
    scales_by_unit,
)
from stagectl.recording.csv_layout import WORDS, Layout, layout
from stagectl.recording.csv_table import read_table
from stagectl.recording.hdf5 import RecordingError, quantities
from stagectl.recording.in_memory import header
from stagectl.recording.metadata import flat
from stagectl.recording.scales import Scales, read_values, scales_of_nominal, scales_of_stage
from stagectl.units import LINEAR, ROTARY, StageError

_KIND = ("stage.position_unit", "stage.kind")  # of nominal.yaml, which tell the kind of the axis; the first decides


def read(path: Path, stated: Stated, about: dict[str, Any]) -> Log:
    """The log in a CSV file; what is `stated` names its columns where the header does not, and scales that it lacks.

    Raises RecordingError, with file and row, where it cannot be understood.
    """
    nominal, chosen = _nominal(path, stated, about), choices(stated.columns)
    how = _headed(layout(path), chosen)
    if chosen:
        return _chosen(path, how, chosen, stated)
    names = how.names
    if not names:
        reason = (
            f"{path} has no header, its first row is numbers; say which of its {how.width} columns is which, counting "
            f"from 1: {EXAMPLE}"
        )
        raise RecordingError(reason, path, ProblemKind.MISSING)
    if how.skipped > 1 and not _says_all(how):
        raise RecordingError(f"{path} {_preamble(how)}", path, ProblemKind.MISSING)
    described = stated.scales or (scales_of_nominal(nominal, path.parent / "nominal.yaml") if nominal else None)
    scales = _scales(path, names, stated, described)
    _of_this_kind(path, names, scales)
    found, notes = _known(path, how, scales)
    table, cut = read_table(path, names, list(found), how, [name for name in found if found[name][0] == "time"])
    # In place: a long log has no room for a second array.
    columns = {ours: np.multiply(table[name], scale, out=table[name]) for name, (ours, scale) in found.items()}
    labels = {ours: name for name, (ours, _) in found.items()}
    notes = [*_skipped(how), *notes, *cut]
    return Log(path, scales, columns, notes, {**about, **({"nominal": nominal} if nominal else {})}, labels)


def _nominal(path: Path, stated: Stated, about: Mapping[str, Any]) -> dict[str, Any]:
    """The nominal.yaml of a log.  Raises RecordingError where its axis is of another kind than the stage's."""
    beside = path.parent / "nominal.yaml"
    nominal = about.get("nominal") or (read_values(beside) if beside.is_file() else {})
    said = [f"{key}: {flat(nominal)[key]}" for key in _KIND if flat(nominal).get(key)]
    if said and stated.setup is not None:
        check_kind(beside, said[0], scales_of_nominal(nominal, beside).kind, scales_of_stage(stated.setup))
    return dict(nominal)


def _headed(how: Layout, chosen: list[Choice]) -> Layout:
    """The first line is the header where it has a known name or one of `chosen`, whatever follows it."""
    named = {choice.name for choice in chosen}
    if how.skipped > 1 and any(parsed(name) is not None or name in named for name in how.rows[0]):
        return how._replace(rows=how.rows[:1], skipped=1)
    return how


def _says_all(how: Layout) -> bool:
    """Whether the row just before the numbers names a time and a position with their units."""
    said = {about[0] for name in how.names if (about := parsed(name)) and about[1]}
    return "time" in said and not said.isdisjoint(POSITIONS)


def _skipped(how: Layout) -> list[str]:
    """What to note of rows before the header."""
    return [f"its first {how.skipped} rows are no numbers and are skipped"] if how.skipped > 1 else []


def _preamble(how: Layout) -> str:
    """What is wrong with a text whose header is not in its first row."""
    cells = " ".join(cell for row in how.rows for cell in row).lower()
    position = (
        "" if "pos" in cells else "none of them is named as a position, and a speed or a force does not replace it; "
    )
    return (
        f"has no header in row 1: its numbers begin in row {how.skipped + 1}, and row {how.skipped} looks like the "
        f"header ({', '.join(name for name in how.names if name)}), separated by {WORDS[how.separator]}; {position}"
        f"it must have a time and a position: say which of its {how.width} columns they are, counting from 1 "
        f"({EXAMPLE}), and the rows before the numbers are skipped"
    )


def _chosen(path: Path, how: Layout, chosen: list[Choice], stated: Stated) -> Log:
    units = (choice.unit or header_unit(how.name(_column(path, how, choice))) for choice in chosen)
    chosen = [choice._replace(unit=unit) for choice, unit in zip(chosen, units, strict=True)]
    scales, found = of_choices(chosen, stated, path)
    places = {ours: (_column(path, how, choice), scale) for ours, (choice, scale) in found.items()}
    if how.stamped(at := places["time"][0]):  # whatever unit is named, they are read in s
        places["time"] = (at, 1.0)
    check_once(path, {found[ours][0].quantity: (at, f"column {at + 1}") for ours, (at, _) in places.items()})
    labels = [f"column {number}" for number in range(1, how.width + 1)]
    times = [labels[places["time"][0]]]
    table, cut = read_table(path, labels, [labels[at] for at, _ in places.values()], how, times)
    columns = {ours: scale * table[labels[at]] for ours, (at, scale) in places.items()}
    others = [_other_unit(how, at, found[ours], scales) for ours, (at, _) in places.items()]
    notes = [*_skipped(how), *filter(None, others)]
    labelled = {ours: how.name(at) or labels[at] for ours, (at, _) in places.items()}
    return Log(path, scales, columns, [*notes, *cut], {}, labelled)


def _other_unit(how: Layout, at: int, taken: tuple[Choice, float], scales: Scales) -> str:
    """What to note where column `at` has another unit by its header than by the choice; empty where it has none."""
    choice, scale = taken
    said = header_unit(how.name(at))
    with contextlib.suppress(StageError):  # a unit that the axis cannot have is another one, too
        if not said or choice.sign * meaning(choice.quantity, said, scales)[1] == scale:
            return ""
    return f"{how.name(at)} is read in {choice.unit}: its header says {said}"


def _column(path: Path, how: Layout, choice: Choice) -> int:
    """The index of a column, from its name or its number."""
    names, count, place = how.names, how.width, choice.place
    if place in names:
        return names.index(place)
    if not place.isdecimal():
        there = (
            f"its columns are {', '.join(names)}" if names else f"it has no header, so give a number from 1 to {count}"
        )
        reason = f"{path} has no column {place} for the {choice.quantity}: {there}"
        raise RecordingError(reason, path, ProblemKind.UNKNOWN, column=place)
    if not 1 <= int(place) <= count:
        reason = f"column {place} of {path}; must be 1 to {count}, the first is 1"
        raise RecordingError(reason, path, ProblemKind.UNKNOWN, column=place)
    return int(place) - 1


def _scales(path: Path, names: list[str], stated: Stated, nominal: Scales | None) -> Scales:
    """From the stage file, else from what describes the machine or by the unit of the position, with what is known."""
    if stated.setup is not None:
        return scales_of_stage(stated.setup, nominal.amplifier if nominal else 0.0)
    if nominal is not None:
        return stated.known.on(nominal)
    units = (about[1] for name in names if (about := parsed(name)) and about[0] in POSITIONS)
    return stated.known.on(scales_by_unit(units, path))


def _known(path: Path, how: Layout, scales: Scales) -> tuple[dict[str, tuple[str, float]], list[str]]:
    """Columns that are understood: (ours, factor); and a note for each that is left out."""
    names, named = how.names, [parsed(name) or ("", "") for name in how.names]
    own, notes = _without_a_unit(how, scales), []
    known: dict[str, tuple[str, float]] = {}
    of_motor = any(quantity in POSITIONS[:-1] for quantity, _ in named)
    for name, (quantity, unit) in zip(names, named, strict=True):
        if of_motor and quantity == POSITIONS[-1]:
            notes.append(f"{name} is left out: it is the load's, and the position is taken from the motor")
            continue
        try:
            found = own.get(name) or (meaning(quantity, unit, scales) if unit else None)
        except StageError as error:
            if quantity in ("time", *POSITIONS):
                raise RecordingError(f"{name} in {path}: {error}", path, ProblemKind.UNIT, column=name) from error
            notes.append(f"{name} is left out: {error}")
            continue
        if found is None:
            notes.append(f"{name or 'a column without a name'} is left out: it is not a quantity with a known unit")
        elif found[0] in [ours for ours, _ in known.values()]:
            reason = f"{path} has two columns for {found[0]}, the second is {name}: remove one"
            raise RecordingError(reason, path, ProblemKind.REPEATED, column=found[0])
        else:
            known[name] = found
    absent = {"time", "measured"} - {ours for ours, _ in known.values()}
    if absent:
        reason = (
            f"{path} has the columns {', '.join(names)}; it must have time_s and a position_<unit>, or say "
            "which they are: --columns time=NAME,position=NAME:mm"
        )
        raise RecordingError(reason, path, ProblemKind.MISSING, column=sorted(absent)[0])
    return known, notes


def _without_a_unit(how: Layout, scales: Scales) -> dict[str, tuple[str, float]]:
    """What needs no unit: all columns of our own export; of another log a time that is stamped, which is read in s."""
    own = {header(name, quantity.unit_for(scales.kind)): (name, 1.0) for name, quantity in quantities().items()}
    if ("measured", 1.0) in map(own.get, how.names):
        return own
    times = [name for at, name in enumerate(how.names) if (parsed(name) or ("",))[0] == "time" and how.stamped(at)]
    return dict.fromkeys(times, ("time", 1.0))


def _of_this_kind(path: Path, names: list[str], scales: Scales) -> None:
    """Raise RecordingError where our own export is of the other kind of axis."""
    kind, unit = (LINEAR, "m") if scales.kind == ROTARY else (ROTARY, "rad")
    if (name := header("measured", unit)) in names:
        check_kind(path, name, kind, scales)
