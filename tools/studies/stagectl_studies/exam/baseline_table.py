"""The diagnosis and its baselines on the same trials, in the same few figures.

Shifts of values of the model are passed over in all of them: a baseline has no test of its own for what is off.
"""

from collections.abc import Sequence
from typing import Any

from stagectl_studies.exam.question import ORACLE
from stagectl_studies.exam.rows import Row, is_open, median, rate

Record = dict[str, Any]
OURS = "diagnosis"


def beside(records: Sequence[Record], clear: Sequence[Record]) -> list[Record]:
    """One entry for the diagnosis and one for each baseline; `clear`: singles at twice their limit."""
    names = sorted({name for record in records for name in record.get("baselines", {})})
    answers = [
        {"name": name, "rows": [row._asdict() for row in _rows(name, records, clear)]} for name in (OURS, *names)
    ]
    return answers if names else []


def _rows(name: str, records: Sequence[Record], clear: Sequence[Record]) -> list[Row]:
    def of(kept: Sequence[Record]) -> list[Record]:
        return [
            record if name == OURS else record["baselines"][name]
            for record in kept
            if name == OURS or _has(record, name)
        ]

    closures = [record["gap"]["closure"] for record in of([each for each in clear if is_open(each)])]
    if name == ORACLE:  # it is told the names
        records, clear = [], []
    several = [record for record in records if record["stratum"] in ("pair", "triple")]
    nulls = [record for record in records if record["stratum"].startswith("null")]
    return [
        rate("null, false alarms", [bool(record["naming"]["effects_alarm"]) for record in of(nulls)]),
        rate("single, top-1", [bool(record["naming"]["top1_effects"]) for record in of(clear)]),
        rate("single, named and nothing beside it", [bool(record["naming"]["only"]) for record in of(clear)]),
        rate("pairs and triples, all found", [bool(record["naming"]["all_found"]) for record in of(several)]),
        rate(
            "pairs and triples, found and nothing beside them",
            [bool(record["naming"]["only"]) for record in of(several)],
        ),
        median("closure, single effect", closures),
    ]


def _has(record: Record, name: str) -> bool:
    return name in record.get("baselines", {})
