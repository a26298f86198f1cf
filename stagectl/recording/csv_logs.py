"""CSV files as logs: a header of quantities and units, our own exports, or columns that the user names."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.extras import arrow
from stagectl.problem import ProblemKind, why_unread
from stagectl.recording.columns import (
    EXAMPLE,
    POSITIONS,
    Array,
    Choice,
    Log,
    check_kind,
    check_once,
    choices,
    header_unit,
    meaning,
    of_choices,
    parsed,
    scales_by_unit,
)
from stagectl.recording.csv_layout import WORDS, Layout, last_rows, layout
from stagectl.recording.exports import header
from stagectl.recording.hdf5 import RecordingError, quantities
from stagectl.recording.scales import Scales, read_values, scales_of_nominal, scales_of_stage
from stagectl.units import LINEAR, ROTARY, StageError

_NO_NUMBER = re.compile(r"column #(\d+): Row #(\d+): .* invalid value ('.*')", re.DOTALL)
_WIDTH = re.compile(r"Row #(\d+): Expected (\d+) columns, got (\d+): (.*)", re.DOTALL)


def read(
    path: Path,
    setup: Setup | None,
    about: dict[str, Any],
    words: Mapping[str, str] | None = None,
    scales: Scales | None = None,
) -> Log:
    """The log in a CSV file; `words` name its columns where the header does not.

    Raises RecordingError, with file and row, where it cannot be understood.
    """
    how = _headed(layout(path), choices(words))
    if words:
        return _chosen(path, how, scales or (scales_of_stage(setup) if setup else None), choices(words))
    names = how.names
    if not names:
        reason = (
            f"{path} has no header, its first row is numbers; say which of its {how.width} columns is which, counting "
            f"from 1: {EXAMPLE}"
        )
        raise RecordingError(reason, path, ProblemKind.MISSING)
    if how.skipped > 1:
        raise RecordingError(f"{path} {_preamble(how)}", path, ProblemKind.MISSING)
    beside = path.parent / "nominal.yaml"
    nominal = about.get("nominal") or (read_values(beside) if beside.is_file() else {})
    described = scales or (scales_of_nominal(nominal, beside) if nominal else None)
    scales = _scales(path, names, setup, described)
    _of_this_kind(path, names, scales)
    known, notes = _known(path, names, scales)
    table, cut = read_table(path, names, list(known), how)
    columns = {ours: _scaled(table.pop(name), scale) for name, (ours, scale) in known.items()}
    labels = {ours: name for name, (ours, _) in known.items()}
    return Log(path, scales, columns, [*notes, *cut], {**about, **({"nominal": nominal} if nominal else {})}, labels)


def _headed(how: Layout, chosen: list[Choice]) -> Layout:
    """The first line is the header where it has a known name or one of `chosen`, whatever follows it."""
    named = {choice.name for choice in chosen}
    if how.skipped > 1 and any(parsed(name) is not None or name in named for name in how.rows[0]):
        return how._replace(rows=how.rows[:1], skipped=1)
    return how


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


def _chosen(path: Path, how: Layout, taken: Scales | None, chosen: list[Choice]) -> Log:
    chosen = [_with_unit(choice, how, _column(path, how, choice)) for choice in chosen]
    scales, known = of_choices(chosen, taken, path)
    places = {ours: (_column(path, how, choice), scale) for ours, (choice, scale) in known.items()}
    check_once(path, {known[ours][0].quantity: (at, f"column {at + 1}") for ours, (at, _) in places.items()})
    labels = [f"column {number}" for number in range(1, how.width + 1)]
    table, cut = read_table(path, labels, [labels[at] for at, _ in places.values()], how)
    columns = {ours: scale * table[labels[at]] for ours, (at, scale) in places.items()}
    notes = [f"its first {how.skipped} rows are no numbers and are skipped"] if how.skipped > 1 else []
    labelled = {ours: how.names[at] if at < len(how.names) else labels[at] for ours, (at, _) in places.items()}
    return Log(path, scales, columns, [*notes, *cut], {}, labelled)


def _with_unit(choice: Choice, how: Layout, at: int) -> Choice:
    """The choice of a column with the unit that its header says, where the choice says none."""
    return choice._replace(unit=choice.unit or (header_unit(how.names[at]) if at < len(how.names) else ""))


def _column(path: Path, how: Layout, choice: Choice) -> int:
    """The index of a column, from its name or its number."""
    names, count = how.names, how.width
    if choice.name in names:
        return names.index(choice.name)
    if not choice.name.isdecimal():
        there = (
            f"its columns are {', '.join(names)}" if names else f"it has no header, so give a number from 1 to {count}"
        )
        reason = f"{path} has no column {choice.name} for the {choice.quantity}: {there}"
        raise RecordingError(reason, path, ProblemKind.UNKNOWN, column=choice.name)
    if not 1 <= int(choice.name) <= count:
        reason = f"column {choice.name} of {path}; must be 1 to {count}, the first is 1"
        raise RecordingError(reason, path, ProblemKind.UNKNOWN, column=choice.name)
    return int(choice.name) - 1


def _scales(path: Path, names: list[str], setup: Setup | None, nominal: Scales | None) -> Scales:
    """From the stage file, else from nominal.yaml, else by the unit of the position."""
    if setup is not None:
        return scales_of_stage(setup, nominal.amplifier if nominal else 0.0)
    if nominal is not None:
        return nominal
    return scales_by_unit((about[1] for name in names if (about := parsed(name)) and about[0] in POSITIONS), path)


def _known(path: Path, names: list[str], scales: Scales) -> tuple[dict[str, tuple[str, float]], list[str]]:
    """Columns that are understood: (ours, factor); and a note for each that is left out."""
    own = {header(name, quantity.unit_for(scales.kind)): name for name, quantity in quantities().items()}
    exported = any(own.get(name) == "measured" for name in names)  # our own export, all columns
    known: dict[str, tuple[str, float]] = {}
    notes = []
    own_position = any((about := parsed(name)) and about[0] in POSITIONS[:-1] for name in names)
    for name in names:
        if own_position and (about := parsed(name)) and about[0] == POSITIONS[-1]:
            notes.append(f"{name} is left out: it is the load's, and the position is taken from the motor")
            continue
        try:
            ours_and_factor = (own[name], 1.0) if exported and name in own else _meaning(name, scales)
        except StageError as error:
            if name.startswith(("time_", "position_", "motor_position_", "load_position_")):
                raise RecordingError(f"{name} in {path}: {error}", path, ProblemKind.UNIT, column=name) from error
            notes.append(f"{name} is left out: {error}")
            continue
        if ours_and_factor is None:
            notes.append(f"{name or 'a column without a name'} is left out: it is not a quantity with a known unit")
        elif ours_and_factor[0] in [ours for ours, _ in known.values()]:
            reason = f"{path} has two columns for {ours_and_factor[0]}, the second is {name}: remove one"
            raise RecordingError(reason, path, ProblemKind.REPEATED, column=ours_and_factor[0])
        else:
            known[name] = ours_and_factor
    absent = {"time", "measured"} - {ours for ours, _ in known.values()}
    if absent:
        reason = (
            f"{path} has the columns {', '.join(names)}; it must have time_s and a position_<unit>, or say which are "
            "they: --columns time=NAME,position=NAME:mm"
        )
        raise RecordingError(reason, path, ProblemKind.MISSING, column=sorted(absent)[0])
    return known, notes


def _of_this_kind(path: Path, names: list[str], scales: Scales) -> None:
    """Raise RecordingError where our own export is of the other kind of axis."""
    kind, unit = (LINEAR, "m") if scales.kind == ROTARY else (ROTARY, "rad")
    if (name := header("measured", unit)) in names:
        check_kind(path, name, kind, scales)


def _meaning(name: str, scales: Scales) -> tuple[str, float] | None:
    header_parts = parsed(name)
    return meaning(*header_parts, scales) if header_parts and header_parts[1] else None


def _scaled(column: Array, scale: float) -> Array:
    """The same array, scaled: a long log has no room for a second one."""
    column *= scale
    return column


@contextlib.contextmanager
def _in_words(path: Path, causes: tuple[type[Exception], ...]) -> Iterator[None]:
    """Turn what the CSV reader says into file, row, column and text."""
    try:
        yield
    except causes as cause:
        words = why_unread(cause)
        if value := _NO_NUMBER.search(words):
            column, row, text = int(value[1]) + 1, value[2], value[3]
            date = ", and a date is no time: times are in s" if len(re.findall(r"[-:/.]", text)) > 2 else ""
            words = f"row {row}, column {column}: {text} is no number{date}"
        elif width := _WIDTH.search(words):
            row, wanted, found, text = width.groups()
            words = f"row {row} has {found} columns, not {wanted}: {text}; decimal commas need another separator"
        raise RecordingError(f"{path}: {words}; correct the row or remove it", path, ProblemKind.VALUE) from cause


def read_table(
    path: Path, names: list[str], wanted: list[str], how: Layout, most: int = 0
) -> tuple[dict[str, Array], list[str]]:
    """The wanted columns, (n,) each, an empty cell is NaN; and a note on lines that end the file without being rows.

    Of a file longer than `most` bytes only the rows within these; 0 takes all of it.
    """
    reading = arrow().csv.ReadOptions(use_threads=False, column_names=names, skip_rows=how.skipped)
    converting = arrow().csv.ConvertOptions(
        column_types=dict.fromkeys(wanted, arrow().float64()),
        include_columns=list(dict.fromkeys(wanted)),
        decimal_point=how.decimal,
    )
    parsing = arrow().csv.ParseOptions(delimiter=how.separator)
    causes = (arrow().ArrowInvalid, arrow().ArrowKeyError, OSError)
    end = last_rows(path, how, most)
    with _in_words(path, causes):
        with path.open("rb") as file:  # of a whole file no more than a block is in memory
            source = file if end.length == path.stat().st_size else arrow().BufferReader(file.read(end.length))
            table = arrow().csv.read_csv(source, reading, parsing, converting)
        columns = {}
        for name in dict.fromkeys(wanted):  # one column at a time: a long log is in memory once
            columns[name] = np.require(table[name].to_numpy(), np.float64, "W")
            table = table.drop_columns([name])
            arrow().default_memory_pool().release_unused()
    return columns, [end.note] if end.note else []
