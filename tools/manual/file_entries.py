"""Every entry of a configuration file: unit, range, default and meaning, from the types that the loader reads."""

import inspect
import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin

from stagectl.config.hints import fields_of, meaning_of, tag_of, without_none
from stagectl.config.stage_blocks import StageFile
from stagectl.config.trajectory_file import EXPERIMENTS
from stagectl.trajectories.sequence import Entry
from stagectl.units import Quantity, quantity_of

REQUIRED = "required"
_HEXADECIMAL = ("index_subindex", "error code")  # words of the meaning of what manuals of drives write so


class Row(NamedTuple):
    """One entry of a block."""

    key: str
    takes: str  # kind of value, with its unit
    interval: str  # admissible, SI; empty where there is none
    default: str
    meaning: str


class Block(NamedTuple):
    """One block, by its dotted name."""

    name: str  # empty: the file itself
    choice: str  # ``law: rolling`` where the block is one of several
    meaning: str
    rows: tuple[Row, ...]


def stage_blocks() -> list[Block]:
    """All blocks of a stage file, outer ones first."""
    return list(_blocks(StageFile, "", "", "The blocks of the file."))


def trajectory_blocks() -> list[Block]:
    """All types of a trajectory file."""
    return [block for name, kind in EXPERIMENTS.items() for block in _blocks(kind, "", f"type: {name}", _summary(kind))]


def _blocks(hint: Any, name: str, choice: str, meaning: str) -> Iterator[Block]:
    kind, quantity = without_none(hint), quantity_of(hint)
    hints = fields_of(Annotated[kind, quantity] if quantity else kind)
    rows = tuple(_row(field, hints[field], kind._field_defaults) for field in kind._fields)
    yield Block(name, choice, meaning, rows)
    for field in kind._fields:
        inner = f"{name}.{field}" if name else field
        yield from _within(hints[field], inner)


def _within(hint: Any, name: str) -> Iterator[Block]:
    if hint == Entry:
        return
    item = _item(hint)
    tag = tag_of(item)
    if tag is not None:
        for chosen, kind in tag.blocks.items():
            if tag.key != "type" or kind not in EXPERIMENTS.values():
                yield from _blocks(kind, name, f"{tag.key}: {chosen}", _summary(kind))
    elif hasattr(without_none(item), "_fields"):
        yield from _blocks(item, name, "", _summary(without_none(item)))


def _item(hint: Any) -> Any:
    """What a list holds; anything else is itself."""
    plain = without_none(hint)
    return get_args(plain)[0] if get_origin(plain) is tuple else hint


def _row(field: str, hint: Any, defaults: dict[str, Any]) -> Row:
    quantity = quantity_of(hint)
    words = meaning_of(hint) or _words(hint)
    default = _shown(defaults[field], quantity) if field in defaults else REQUIRED
    interval = f"{quantity.interval}" if quantity else ""
    return Row(field, _takes(hint, quantity), interval, default, quantity.meaning if quantity else words)


def _words(hint: Any) -> str:
    """What a block is, in the words of its class; of several, the blocks that follow say it."""
    tag = tag_of(hint)
    if tag is not None:
        return "" if tag.key == "type" else f"one of the blocks below, by `{tag.key}`"
    return _summary(hint) if hasattr(without_none(hint), "_fields") else ""


def _takes(hint: Any, quantity: Quantity | None) -> str:
    plain, tag = without_none(hint), tag_of(hint)
    if _is_trajectory(hint):
        return "a motion or a current, see the trajectory file"
    if get_origin(plain) is tuple:
        inner = get_args(plain)[0]
        return f"list of {_takes(Annotated[inner, quantity] if quantity else inner, quantity)}"
    if tag is not None:
        return f"block with `{tag.key}`: {', '.join(tag.blocks)}"
    return "block" if hasattr(plain, "_fields") else _scalar(plain, quantity)


def _is_trajectory(hint: Any) -> bool:
    tag = tag_of(hint)
    return tag is not None and tag.key == "type"


def _scalar(plain: Any, quantity: Quantity | None) -> str:
    if get_origin(plain) is Literal:
        return " | ".join(f"`{word}`" for word in get_args(plain))
    if plain in (bool, str):
        return "text" if plain is str else "`true` | `false`"
    if quantity is not None and quantity.unit:
        return " | ".join(part.strip() for part in quantity.unit.split("|"))
    return "whole number" if plain is int else "number"


def _shown(value: Any, quantity: Quantity | None) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and not math.isfinite(value):
        return "derived" if math.isnan(value) else "inf"
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return "block of defaults"
    if isinstance(value, tuple):
        return "[" + ", ".join(f"{entry:#x}" if isinstance(entry, int) else str(entry) for entry in value) + "]"
    unit = quantity.unit.split("|")[0].strip() if quantity else ""
    if isinstance(value, int) and quantity and any(word in quantity.meaning for word in _HEXADECIMAL):
        return f"{value:#x}"
    return _number(value, unit) if isinstance(value, int | float) else str(value)


def _number(value: float, unit: str) -> str:
    """With its unit; an angle that is a whole number of degrees in degrees."""
    degrees = math.degrees(value)
    if unit == "rad" and value and math.isclose(degrees, round(degrees), rel_tol=1e-9):
        return f"{degrees:.0f} deg"
    return f"{value:.10g} {unit}".strip()


def _summary(kind: Any) -> str:
    return (inspect.getdoc(without_none(kind)) or "").split("\n")[0].replace("``", "`")
