"""The diagnosis and its baselines on the same trials, in the same few figures.

Shifts of values of the model are passed over in all of them: a baseline has no test of its own for what is off.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from stagectl_studies.exam.question import ORACLE
from stagectl_studies.exam.rows import Row, is_open, median, rate

Record = dict[str, Any]
OURS = "diagnosis"


def beside(records: Sequence[Record], clear: Sequence[Record]) -> list[Record]:
    """One entry for the diagnosis and one for each baseline; `clear`: singles at twice their limit."""
    names = sorted({name for one in records for name in one.get("baselines", {})})
    found = [{"name": name, "rows": [row._asdict() for row in _rows(name, records, clear)]} for name in (OURS, *names)]
    return found if names else []


def _rows(name: str, records: Sequence[Record], clear: Sequence[Record]) -> list[Row]:
    def of(kept: Sequence[Record]) -> list[Record]:
        return [one if name == OURS else one["baselines"][name] for one in kept if name == OURS or _has(one, name)]

    closures = [one["gap"]["closure"] for one in of([each for each in clear if is_open(each)])]
    if name == ORACLE:  # it is told the names
        records, clear = [], []
    several = [one for one in records if one["stratum"] in ("pair", "triple")]
    nulls = [one for one in records if one["stratum"].startswith("null")]
    return [
        rate("null, false alarms", [bool(one["naming"]["effects_alarm"]) for one in of(nulls)]),
        rate("single, top-1", [bool(one["naming"]["top1_effects"]) for one in of(clear)]),
        rate("single, named and nothing beside it", [bool(one["naming"]["only"]) for one in of(clear)]),
        rate("pairs and triples, all found", [bool(one["naming"]["all_found"]) for one in of(several)]),
        rate("pairs and triples, found and nothing beside them", [bool(one["naming"]["only"]) for one in of(several)]),
        median("closure, single effect", closures),
    ]


def _has(one: Record, name: str) -> bool:
    return name in one.get("baselines", {})
