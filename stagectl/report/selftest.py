"""The page of the self-test: the matrix with its limits, and the place for a signature."""

import hashlib
import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from stagectl.drives.faults import TABLE, FaultType, Reaction
from stagectl.number_format import duration, length
from stagectl.report.constants import REASON_CHARACTERS
from stagectl.report.page import Page, Section, Table, write
from stagectl.units import Quantity, quantities_of

_HEAD = ["fault", "state", "result", "stopped by", "category", "stop time", "at most", "distance", "at most"]


def page(result: dict[str, Any], path: Path, files: Sequence[Path] = ()) -> Path:
    """Write it, with the text of the stage `files`; `result` is that of `stagectl selftest`."""
    cases, unit, scale = result["faults"], result["unit"], result["travel_per_unit"]
    failed = [[case["name"], case["state"], case["words"]] for case in cases if not case["passed"]]
    components: dict[str, list[list[str]]] = {}
    for case in cases:
        components.setdefault(case["component"], []).append(_row(case, unit, scale))
    sections = [Section(name.capitalize(), tables=[Table("", _HEAD, rows)]) for name, rows in components.items()]
    tables = [_signed(result), _matrix(cases)]
    if failed:
        tables.append(Table("Not passed", ["fault", "state", "why"], failed))
    notes = [
        f"{result['mode']}; {len(components)} components, {len({case['name'] for case in cases})} faults, "
        f"{len({case['state'] for case in cases})} states. Moving at {length(result['speed'], unit)}/s.",
        "Category 0: the power was cut while the axis moved; 1: it was braked, then the power was cut. "
        "Not a safety function: the emergency stop is wired to the drive's STO.",
    ]
    shown = Page(f"stagectl selftest: {result['stage']}", result["words"], notes, tables=tables, filtered=True)
    return write(shown._replace(commands=[result["command"]], sections=sections), path, files)


def _matrix(cases: Sequence[dict[str, Any]]) -> Table:
    """Each fault in each state at a glance."""
    states = list(dict.fromkeys(case["state"] for case in cases))
    passed = {(case["name"], case["state"]): case["passed"] for case in cases}
    words = {True: "passed", False: "NOT PASSED", None: ""}
    names = dict.fromkeys(case["name"] for case in cases)
    rows = [[name, *(words[passed.get((name, state))] for state in states)] for name in names]
    return Table("Faults by state", ["fault", *states], rows)


def digest(result: dict[str, Any]) -> str:
    """SHA-256 over all cases, which shows that the signed results are the ones on the page."""
    text = json.dumps(result["faults"], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _signed(result: dict[str, Any]) -> Table:
    rows = [
        ["stage file", f"{result['file']}, SHA-256 {result['file_digest'][:16]}"],
        ["results", f"{result['passed']} of {len(result['faults'])} passed, SHA-256 {digest(result)[:16]}"],
        ["run", f"{result['created']} on {result['host']}"],
        ["signed off by", result["signed"] or "nobody yet: --signed NAME, or by hand: ______________________"],
    ]
    return Table("Signed off", ["", ""], rows)


def _row(case: dict[str, Any], unit: str, scale: float) -> list[str]:
    goes_on = case["category"] is None
    reason = case["reason"] if len(case["reason"]) < REASON_CHARACTERS else "refused, in words"
    return [
        case["name"],
        case["state"],
        "passed" if case["passed"] else "NOT PASSED",
        reason.lower().replace("_", " ") or ("goes on" if goes_on else "the drive"),
        "" if goes_on else str(case["category"]),
        _or(case["stop_time"], duration),
        _or(case["stop_time_limit"], duration),
        length(case["stop_distance"] * scale, unit),
        _or(case["stop_distance_limit"], lambda way: length(way * scale, unit)),
    ]


def _or(value: float | None, words: Any) -> str:
    return "" if value is None or math.isinf(value) else str(words(value))


HEAD = ("fault", "component", "kind", "what happens", "stop", "parameters")


def faults() -> Iterator[dict[str, str]]:
    """Each fault in words, by the columns of the table."""
    for row in TABLE:
        cells = (row.name, row.component, row.kind, row.words, stop_words(row.required), _parameters(row))
        yield dict(zip(HEAD, cells, strict=True))


def stop_words(must: Reaction) -> str:
    """What drive and loop must do while the axis moves."""
    if must.category is None:
        return "goes on"
    return f"category {must.category}" + (", coasting" if must.brakes == "coast" else "")


def _parameters(row: FaultType) -> str:
    quantities, defaults = quantities_of(row.block), row.block._field_defaults
    named = [name for name in row.block._fields if name != "fault"]
    return ", ".join(f"{name}={_value(name, defaults[name], quantities.get(name))}" for name in named)


def _value(name: str, value: Any, quantity: Quantity | None) -> str:
    """As `stagectl inject` takes it."""
    return f"0x{value:04X}" if name == "code" else f"{value:.7g}{quantity.unit if quantity is not None else ''}"
