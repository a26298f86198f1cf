"""JSON schema of the configuration files, from the same type hints that the loader reads."""

from __future__ import annotations

import math
import types
from collections.abc import Callable
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from stagectl.config.loader import Tagged, fields_of
from stagectl.config.stage_file import StageFile
from stagectl.config.trajectory_file import BLOCKS, EXPERIMENTS, Entry
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
        return {"oneOf": [{"$ref": f"#/$defs/{name}"} for name in BLOCKS]}
    extras = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    plain = get_args(hint)[0] if extras else hint
    tag = next((extra for extra in extras if isinstance(extra, Tagged)), None)
    if tag is not None:
        return {"oneOf": [_block(kind, tag.key, name, name == tag.default) for name, kind in tag.blocks.items()]}
    words = next((extra for extra in extras if isinstance(extra, str)), None)
    described = {"description": words} if words else {}
    return {**_plain(plain, quantity_of(hint)), **described}


def _plain(plain: Any, quantity: Quantity | None) -> dict[str, Any]:
    if hasattr(plain, "_fields"):
        return _block(Annotated[plain, quantity] if quantity else plain)
    if get_origin(plain) is tuple:
        return _list(plain, quantity)
    if get_origin(plain) in (Union, types.UnionType):
        inner = next(kind for kind in get_args(plain) if kind is not type(None))
        return {"anyOf": [_plain(inner, quantity), {"type": "null"}]}
    if get_origin(plain) is Literal:
        return {"enum": list(get_args(plain))}
    if plain is str:
        return {"type": "string"}
    if plain is bool:
        return {"type": "boolean"}
    return _number(plain, quantity)


def _list(plain: Any, quantity: Quantity | None) -> dict[str, Any]:
    kinds = get_args(plain)
    kind = Annotated[kinds[0], quantity] if quantity else kinds[0]
    bounds = (
        {"minItems": int(get_origin(kinds[0]) is not Literal)}
        if kinds[-1] is Ellipsis
        else {"minItems": len(kinds), "maxItems": len(kinds)}
    )
    described = {"description": quantity.meaning} if quantity else {}
    return {"type": "array", "items": _of(kind), **bounds, **described}


def _number(plain: Any, quantity: Quantity | None) -> dict[str, Any]:
    """A pure number is a number, or text such as ``5 %``; one with a unit is text that begins with a number."""
    if quantity is None:
        return {"type": "integer"}
    described = {"description": f"{quantity.meaning}; {quantity.interval} {quantity.unit}".rstrip()}
    if quantity.unit:
        return {"type": "string", "pattern": f"{_NUMBER}{_UNIT}$", **described}
    if plain is int:
        return {"type": "integer", **_bounds(quantity), **described}
    return {"type": ["number", "string"], "pattern": f"{_NUMBER}({_UNIT})?$", **_bounds(quantity), **described}


def _bounds(quantity: Quantity) -> dict[str, float]:
    """The interval in JSON schema's words; an infinite end is none."""
    low, high = quantity.bounds()
    least = "exclusiveMinimum" if quantity.interval[0] == "(" else "minimum"
    most = "exclusiveMaximum" if quantity.interval[-1] == ")" else "maximum"
    return {name: end for name, end in ((least, low), (most, high)) if math.isfinite(end)}


def _block(hint: Any, tag: str = "", name: str = "", optional: bool = False) -> dict[str, Any]:
    kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    hints = fields_of(hint)
    properties = {field: _of(hints[field]) for field in kind._fields}
    required = [field for field in kind._fields if field not in kind._field_defaults]
    if tag:
        properties = {**properties, tag: {"const": name}}
        required = required if optional else list(dict.fromkeys([tag, *required]))
    summary = (kind.__doc__ or "").split("\n")[0]
    block = {"type": "object", "description": summary, "properties": properties, "additionalProperties": False}
    return {**block, "required": required} if required else block
