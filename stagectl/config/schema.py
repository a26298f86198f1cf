"""JSON schema of the configuration files, from the same type hints that the loader reads."""

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, get_args, get_origin

from stagectl.config.hints import fields_of, is_union, meaning_of, plain, tag_of, without_none
from stagectl.config.stage_blocks import StageFile
from stagectl.config.trajectory_file import EXPERIMENTS
from stagectl.trajectories.sequence import TYPES, Entry
from stagectl.units import Quantity, quantity_of

_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_NUMBER = r"^\s*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?"
_POWER = r"[A-Za-zµμ°Ω%‰]+((\^|\*\*)-?[0-9])?"
_UNIT = rf"\s*(1\s?/\s?)?{_POWER}((\s?[*·/]\s?|\s){_POWER})*\s*"


def stage_schema() -> dict[str, Any]:
    """Of a stage file."""
    return {"$schema": _DRAFT, "title": "stagectl stage", **_of(StageFile)}


def trajectory_schema() -> dict[str, Any]:
    """Of a trajectory file."""
    blocks = {name: _block(kind, "type", name) for name, kind in EXPERIMENTS.items()}
    one_of = [{"$ref": f"#/$defs/{name}"} for name in blocks]
    return {"$schema": _DRAFT, "title": "stagectl trajectory", "oneOf": one_of, "$defs": blocks}


SCHEMAS: dict[str, Callable[[], dict[str, Any]]] = {"stage": stage_schema, "trajectory": trajectory_schema}


def _of(hint: Any) -> dict[str, Any]:
    if hint == Entry:
        return {"oneOf": [{"$ref": f"#/$defs/{name}"} for name in TYPES]}
    tag, words = tag_of(hint), meaning_of(hint)
    if tag is not None:
        return {"oneOf": [_block(kind, tag.key, name, name == tag.default) for name, kind in tag.blocks.items()]}
    described = {"description": words} if words else {}
    return {**_described(plain(hint), quantity_of(hint)), **described}


def _described(kind: Any, quantity: Quantity | None) -> dict[str, Any]:
    if hasattr(kind, "_fields"):
        return _block(Annotated[kind, quantity] if quantity else kind)
    if get_origin(kind) is tuple:
        return _list(kind, quantity)
    if is_union(kind):
        return {"anyOf": [_described(without_none(kind), quantity), {"type": "null"}]}
    if get_origin(kind) is Literal:
        return {"enum": list(get_args(kind))}
    if kind in (str, bool):
        return {"type": "string" if kind is str else "boolean"}
    return _number(kind, quantity)


def _list(whole: Any, quantity: Quantity | None) -> dict[str, Any]:
    kinds = get_args(whole)
    kind = Annotated[kinds[0], quantity] if quantity else kinds[0]
    bounds = (
        {"minItems": int(get_origin(kinds[0]) is not Literal)}
        if kinds[-1] is Ellipsis
        else {"minItems": len(kinds), "maxItems": len(kinds)}
    )
    described = {"description": quantity.meaning} if quantity else {}
    return {"type": "array", "items": _of(kind), **bounds, **described}


def _number(number: Any, quantity: Quantity | None) -> dict[str, Any]:
    """A pure number is a number, or text such as ``5 %``; one with a unit is text that begins with a number."""
    if quantity is None:
        return {"type": "integer"}
    described = {"description": f"{quantity.meaning}; {quantity.interval} {quantity.unit}".rstrip()}
    if quantity.unit:
        return {"type": "string", "pattern": f"{_NUMBER}{_UNIT}$", **described}
    if number is int:
        return {"type": "integer", **_bounds(quantity), **described}
    return {"type": ["number", "string"], "pattern": f"{_NUMBER}({_UNIT})?$", **_bounds(quantity), **described}


def _bounds(quantity: Quantity) -> dict[str, float]:
    """The interval in the words of JSON schema, which has none for an infinite end."""
    low, high = quantity.bounds()
    least = "exclusiveMinimum" if quantity.interval[0] == "(" else "minimum"
    most = "exclusiveMaximum" if quantity.interval[-1] == ")" else "maximum"
    return {name: end for name, end in ((least, low), (most, high)) if math.isfinite(end)}


def _block(hint: Any, tag: str = "", name: str = "", optional: bool = False) -> dict[str, Any]:
    kind, hints = plain(hint), fields_of(hint)
    properties = {field: _of(hints[field]) for field in kind._fields}
    required = [field for field in kind._fields if field not in kind._field_defaults]
    if tag:
        properties = {**properties, tag: {"const": name}}
        required = required if optional else list(dict.fromkeys([tag, *required]))
    summary = (kind.__doc__ or "").split("\n")[0]
    block = {"type": "object", "description": summary, "properties": properties, "additionalProperties": False}
    return {**block, "required": required} if required else block
