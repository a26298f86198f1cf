"""Layout of a CSV text: the separator of its columns, and the rows in which header and numbers begin."""

import csv
import itertools
import re
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple

from stagectl.problem import ProblemKind
from stagectl.recording.constants import HEADER_LINES, SHOWN_CELLS, TAIL_BYTES, TAIL_LINES
from stagectl.recording.content import is_hdf5, is_text, is_wide, stranger
from stagectl.recording.hdf5 import RecordingError
from stagectl.recording.time_stamps import is_date, is_stamp

SPACES = " "  # as many as there are between two cells
SEPARATORS = (",", ";", "\t", SPACES)
WORDS = {",": "commas", ";": "semicolons", "\t": "tabs", SPACES: "spaces"}
_COMMENT = re.compile(r"\s*[#%]+\s*")  # what a header may begin with


class Layout(NamedTuple):
    """What the first lines show."""

    separator: str
    rows: list[list[str]]  # the lines before the numbers, the header last; at least the first line
    skipped: int  # lines before the numbers
    width: int  # columns
    decimal: str  # sign in its numbers
    first: list[str]  # of each column, the first cell among its numbers that is not empty

    @property
    def names(self) -> list[str]:
        """The header: the row just before the numbers; empty where there is none."""
        return self.rows[-1] if self.skipped else []

    def name(self, at: int) -> str:
        """The header of column `at`; empty where there is none."""
        return self.names[at] if at < len(self.names) else ""

    def stamped(self, at: int) -> bool:
        """Whether column `at` holds time stamps."""
        return at < len(self.first) and is_stamp(self.first[at])


class End(NamedTuple):
    """Where the rows of a text end."""

    length: int  # bytes up to the end of the last row
    note: str  # what follows it; empty where nothing does


def layout(path: Path) -> Layout:
    """The layout of the text at `path`.  Raises RecordingError where it is not text, or empty."""
    _check_encoding(path)
    with _read_as_csv(path), path.open(newline="", encoding="utf-8-sig") as file:
        lines = list(itertools.islice(file, HEADER_LINES))
    if not any(line.strip() for line in lines):
        reason = f"{path} is empty; must have a header (time_s,position_mm,...) and a row for each sample"
        raise RecordingError(reason, path, ProblemKind.MISSING)
    with _read_as_csv(path):
        tried = [(separator, _split(lines, separator)) for separator in SEPARATORS]
    separator, rows = max(tried, key=lambda candidate: sum(_numbers(row, candidate[0]) for row in candidate[1]))
    first = next((k for k, row in enumerate(rows) if _numbers(row, separator)), 1)
    numbers = [row for row in rows if _numbers(row, separator)]
    comma = separator != "," and any("," in cell and not is_date(cell) for row in numbers for cell in row)
    width = len(numbers[0] if numbers else rows[0])
    if first and len(rows[first - 1]) != width:  # a header with a separator of its own
        heads = (split[first - 1] for _, split in tried)
        rows[first - 1] = next((head for head in heads if len(head) == width), rows[first - 1])
    start = [next((row[k] for row in numbers if len(row) > k and row[k]), "") for k in range(width)]
    return Layout(separator, rows[: max(first, 1)], first, width, "," if comma else ".", start)


def is_table(path: Path) -> bool:
    """Whether a file holds rows of numbers as text, whatever its name; text in UTF-16 may."""
    if is_wide(path):
        return True
    return is_text(path) and any(layout(path).first)


def last_rows(path: Path, how: Layout, most: int = 0) -> End:
    """Where the last whole row ends: a line that was cut off and a closing word, such as ``EOF``, are left out.

    Of a file longer than `most` bytes, where that is given, the last whole row within these.
    """
    size = min(path.stat().st_size, most or path.stat().st_size)
    with path.open("rb") as file:
        file.seek(max(size - TAIL_BYTES, 0))
        lines = file.read(min(size, TAIL_BYTES)).decode("utf-8", "replace").splitlines(keepends=True)
    dropped: list[str] = []
    cut = not most and _ends_early(lines[how.skipped :])
    while len(lines) > how.skipped + 1 and len(dropped) < TAIL_LINES and not _whole(lines[-1], how):
        dropped.append(lines.pop())
    if not (words := [line.strip() for line in dropped if line.strip()]):
        return End(size, "its last row has no end of line and is shorter than the one before: it may be cut off" * cut)
    shown = words[-1] if len(words[-1]) <= SHOWN_CELLS else f"{words[-1][:SHOWN_CELLS]}..."
    return End(size - sum(len(line.encode()) for line in dropped), f"its last line is no whole row ({shown}): left out")


def _ends_early(lines: list[str]) -> bool:
    """Whether the last row has fewer characters than the one before it, and no end of line."""
    return len(lines) > 1 and lines[-1][-1:] not in "\r\n" and len(lines[-1]) < len(lines[-2].rstrip("\r\n"))


def _whole(line: str, how: Layout) -> bool:
    """Whether a line is a row: as many cells as the others, the last one not cut within its number."""
    cells = [cell.strip() for cell in line.rstrip("\r\n").split(None if how.separator == SPACES else how.separator)]
    if len(cells) != how.width or not any(cells):
        return False
    if how.stamped(how.width - 1):
        return is_stamp(cells[-1])
    last = cells[-1].replace(how.decimal, ".")
    return not last or _number(last) or not _number(f"{last}0")


def _check_encoding(path: Path) -> None:
    """Raises RecordingError where a text is of 16 bits, as spreadsheets save it, or ends in zero bytes."""
    with _read_as_csv(path):
        if is_hdf5(path):
            reason = f"{path} is an HDF5 file, though its name says CSV: rename it to {path.with_suffix('.h5').name}"
            raise RecordingError(reason, path, ProblemKind.SYNTAX)
        if what := stranger(path):
            raise RecordingError(f"{path} {what}", path, ProblemKind.SYNTAX)
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - TAIL_BYTES, 0))
        tail = file.read()
    if is_wide(path):
        reason = f"{path} is text in UTF-16; must be UTF-8: save it as UTF-8 (a spreadsheet calls it CSV UTF-8)"
        raise RecordingError(reason, path, ProblemKind.SYNTAX)
    if zeros := len(tail) - len(tail.rstrip(b"\0")):
        count = f"{zeros}{' or more' if zeros == len(tail) else ''}"
        reason = (
            f"{path} ends in {count} zero bytes, as after a loss of power: cut them off, such as by "
            f"`tr -d '\\0' < {path} > whole.csv`, and check its last row"
        )
        raise RecordingError(reason, path, ProblemKind.SYNTAX)


_TEXT = "; give a text file, saved as UTF-8, with a header and rows of numbers"


def _read_as_csv(path: Path) -> AbstractContextManager[None]:
    causes = (OSError, UnicodeDecodeError, csv.Error)
    return RecordingError.instead_of(causes, f"{path} is not CSV text", path, ProblemKind.SYNTAX, _TEXT)


def _split(lines: list[str], separator: str) -> list[list[str]]:
    lines = [line[mark.end() :] if (mark := _COMMENT.match(line)) else line for line in lines]
    if separator == SPACES:
        return [line.split() for line in lines]
    return [[cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])] for line in lines]


def _numbers(row: list[str], separator: str) -> bool:
    """Whether a row is two numbers or more; a cell may be empty, and others may be dates."""
    cells = [cell.replace(",", ".") if separator != "," else cell for cell in row if cell and not is_date(cell)]
    return len(row) > 1 and bool(cells) and all(map(_number, cells))


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
