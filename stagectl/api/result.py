"""What every result can do: print as a table, show as HTML in a notebook, become a data frame, be saved."""

from __future__ import annotations

import html
import importlib
import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from stagectl.api.arguments import ArgumentError, PathLike
from stagectl.api.checked import checked
from stagectl.extras import require
from stagectl.replacing import write_json
from stagectl.units import StageError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stagectl.report.page import Page, Table

_STYLE = "text-align:left;padding:0 1em 0 0"


class MissingPackageError(StageError):
    """An optional package that is not installed: its `package` name."""

    def __init__(self, package: str, needed_for: str) -> None:
        super().__init__(f"{needed_for} needs {package}, which is not installed: pip install {package}")
        self.package = package


class Sheet(NamedTuple):
    """A result on one screen."""

    title: str
    answer: str
    tables: Sequence[Table]
    notes: Sequence[str] = ()


class PrintedResult(ABC):
    """Base of all results.  None of them prints or draws anything by itself.  `made_by` names what returns it."""

    made_by: ClassVar[str]

    @abstractmethod
    def sheet(self) -> Sheet:
        """Title, answer in a sentence, tables and notes."""

    @abstractmethod
    def to_frame(self) -> Any:
        """A pandas data frame; its ``attrs["units"]`` holds the unit of each column.

        Raises MissingPackageError without pandas.
        """

    if not TYPE_CHECKING:  # a type checker would take any name for one of ours

        def __getattr__(self, name: str) -> Any:
            """Say what there is, where there is nothing of this `name`."""
            public = ", ".join(word for word in dir(type(self)) if not word.startswith("_"))
            held = f'write ["{name}"]' if not name.startswith("_") and _holds(self, name) else f"it has {public}"
            there = "" if name.startswith("_") else f": {held}"
            raise AttributeError(f"{type(self).__name__} has no {name}{there}", name=name, obj=self)

    def __repr__(self) -> str:
        sheet = self.sheet()
        parts = [f"{sheet.title}: {sheet.answer}" if sheet.answer else sheet.title]
        return "\n".join([*parts, *map(_text, sheet.tables), *sheet.notes])

    def _repr_html_(self) -> str:
        sheet = self.sheet()
        parts = [f"<b>{html.escape(sheet.title)}</b>", f"<p>{html.escape(sheet.answer)}</p>"]
        parts += [*map(_html, sheet.tables), *(f"<div>{html.escape(note)}</div>" for note in sheet.notes)]
        return "\n".join(parts)


class ReportedResult(PrintedResult):
    """A result that has a JSON form and a page."""

    @abstractmethod
    def to_json(self) -> dict[str, Any]:
        """Everything as JSON values, as ``--json`` writes it."""

    @abstractmethod
    def page(self, command: str = "") -> Page:
        """The page with all figures; `command` is printed as what makes it again."""

    @checked
    def save(self, path: PathLike) -> Path:
        """Write JSON (``.json``) or the page (``.html``).  Raises ArgumentError for another kind of file.

        Raises StageError where a file is there that is none of that kind and of ours.
        """
        target = Path(path)
        if target.suffix not in (".json", ".html"):
            raise ArgumentError("path", target, "; must end in .json or .html")
        if target.suffix == ".html":
            require("report", "the page")
            from stagectl.report.page import write

            return write(self.page(), target)
        write_json(target, self.to_json())
        return target


def _holds(result: Any, name: str) -> bool:
    """Whether a result has an entry of this name."""
    try:
        result[name]
    except (StageError, LookupError, TypeError, AttributeError):  # none of this name, or none at all
        return False
    return True


def drawn(drawings: Mapping[str, Callable[[], Figure]], what: str) -> Figure:
    """The figure of this name, which nothing but its caller shows.  Raises ArgumentError where there is none."""
    from stagectl.report.figures import detached

    if what not in drawings:
        raise ArgumentError("what", what, f"; must be one of {', '.join(drawings) or 'none: there is nothing to draw'}")
    return detached(drawings[what]())


def frame(columns: Mapping[str, Any], units: Mapping[str, str]) -> Any:
    """A pandas data frame of these columns, with their units in its ``attrs``.

    Raises MissingPackageError without pandas.
    """
    try:
        pandas = importlib.import_module("pandas")
    except ImportError as error:
        raise MissingPackageError("pandas", "to_frame") from error
    data = pandas.DataFrame(dict(columns))
    data.attrs["units"] = dict(units)
    return data


def gains_frame(gains: Mapping[str, tuple[float, str]]) -> Any:
    """Gains by name, (value, unit), one a row."""
    values, units = zip(*gains.values(), strict=True)
    return frame({"gain": list(gains), "value": values, "unit": units}, dict(zip(gains, units, strict=True)))


def _text(table: Table) -> str:
    """Columns aligned, one line a row; a cell of several lines continues below."""
    rows = [line for row in ([table.head] if any(table.head) else []) + table.rows for line in _lines(row)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    aligned = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([*([table.title] if table.title else []), *(f"  {line}" for line in aligned)])


def _lines(row: Sequence[str]) -> list[list[str]]:
    return [list(line) for line in itertools.zip_longest(*(cell.split("\n") for cell in row), fillvalue="")]


def _html(table: Table) -> str:
    head = "".join(f'<th style="{_STYLE}">{html.escape(cell)}</th>' for cell in table.head)
    rows = [
        "<tr>" + "".join(f'<td style="{_STYLE}">{html.escape(cell)}</td>' for cell in row) + "</tr>"
        for row in table.rows
    ]
    title = f"<caption>{html.escape(table.title)}</caption>" if table.title else ""
    return f"<table>{title}<tr>{head}</tr>{''.join(rows)}</table>"
