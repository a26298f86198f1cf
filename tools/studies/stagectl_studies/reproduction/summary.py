"""What became of each figure and method of a paper: the table at the top of its page."""

from enum import StrEnum
from typing import NamedTuple

from stagectl.report.page import Table


class Verdict(StrEnum):
    """What a reader may conclude."""

    REPRODUCED = "reproduced"
    DIFFERS = "differs because"
    NOT_DRAWN = "not drawn because"


class Compared(NamedTuple):
    """One figure, number or method of a paper beside ours."""

    place: str  # in the paper: figure, section
    paper: str  # what it shows or states
    ours: str
    verdict: Verdict
    reason: str = ""


def photograph(place: str, content: str) -> Compared:
    """A figure that no simulation can draw."""
    return Compared(place, content, "", Verdict.NOT_DRAWN, "it is a photograph")


def diagram(place: str, content: str, where: str) -> Compared:
    """A block diagram, and `where` its blocks are at work."""
    return Compared(place, content, where, Verdict.NOT_DRAWN, "it is a block diagram")


def table(rows: list[Compared]) -> Table:
    """All rows, in the paper's order."""
    cells = [[row.place, row.paper, row.ours, f"{row.verdict} {row.reason}".strip()] for row in rows]
    return Table("Every figure and method of the paper", ["place", "paper", "ours", "verdict"], cells, (0, 1, 2, 3))
