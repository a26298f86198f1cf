"""A value as the user of a configuration file would write it: in the unit of the old text, or one that reads well."""

import contextlib
import json
import re
import textwrap
from collections.abc import Sequence
from typing import Annotated, Any

import yaml

from stagectl.config.bounds import LINE_WIDTH, READABLE, WRITTEN_DIGITS
from stagectl.config.hints import fields_of, tag_of, without_none
from stagectl.config.lengths import Lengths
from stagectl.config.source import ConfigError, entry_of, node_at
from stagectl.problem import Problem, ProblemKind, nearest
from stagectl.units import UnitError, factor, quantity_of

_PREFIXED = {"m": (("nm", 1e-9), ("um", 1e-6), ("mm", 1e-3), ("m", 1.0)), "s": (("us", 1e-6), ("ms", 1e-3), ("s", 1.0))}
_HARD = "\u00a0"  # a blank at which no line is broken
_PLAIN = re.compile(r"[A-Za-z][\w-]*")


def hint_at(hint: Any, name: str, root: yaml.Node) -> Any:
    """The type hint of a dotted `name` below `hint`; a tagged block is the one that `root` names.

    Raises ConfigError where there is no such entry.
    """
    words = name.split(".")
    for depth, word in enumerate(words):
        kind = block_of(hint, node_at(root, ".".join(words[:depth])) if depth else root)
        known = getattr(kind, "_fields", ())
        if (tag := tag_of(hint)) and word == tag.key:
            reason, remedy = "cannot be changed alone", f"give all of {'.'.join(words[:depth])} as a mapping"
            raise ConfigError(Problem(reason, ProblemKind.SHAPE, name, remedy=remedy))
        if word not in known:
            near = nearest(word, known)
            remedy = f"did you mean {'.'.join((*words[:depth], near))}?" if near else f"known are {', '.join(known)}"
            raise ConfigError(Problem("is not known", ProblemKind.UNKNOWN, name, remedy=remedy))
        quantity = quantity_of(hint)
        hint = fields_of(Annotated[kind, quantity] if quantity else kind)[word]
    return hint


def block_of(hint: Any, node: yaml.Node) -> Any:
    """The NamedTuple that describes a block: of a tagged union the one that `node` names."""
    tag = tag_of(hint)
    if tag is None:
        return without_none(hint)
    return tag.blocks.get(getattr(entry_of(node, tag.key), "value", tag.default))


def worded(value: Any, hint: Any, lengths: Lengths, like: str = "", column: int = 0) -> str:
    """`value` (SI) as text for the place that `hint` describes; `like` is the text that it replaces.

    A list is written in one unit and broken into lines below its first entry, which begins at `column`.
    """
    quantity = quantity_of(hint)
    unit = quantity.unit_for(lengths.axis) if quantity else ""
    if quantity is not None and "|" not in quantity.unit:
        lengths = Lengths(lengths.axis)  # an angle that is not a position, such as a phase, is not travel
    if isinstance(value, str):
        return value if _PLAIN.fullmatch(value) else json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Sequence):
        if value and all(isinstance(entry, str) for entry in value):
            return f"[{', '.join(value)}]"
        return _list([float(entry) for entry in value], unit, lengths, like.strip("[ \n").split(",")[0], column)
    if isinstance(value, int) and not unit:
        return str(value)
    return _with_unit(float(value), *_chosen(abs(float(value)), unit, lengths, like))


def _list(values: list[float], unit: str, lengths: Lengths, like: str, column: int) -> str:
    typical = sorted(map(abs, values))[len(values) // 2] if values else 0.0
    chosen = _chosen(typical, unit, lengths, like)
    entries = ", ".join(_with_unit(value, *chosen).replace(" ", _HARD) for value in values)
    margin = " " * column
    lines = textwrap.fill(
        f"[{entries}]", LINE_WIDTH, initial_indent=margin, subsequent_indent=f"{margin} ", break_on_hyphens=False
    )
    return lines.removeprefix(margin).replace(_HARD, " ")


def _with_unit(value: float, unit: str, scale: float) -> str:
    return f"{value / scale:.{_digits(value, scale)}g} {unit}".rstrip()


def _digits(value: float, scale: float) -> int:
    """Digits to write: more than are usual for a value that is short in SI, as a person gave it: 3 rad/s in mm/s.

    That one must be read back as it was given.  A computed value is long in SI, too, and its last digits tell nothing.
    """
    short, all_of_them = float(f"{value:.{WRITTEN_DIGITS}g}") == value, 17
    several = range(WRITTEN_DIGITS, all_of_them)
    exact = (digits for digits in several if float(f"{value / scale:.{digits}g}") * scale == value)
    return next(exact, all_of_them) if short else WRITTEN_DIGITS


def _chosen(size: float, unit: str, lengths: Lengths, like: str) -> tuple[str, float]:
    """Unit to write in and its scale (SI): that of the old text, where the number still reads well in it."""
    known = _unit_of(like, unit, lengths)
    if known and (size == 0.0 or READABLE[0] <= size / known[1] < READABLE[1]):
        return known
    through = lengths.angle_per_length(unit)
    family, scale = ("m", through) if through and unit == "rad" else (unit, 1.0)
    for name, prefix in _PREFIXED.get(family, ()):
        if size / scale < 1e3 * prefix or prefix == 1.0:
            return name, prefix * scale
    return unit, 1.0


def _unit_of(text: str, unit: str, lengths: Lengths) -> tuple[str, float] | None:
    """The unit of a value in a file, and its scale to `unit`; None where it has none of this kind."""
    match = re.fullmatch(r"[^A-Za-zµμ°Ω%‰/]*?(?:[eE][+-]?[0-9]+)?\s+([^0-9].*)", text.strip())
    if unit == "" or match is None:
        return None
    name, through = match[1].strip().rstrip("]").strip(), lengths.angle_per_length(unit)
    for family, scale in ((unit, 1.0), *([(unit.replace("rad", "m", 1), through)] if through else [])):
        with contextlib.suppress(UnitError):
            return name, factor(name, family) * scale
    return None
