"""YAML to NamedTuples, strictly: the type hints are the schema.

Every value is checked against the `Quantity` beside its field; every error says where it stands, what was
found and what may stand there, and all errors of a file come at once.  Unknown keys are errors.
"""

from __future__ import annotations

import difflib
import math
import types
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import yaml

from stagectl.config.source import ConfigError as ConfigError  # raised here, known by this name elsewhere
from stagectl.config.source import compose
from stagectl.units import LINEAR, ROTARY, Quantity, UnitError, parse, quantity_of

DEEPEST = 20
LONGEST_LIST = 1000  # entries
LONGEST_TEXT = 200  # characters
MOST_ERRORS = 30  # said of one file; the first ones are the causes


class Tagged(NamedTuple):
    """A union of blocks told apart by one key: ``type: sine`` chooses the block of that name."""

    key: str
    blocks: Mapping[str, Any]
    default: str = ""  # the block where the key is absent; none: it must be there


class Lengths(NamedTuple):
    """How lengths and angles convert on this axis."""

    axis: str = LINEAR
    lead: float = 0.0  # m per revolution, 0 where there is none
    angular: bool = False  # travel itself is an angle: a trajectory on a rotary axis without lead


class Reader:
    """One file being read: collects errors and goes on."""

    def __init__(self, path: Path, lengths: Lengths) -> None:
        self.path, self.lengths = path, lengths
        self.errors: list[str] = []

    def refuse(self, node: yaml.Node | None, message: str) -> None:
        """Note an error at the line of `node`."""
        self.errors.append(f"{message} ({self.place(node)})")

    def place(self, node: yaml.Node | None) -> str:
        """Where `node` stands, as ``file:line``."""
        return f"{self.path}:{node.start_mark.line + 1 if node is not None else 1}"

    def finish(self) -> None:
        """Raise ConfigError if anything was refused."""
        if self.errors:
            more = len(self.errors) - MOST_ERRORS
            rest = [f"and {more} more errors ({self.path})"] if more > 0 else []
            raise ConfigError("\n".join(self.errors[:MOST_ERRORS] + rest))

    def value(self, hint: Any, node: yaml.Node, name: str) -> Any:
        """`node` as `hint`; after an error any stand-in, as `finish` will raise."""
        if name.count(".") > DEEPEST:
            self.refuse(node, f"{name}: nested deeper than {DEEPEST} levels")
            return None
        quantity, tag, plain = quantity_of(hint), _tag_of(hint), _plain(hint)
        if tag is not None:
            return self._tagged(tag, node, name)
        if get_origin(plain) in (Union, types.UnionType):
            return self._optional(hint, plain, node, name)
        if get_origin(plain) is tuple:
            return self._list(plain, quantity, node, name)
        if hasattr(plain, "_fields"):
            return self.block(hint, node, name)
        return self._scalar(hint, node, name)

    def block(self, hint: Any, node: yaml.Node, name: str, skip: str = "") -> Any:
        """A mapping as the NamedTuple that `hint` names; the key `skip` has been read already."""
        kind, hints = _plain(hint), fields_of(hint)
        entries = self.entries(node, name, (*kind._fields, skip))
        found: dict[str, Any] = {}
        for field in kind._fields:
            inner = f"{name}.{field}" if name else field
            if field in entries:
                found[field] = self.value(hints[field], entries[field], inner)
            elif field in kind._field_defaults:
                found[field] = kind._field_defaults[field]
            else:
                self.refuse(node, f"{inner} is missing: {self._wanted(hints[field])}")
                found[field] = None
        return kind(**found)

    def entries(self, node: yaml.Node, name: str, known: tuple[str, ...]) -> dict[str, yaml.Node]:
        """The nodes of a mapping by key; unknown and repeated keys are refused."""
        if not isinstance(node, yaml.MappingNode):
            self.refuse(node, f"{name or 'the file'} must be a block of `key: value` lines")
            return {}
        entries: dict[str, yaml.Node] = {}
        for key, value in node.value:
            word = key.value if isinstance(key, yaml.ScalarNode) else str(key.tag)
            if word == "<<":
                self.refuse(key, f"{_under(name, word)}: merge keys are not read; write the keys out")
            elif word in entries:
                self.refuse(key, f"{_under(name, word)} stands twice")
            elif word not in known:
                near = _nearest(word, known) if len(self.errors) < MOST_ERRORS else ""  # the search is slow
                self.refuse(key, f"{_under(name, word)} is not known{near}")
            else:
                entries[word] = value
        return entries

    def _tagged(self, tag: Tagged, node: yaml.Node, name: str) -> Any:
        names = ", ".join(tag.blocks)
        chosen = None
        if isinstance(node, yaml.MappingNode):
            chosen = next((v for k, v in node.value if getattr(k, "value", None) == tag.key), None)
            if chosen is None and tag.default:
                return self.block(tag.blocks[tag.default], node, name)
        if not isinstance(chosen, yaml.ScalarNode):
            self.refuse(node, f"{_under(name, tag.key)} is missing: one of {names}")
            return None
        if chosen.value not in tag.blocks:
            self.refuse(chosen, f"{_under(name, tag.key)} = {_shown(chosen.value)}; must be one of {names}")
            return None
        return self.block(tag.blocks[chosen.value], node, name, skip=tag.key)

    def _optional(self, hint: Any, plain: Any, node: yaml.Node, name: str) -> Any:
        if isinstance(node, yaml.ScalarNode) and node.tag.endswith(":null"):
            return None
        inner = next(kind for kind in get_args(plain) if kind is not type(None))
        extras = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
        return self.value(Annotated[inner, *extras] if extras else inner, node, name)

    def _list(self, plain: Any, quantity: Quantity | None, node: yaml.Node, name: str) -> Any:
        if not isinstance(node, yaml.SequenceNode):
            self.refuse(node, f"{name} must be a list: [a, b, ...]")
            return ()
        kinds = get_args(plain)
        fixed = len(kinds) if kinds[-1] is not Ellipsis else 0
        least = 0 if get_origin(kinds[0]) is Literal else 1  # a choice of words may choose none of them
        if (fixed and len(node.value) != fixed) or not least <= len(node.value) <= LONGEST_LIST:
            wanted = fixed or f"{least} to {LONGEST_LIST}"
            self.refuse(node, f"{name} has {len(node.value)} entries; must have {wanted}")
            return ()
        kind = Annotated[kinds[0], quantity] if quantity else kinds[0]
        return tuple(self.value(kind, item, f"{name}[{j}]") for j, item in enumerate(node.value))

    def _scalar(self, hint: Any, node: yaml.Node, name: str) -> Any:
        if not isinstance(node, yaml.ScalarNode):
            self.refuse(node, f"{name} must be a single value: {self._wanted(hint)}")
            return None
        quantity = quantity_of(hint)
        unit = self._unit(quantity)
        span = f"must lie in {quantity.interval} {unit}".rstrip() if quantity else ""
        try:
            value = self._convert(_plain(hint), unit, node.value)
        except (UnitError, ValueError) as error:
            reason = f"{error}; {span}" if span else str(error)
            self.refuse(node, f"{name} = {_shown(node.value)}; {reason}")
            return None
        if quantity is not None and not quantity.admits(value):
            self.refuse(node, f"{name} = {_shown(node.value)}; {span}")
        return value

    def _convert(self, plain: Any, unit: str, text: str) -> Any:
        if plain is bool:
            if text not in ("true", "false"):
                raise ValueError("must be true or false")
            return text == "true"
        if plain is int:
            return _integer(text)
        if plain is float or plain is Any:
            return self._number(text, unit)
        if get_origin(plain) is Literal:
            if text not in get_args(plain):
                raise ValueError(f"must be one of {', '.join(get_args(plain))}")
            return text
        if not text or len(text) > LONGEST_TEXT or not text.isprintable():
            raise ValueError(f"must be 1 to {LONGEST_TEXT} printable characters")
        return str(text)

    def _number(self, text: str, unit: str) -> float:
        try:
            return parse(text, unit)
        except UnitError:
            value = self._through_lead(text, unit)
            if value is None:
                raise
            return value

    def _through_lead(self, text: str, unit: str) -> float | None:
        """A table length where an angle is wanted, or the other way round: the lead converts."""
        here, lead = _family(unit), self.lengths.lead / (2.0 * math.pi)
        if here not in ("rad", "m") or self.lengths.axis != ROTARY:
            return None
        try:
            value = parse(text, unit.replace(here, "m" if here == "rad" else "rad", 1))
        except UnitError:
            return None
        if lead > 0.0:
            return value / lead if here == "rad" else value * lead
        if here == "rad":
            raise UnitError("a length on an axis without a lead: give axis.lead, or write an angle")
        return None

    def _unit(self, quantity: Quantity | None) -> str:
        unit = quantity.unit_for(self.lengths.axis) if quantity else ""
        return unit.replace("m", "rad", 1) if self.lengths.angular and _family(unit) == "m" else unit

    def _wanted(self, hint: Any) -> str:
        """What belongs here, in words."""
        tag, quantity = _tag_of(hint), quantity_of(hint)
        if tag is not None:
            return f"a block with {tag.key}: {' or '.join(tag.blocks)}"
        if quantity is not None:
            return f"{quantity.meaning}, in {self._unit(quantity)}".removesuffix(", in ")
        if hasattr(hint, "_fields"):
            needed = [field for field in hint._fields if field not in hint._field_defaults]
            return f"a block of {', '.join(needed or hint._fields)}"
        return next((extra for extra in get_args(hint)[1:] if isinstance(extra, str)), "required")


def fields_of(hint: Any) -> dict[str, Any]:
    """Hints of a block's fields; a `Quantity` beside the block itself is that of its first field.

    So a harmonic of an effort and one of a position are the same block, with different units.
    """
    kind, quantity = _plain(hint), quantity_of(hint)
    hints = get_type_hints(kind, include_extras=True)
    if quantity is not None:
        first = kind._fields[0]
        hints[first] = Annotated[_plain(hints[first]), quantity]
    return hints


def _family(unit: str) -> str:
    return unit.split("/")[0]


def _integer(text: str) -> int:
    try:
        if text.isascii() and len(text) <= LONGEST_TEXT:  # int() reads the digits of every script
            return int(text, 0)
    except ValueError:
        pass
    raise ValueError("must be a whole number")


def _under(name: str, word: str) -> str:
    return f"{name}.{_shown(word)}" if name else _shown(word)


def _shown(text: str) -> str:
    text = text if len(text) <= 60 else text[:57] + "..."
    return text if text.isprintable() and text.strip() else ascii(text)


def _nearest(word: str, known: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(word, known, n=1)
    return f"; did you mean {near[0]}?" if near else f"; known are {', '.join(sorted(k for k in known if k))}"


def _tag_of(hint: Any) -> Tagged | None:
    return (
        next((extra for extra in get_args(hint)[1:] if isinstance(extra, Tagged)), None)
        if (get_origin(hint) is Annotated)
        else None
    )


def _plain(hint: Any) -> Any:
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def load(
    path: Path, read: Callable[[Reader, yaml.Node], Any], lengths: Lengths | None = None, text: str | None = None
) -> Any:
    """Read one file with `read`, or its `text` in memory; raises ConfigError with every error found."""
    reader = Reader(path, lengths or Lengths())
    found = read(reader, compose(path, text))
    reader.finish()
    return found
