"""One line for every exam that is begun, and one with its scores for each that was held, good or bad."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def beginning(held: Mapping[str, Any], when: tuple[str, str]) -> str:
    """The line of an exam that is begun, `when` = (date, version): it stays whether or not that ends."""
    date, version = when
    return json.dumps({"date": date, "version": version, **held, "begun": True}) + "\n"


def entry(
    held: Mapping[str, Any], when: tuple[str, str], totals: Mapping[str, Any], seconds: Mapping[str, float]
) -> str:
    """A line: `when` = (date, version)."""
    scores = {row["name"]: [row["value"], row["trials"]] for row in totals["rows"]}
    date, version = when
    line = {"date": date, "version": version, **held, "scores": scores, "void": totals["void"], "seconds": seconds}
    return json.dumps(line) + "\n"


def append(path: Path, line: str) -> None:
    """Add a line."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        file.write(line)


def read(path: Path) -> Sequence[dict[str, Any]]:
    """All exams that were held, the oldest first; not those that were only begun."""
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    return [line for line in lines if "scores" in line]
