"""The columns of a file, and what the words around each say of it: time, position, velocity, reference or effort."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stagectl.problem import ProblemKind
from stagectl.recording import constants, mat_logs
from stagectl.recording.columns import Array
from stagectl.recording.csv_layout import Layout, layout
from stagectl.recording.csv_table import read_table
from stagectl.recording.guess import units
from stagectl.recording.hdf5 import RecordingError
from stagectl.recording.metadata import flat

_ASKED = r"ref|setp|(?<![a-z])set(?![a-z])|soll|desired|demand|target|command|cmd"
_HINTS = {
    "time": r"time|stamp|^t$",
    "position": r"pos|angle|(?<![a-z])enc|theta|^q$|^qm$|^x(?![a-z])",
    "velocity": r"vel|speed|omega|geschw|drehzahl|rpm|/(?:s|sec|min)\b(?!\^)|^dq|^v$",
    "reference": rf"{_ASKED}|^qg$|^qd$",
    "effort": rf"{units.CURRENT}|torque|force|moment|tau|^u$|^vir$",
    "command": rf"{_ASKED}|^u$|^vir$",
    "no effort": r"volt|supply|accel|/s(?:\^?2|²)|temp|"
    r"(?<![a-z])(?:acc|[uvi]_?d|[uv]_?q|[uv]_?(?:dc|bus|link|batt?|in))(?![a-z])",
}


class Column(NamedTuple):
    """One column as it is in its file."""

    name: str  # as --columns takes it: a number from 1, a variable, or variable[number]
    words: str  # what the file says about it, lower case; empty where nothing
    values: Array  # (n,)


def read(path: Path) -> list[Column]:
    """All columns of numbers that have as many rows as the file's longest one.

    Raises RecordingError where there are fewer than two.
    """
    columns = _of_mat(path) if path.suffix.lower() == ".mat" else _of_text(path)
    longest = max((len(column.values) for column in columns), default=0)
    columns = [column for column in columns if len(column.values) == longest]
    if len(columns) < 2 or longest < constants.JUDGED_ROWS:
        reason = (
            f"{path} holds {len(columns)} columns of {longest} numbers; must hold at least 2 of {constants.JUDGED_ROWS}"
        )
        raise RecordingError(reason, path, ProblemKind.SHAPE)
    return columns


def _of_text(path: Path) -> list[Column]:
    how = layout(path)
    labels = [str(number) for number in range(1, how.width + 1)]
    table, _ = read_table(path, labels, labels, how, labels, constants.GUESS_BYTES)
    return [Column(name, _words(how, k), table[name]) for k, name in enumerate(labels)]


def _words(how: Layout, k: int) -> str:
    """What the lines above the numbers say in column `k`, those that have a cell for each column.

    Stamps say that they are a time, and they are read in s.
    """
    if how.stamped(k):
        return "time [s]"
    rows = how.rows if how.skipped else []
    return " ".join(row[k] for row in rows if len(row) == how.width).lower()


def _of_mat(path: Path) -> list[Column]:
    columns = []
    for name, value in flat(mat_logs.variables(path)).items():
        values = np.asarray(value)
        if values.dtype.kind not in "fiu" or values.ndim > 2 or values.size < 2:
            continue
        table = mat_logs.upright(values.astype(np.float64))
        if table.ndim == 1:
            columns.append(Column(name, name.lower(), table))
        else:
            columns += [Column(f"{name}[{k + 1}]", "", table[:, k]) for k in range(table.shape[1])]
    return columns


def hinted(column: Column, quantity: str) -> bool:
    """Whether the words around a column name a quantity; those of a voltage name no effort, whatever else they say."""
    if quantity == "effort" and hinted(column, "no effort"):
        return False
    return re.search(_HINTS[quantity], column.words) is not None


def may_drive(column: Column) -> bool:
    """Whether a column can be an effort by its words: they name one, or no other quantity."""
    others = ("time", "position", "velocity", "no effort")
    return hinted(column, "effort") or not any(hinted(column, quantity) for quantity in others)


def by_name(column: Column) -> tuple[bool, ...]:
    """How well the words around a column name a measured current; the largest is the best."""
    effort = hinted(column, "effort")
    return (
        not (effort and hinted(column, "command")),
        effort,
        effort and re.search(units.CURRENT, column.words) is not None,
    )
