"""One figure or table of a paper, reproduced: what the page shows and what the JSON file holds."""

from typing import Any, NamedTuple

from stagectl.report.page import Section
from stagectl_studies.reproduction.summary import Compared


class Part(NamedTuple):
    """A section of the page with its numbers."""

    name: str  # key in the JSON file: "figure 5", "parameters"
    section: Section
    numbers: dict[str, Any]  # JSON values, SI


class Outcome(NamedTuple):
    """A whole paper: the answer in a sentence, and its parts in the paper's order."""

    answer: str
    notes: list[str]
    parts: list[Part]
    compared: list[Compared]  # every figure and method of the paper

    def numbers(self) -> dict[str, Any]:
        """All parts by name, as JSON values."""
        compared = [{**row._asdict(), "verdict": str(row.verdict)} for row in self.compared]
        head = {"simulated": True, "answer": self.answer, "compared": compared}
        return {**head, **by_name(self.parts)}


def by_name(parts: list[Part]) -> dict[str, Any]:
    """The numbers of all parts, by name."""
    return {part.name: part.numbers for part in parts}


def percent(value: float, true: float) -> str:
    """Deviation from `true`: ``+0.12 %``."""
    return f"{100.0 * (value / true - 1.0):+.2f} %"
