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

from stagectl.units import LINEAR, Quantity, StageError, UnitError, parse, quantity_of

LARGEST_FILE = 4_000_000  # bytes; a configuration is text written by hand
DEEPEST = 20


class ConfigError(StageError):
    """A configuration file that cannot be used; the message lists every reason with its place."""


class Tagged(NamedTuple):
    """A union of blocks told apart by one key: ``type: sine`` chooses the block of that name."""

    key: str
    blocks: Mapping[str, Any]


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
        line = node.start_mark.line + 1 if node is not None else 1
        self.errors.append(f"{message} ({self.path}:{line})")

    def finish(self) -> None:
        """Raise ConfigError if anything was refused."""
        if self.errors:
            raise ConfigError("\n".join(self.errors))

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
            return self.block(plain, node, name)
        return self._scalar(plain, quantity, node, name)

    def block(self, kind: Any, node: yaml.Node, name: str, skip: str = "") -> Any:
        """A mapping as the NamedTuple `kind`; the key `skip` has been read already."""
        entries = self.entries(node, name, (*kind._fields, skip))
        hints = get_type_hints(kind, include_extras=True)
        found: dict[str, Any] = {}
        for field in kind._fields:
            inner = f"{name}.{field}" if name else field
            if field in entries:
                found[field] = self.value(hints[field], entries[field], inner)
            elif field in kind._field_defaults:
                found[field] = kind._field_defaults[field]
            else:
                self.refuse(node, f"{inner} is missing; it is {_wanted(hints[field], self.lengths.axis)}")
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
            if word in entries:
                self.refuse(key, f"{_under(name, word)} stands twice")
            elif word not in known:
                self.refuse(key, f"{_under(name, word)} is not known{_nearest(word, known)}")
            else:
                entries[word] = value
        return entries

    def _tagged(self, tag: Tagged, node: yaml.Node, name: str) -> Any:
        names = ", ".join(tag.blocks)
        chosen = None
        if isinstance(node, yaml.MappingNode):
            chosen = next((v for k, v in node.value if getattr(k, "value", None) == tag.key), None)
        if not isinstance(chosen, yaml.ScalarNode):
            self.refuse(node, f"{_under(name, tag.key)} is missing; it is one of {names}")
            return None
        if chosen.value not in tag.blocks:
            hint = _nearest(chosen.value, tuple(tag.blocks))
            self.refuse(chosen, f"{_under(name, tag.key)} = {chosen.value}; must be one of {names}{hint}")
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
        if (fixed and len(node.value) != fixed) or not node.value:
            self.refuse(node, f"{name} has {len(node.value)} entries; must have {fixed or 'at least 1'}")
            return ()
        kind = Annotated[kinds[0], quantity] if quantity else kinds[0]
        return tuple(self.value(kind, item, f"{name}[{j}]") for j, item in enumerate(node.value))

    def _scalar(self, plain: Any, quantity: Quantity | None, node: yaml.Node, name: str) -> Any:
        if not isinstance(node, yaml.ScalarNode):
            self.refuse(node, f"{name} must be a single value, {_wanted(plain, self.lengths.axis)}")
            return None
        try:
            value = self._convert(plain, quantity, node)
        except (UnitError, ValueError, OverflowError) as error:
            self.refuse(node, f"{name} = {_shown(node.value)}; {error}")
            return None
        if quantity is not None and not quantity.admits(value):
            unit = quantity.unit_for(self.lengths.axis)
            self.refuse(node, f"{name} = {_shown(node.value)}; must lie in {quantity.interval} {unit}".rstrip())
        return value

    def _convert(self, plain: Any, quantity: Quantity | None, node: yaml.ScalarNode) -> Any:
        text = node.value
        if plain is bool:
            if text not in ("true", "false"):
                raise ValueError("must be true or false")
            return text == "true"
        if plain is int:
            return _integer(text)
        if plain is float or plain is Any:
            return self._number(text, quantity)
        if get_origin(plain) is Literal:
            if text not in get_args(plain):
                raise ValueError(f"must be one of {', '.join(get_args(plain))}")
            return text
        if not text:
            raise ValueError("must not be empty")
        return str(text)

    def _number(self, text: str, quantity: Quantity | None) -> float:
        unit = quantity.unit_for(self.lengths.axis) if quantity else ""
        if self.lengths.angular and _family(unit) == "m":
            unit = unit.replace("m", "rad", 1)
        try:
            value = parse(text, unit)
        except UnitError as error:
            value = self._through_lead(text, unit, error)
        if not math.isfinite(value):
            raise ValueError("is too large for a number")
        return value

    def _through_lead(self, text: str, unit: str, error: UnitError) -> float:
        """A table length where an angle is wanted, or the other way round: the lead converts."""
        lead = self.lengths.lead / (2.0 * math.pi)
        if lead and _family(unit) == "rad":
            return parse(text, unit.replace("rad", "m", 1)) / lead
        if lead and _family(unit) == "m":
            return parse(text, unit.replace("m", "rad", 1)) * lead
        raise error


def _family(unit: str) -> str:
    return unit.split("/")[0]


def _integer(text: str) -> int:
    try:
        return int(text, 0)
    except ValueError:
        raise ValueError("must be a whole number") from None


def _under(name: str, word: str) -> str:
    return f"{name}.{_shown(word)}" if name else _shown(word)


def _shown(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


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


def _wanted(hint: Any, axis: str) -> str:
    quantity = quantity_of(hint)
    if quantity is None:
        words = [extra for extra in get_args(hint)[1:] if isinstance(extra, str)]
        return words[0] if words else "required"
    unit = quantity.unit_for(axis)
    return f"the {quantity.meaning}, in {unit}" if unit else f"the {quantity.meaning}"


def compose(path: Path) -> yaml.Node:
    """The file's YAML node tree.

    Raises ConfigError where the file cannot be read or is no YAML.
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise ConfigError(f"{path} is larger than {LARGEST_FILE} bytes: not a configuration file")
        node = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path} is not UTF-8 text: byte {error.start} is {error.object[error.start]:#04x}"
        ) from error
    except yaml.YAMLError as error:
        raise ConfigError(_yaml_words(path, error)) from error
    except (RecursionError, ValueError) as error:  # thousands of nested brackets; a malformed escape
        raise ConfigError(f"{path} is not usable YAML: {type(error).__name__} while parsing") from error
    if node is None:
        raise ConfigError(f"{path} is empty")
    return node


def _yaml_words(path: Path, error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    line = mark.line + 1 if mark is not None else 1
    problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "not YAML"
    return f"{problem}; check indentation, quotes and colons around this line ({path}:{line})"


def load(path: Path, read: Callable[[Reader, yaml.Node], Any], lengths: Lengths | None = None) -> Any:
    """Read one file with `read`; raises ConfigError with every error found."""
    reader = Reader(path, lengths or Lengths())
    found = read(reader, compose(path))
    reader.finish()
    return found
