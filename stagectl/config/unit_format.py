"""A value as the user of a configuration file would write it: in the unit that stands there, or one that reads well."""

from __future__ import annotations

import json
import math
import re
import types
from collections.abc import Sequence
from typing import Annotated, Any, Union, get_args, get_origin

import yaml

from stagectl.config.loader import Lengths, Tagged, fields_of
from stagectl.config.source import ConfigError, node_at
from stagectl.units import ROTARY, UnitError, factor, quantity_of

WIDTH = 120  # characters of a line
DIGITS = 7  # significant: half a millionth at worst, narrower than the interval of any identification
_READABLE = (0.01, 1e4)  # what a number in a chosen unit lies in
_PREFIXED = {"m": (("nm", 1e-9), ("um", 1e-6), ("mm", 1e-3), ("m", 1.0)), "s": (("us", 1e-6), ("ms", 1e-3), ("s", 1.0))}
_PLAIN = re.compile(r"[A-Za-z][\w-]*")


def hint_at(hint: Any, name: str, root: yaml.Node) -> Any:
    """The type hint of a dotted `name` below `hint`; a tagged block is the one whose tag stands in `root`.

    Raises ConfigError where there is no such entry.
    """
    words = name.split(".")
    for depth, word in enumerate(words):
        kind = block_of(hint, node_at(root, ".".join(words[:depth])) if depth else root)
        if word not in getattr(kind, "_fields", ()):
            raise ConfigError(f"{name} is not an entry of such a file: there is no {word} here")
        quantity = quantity_of(hint)
        hint = fields_of(Annotated[kind, quantity] if quantity else kind)[word]
    return hint


def tag_of(hint: Any) -> Tagged | None:
    """How the blocks of a tagged union are told apart."""
    extras = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    return next((extra for extra in extras if isinstance(extra, Tagged)), None)


def block_of(hint: Any, node: yaml.Node) -> Any:
    """The NamedTuple that describes a block: of a tagged union the one that `node` names."""
    tag = tag_of(hint)
    if tag is None:
        return _inner(hint)
    entries = node.value if isinstance(node, yaml.MappingNode) else []
    chosen = next((value.value for key, value in entries if key.value == tag.key), tag.default)
    return tag.blocks.get(chosen)


def _inner(hint: Any) -> Any:
    plain = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    if get_origin(plain) in (Union, types.UnionType):
        plain = next(kind for kind in get_args(plain) if kind is not type(None))
    return plain


def worded(value: Any, hint: Any, lengths: Lengths, like: str = "", column: int = 0) -> str:
    """`value` (SI) as text for the place that `hint` describes; `like` is what stood there.

    A list is written in one unit and broken into lines below its first entry, which begins at `column`.
    """
    quantity = quantity_of(hint)
    unit = quantity.unit_for(lengths.axis) if quantity else ""
    if quantity is not None and "|" not in quantity.unit:
        lengths = Lengths(lengths.axis)  # an angle that is no position, such as a phase, is no travel
    if isinstance(value, str):
        return value if _PLAIN.fullmatch(value) else json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Sequence):
        return _list([float(one) for one in value], unit, lengths, like.strip("[ \n").split(",")[0], column)
    if isinstance(value, int):
        return str(value)
    return _with_unit(float(value), *_chosen(abs(float(value)), unit, lengths, like))


def _list(values: list[float], unit: str, lengths: Lengths, like: str, column: int) -> str:
    typical = sorted(map(abs, values))[len(values) // 2] if values else 0.0
    chosen = _chosen(typical, unit, lengths, like)
    lines, line = [], "["
    for number, value in enumerate(values):
        entry = _with_unit(value, *chosen) + ("]" if number == len(values) - 1 else ",")
        if len(line) > 1 and column + len(line) + len(entry) + 1 > WIDTH:
            lines.append(line)
            line = " " * (column + 1) + entry
        else:
            line += entry if line == "[" else f" {entry}"
    return "\n".join([*lines, line])


def _with_unit(value: float, unit: str, scale: float) -> str:
    return f"{value / scale:.{DIGITS}g} {unit}".rstrip()


def _chosen(size: float, unit: str, lengths: Lengths, like: str) -> tuple[str, float]:
    """Unit to write in and its scale (SI): the one that stood there, where the number still reads well in it."""
    known = _unit_of(like, unit, lengths)
    if known and (size == 0.0 or _READABLE[0] <= size / known[1] < _READABLE[1]):
        return known
    through = _through_lead(unit, lengths)
    family, scale = ("m", through) if through and unit == "rad" else (unit, 1.0)
    for name, prefix in _PREFIXED.get(family, ()):
        if size / scale < 1e3 * prefix or prefix == 1.0:
            return name, prefix * scale
    return unit, 1.0


def _unit_of(text: str, unit: str, lengths: Lengths) -> tuple[str, float] | None:
    """The unit of a value that stands in a file, and its scale to `unit`; None where it has none of this kind."""
    found = re.fullmatch(r"[^A-Za-zµμ°Ω%‰/]*?(?:[eE][+-]?[0-9]+)?\s+([^0-9].*)", text.strip())
    if unit == "" or found is None:
        return None
    name = found[1].strip().rstrip("]").strip()
    try:
        return name, factor(name, unit)
    except UnitError:
        through = _through_lead(unit, lengths)
    try:
        return (name, factor(name, unit.replace("rad", "m", 1)) * through) if through else None
    except UnitError:
        return None


def _through_lead(unit: str, lengths: Lengths) -> float:
    """An angle in rad that a metre of table travel is; 0 where no lead converts."""
    if unit.split("/")[0] != "rad" or lengths.axis != ROTARY or not lengths.lead:
        return 0.0
    return 2.0 * math.pi / lengths.lead
