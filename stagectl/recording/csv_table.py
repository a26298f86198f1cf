"""The numbers of a CSV text, column by column, and where one of them is none."""

import contextlib
import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from stagectl.extras import arrow
from stagectl.problem import Problem, ProblemKind, why_unread
from stagectl.recording import time_stamps
from stagectl.recording.columns import Array
from stagectl.recording.csv_layout import SPACES, End, Layout, last_rows
from stagectl.recording.hdf5 import RecordingError

_NO_NUMBER = re.compile(r"column #(\d+): Row #(\d+): .* (?:invalid value|zone offset in) '(.*?)'(?:\.|$)", re.DOTALL)
_WIDTH = re.compile(r"Row #(\d+): Expected (\d+) columns, got (\d+): (.*)", re.DOTALL)


def read_table(
    path: Path, names: list[str], wanted: list[str], how: Layout, times: Collection[str], most: int = 0
) -> tuple[dict[str, Array], list[str]]:
    """The wanted columns, (n,) each, an empty cell is NaN; and a note on lines that end the file without being rows.

    Those of `times` may hold stamps.  Of a file longer than `most` bytes only the rows within these; 0 takes all of it.
    """
    first = dict(zip(names, how.first, strict=False))
    stamps = {name: first[name] for name in times if time_stamps.is_stamp(first.get(name, ""))}
    end = last_rows(path, how, most)
    with _in_words(path, names, how, times):
        table = _read(path, names, wanted, how, stamps, end)
    columns = {}
    for name in dict.fromkeys(wanted):  # one column at a time: a long log is in memory once
        columns[name] = time_stamps.numbers(table[name])
        table = table.drop_columns([name])
        arrow().default_memory_pool().release_unused()
    return columns, [end.note] if end.note else []


def _read(path: Path, names: list[str], wanted: list[str], how: Layout, stamps: dict[str, str], end: End) -> Any:
    """The table as Arrow reads it; `stamps` are the first of each column that holds them."""
    commas = any("," in stamp for stamp in stamps.values())
    types = {name: time_stamps.arrow_type(stamps.get(name, "")) for name in wanted}
    reading = arrow().csv.ReadOptions(use_threads=False, column_names=names, skip_rows=how.skipped)
    point = "." if commas else how.decimal
    converting = arrow().csv.ConvertOptions(column_types=types, include_columns=list(types), decimal_point=point)
    parsing = arrow().csv.ParseOptions(delimiter=how.separator)
    with path.open("rb") as file:  # of a whole file no more than a block is in memory
        if how.separator == SPACES:
            source = arrow().BufferReader(_single_spaced(file.read(end.length)))
        else:
            whole = end.length == path.stat().st_size
            source = arrow().PythonFile(file) if whole else arrow().BufferReader(file.read(end.length))
        if commas:  # with decimal points, as Arrow knows no stamps with decimal commas
            source = arrow().TransformInputStream(source, lambda block: bytes(block).replace(b",", b"."))
        return arrow().csv.read_csv(source, reading, parsing, converting)


def _single_spaced(text: bytes) -> bytes:
    """The same lines with one space between two cells, and none around them."""
    return re.sub(rb"(?m)^ | (?=\r?$)", b"", re.sub(rb"[ \t]+", b" ", text))


@contextlib.contextmanager
def _in_words(path: Path, names: list[str], how: Layout, times: Collection[str]) -> Iterator[None]:
    """Turn what the CSV reader says into file, row, column and text."""
    causes = (arrow().ArrowInvalid, arrow().ArrowKeyError, OSError)
    try:
        yield
    except causes as cause:
        words = why_unread(cause)
        if value := _NO_NUMBER.search(words):
            at, line = int(value[1]), int(value[2])
            raise _no_number(path, names[at], (line, at + 1), value[3], names[at] in times, how) from cause
        if width := _WIDTH.search(words):
            row, wanted, found, text = width.groups()
            words = f"row {row} has {found} columns, not {wanted}: {text}; decimal commas need another separator"
        raise RecordingError(f"{path}: {words}; correct the row or remove it", path, ProblemKind.VALUE) from cause


def _no_number(path: Path, name: str, place: tuple[int, int], text: str, time: bool, how: Layout) -> RecordingError:
    """What to say of a cell at a `place`, its line and its column from 1."""
    column = how.name(place[1] - 1) or name
    begun = how.first[place[1] - 1] if place[1] <= len(how.first) else ""
    if not time or not (time_stamps.is_date(text) or time_stamps.is_stamp(begun)):
        words = f"{path}: row {place[0]}, column {place[1]}: '{text}' is no number; correct the row or remove it"
        return RecordingError(words, path, ProblemKind.VALUE, column, place[0] - how.skipped)
    reason = f"no time like the first, {begun}" if begun not in ("", text) else "no time that can be read"
    key = f"{path}: row {place[0]}, column {place[1]}"
    choices, remedy = time_stamps.ADMISSIBLE, "write all times in one of these ways, or remove the row"
    problem = Problem(reason, ProblemKind.VALUE, key, f"'{text}'", choices=choices, remedy=remedy, file=path)
    return RecordingError(problem, column=column, row=place[0] - how.skipped)
