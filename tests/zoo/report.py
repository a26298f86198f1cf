"""Rows of the table by hand: ``python -m tests.zoo.report run|serve [ROW ...]``, a line of Markdown each."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.zoo.bench import Result, last_words, objections, run
from tests.zoo.service import serve
from tests.zoo.table import EVERY, Row


def line(row: Row, result: Result, served: bool) -> str:
    """Verdict, row, wanted, seen, objections, the program's words."""
    wrong = objections(result, row, served)
    allowed = row.served if served and row.served else row.allowed
    cells = (
        "FAIL" if wrong else "pass",
        row.title,
        " or ".join(sorted(allowed)),
        result.outcome,
        "; ".join(wrong),
        last_words(result.words),
    )
    return " | ".join(cell.replace("|", "/") for cell in cells)


def main() -> None:
    """The rows named, or all."""
    served = sys.argv[1] == "serve"
    for title in sys.argv[2:] or EVERY:
        with tempfile.TemporaryDirectory(prefix="zoo-") as folder:
            row = EVERY[title]
            result = (serve if served else run)(Path(folder), row)
            print(line(row, result, served), flush=True)


if __name__ == "__main__":
    main()
