"""The faults in words: for the terminal, and as the table of docs/faults.md, which a test compares with it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_type_hints

from stagectl.drives.faults import TABLE, FaultType, Reaction
from stagectl.units import quantity_of

HEAD = ("fault", "component", "kind", "what happens", "stop", "parameters")


def lines() -> Iterator[str]:
    """The table, a fault a line, in Markdown."""
    yield f"| {' | '.join(HEAD)} |"
    yield f"|{'---|' * len(HEAD)}"
    for fault in faults():
        yield f"| `{fault['fault']}` | {' | '.join(fault[column] for column in HEAD[1:])} |"


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
    hints = get_type_hints(row.block, include_extras=True)
    named = [name for name in row.block._fields if name != "fault"]
    return ", ".join(f"{name}={_value(name, row.block._field_defaults[name], hints[name])}" for name in named)


def _value(name: str, value: Any, hint: Any) -> str:
    """As `stagectl inject` takes it."""
    quantity = quantity_of(hint)
    return f"0x{value:04X}" if name == "code" else f"{value:.7g}{quantity.unit if quantity is not None else ''}"
