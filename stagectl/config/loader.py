"""YAML to NamedTuples, strictly: the type hints are the schema.

Every value is checked against the `Quantity` of its field.  Every problem has its file, line and key, the value
that was found and what is admissible.  All problems of a file are reported together.  Unknown keys are errors.
"""

import contextlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import yaml

from stagectl.config.bounds import LONGEST_LIST, LONGEST_SHOWN, LONGEST_TEXT, MOST_PROBLEMS
from stagectl.config.hints import extras_of, fields_of, is_union, meaning_of, plain, tag_of, without_none
from stagectl.config.lengths import Lengths
from stagectl.config.source import ConfigError, compose, entries_of, entry_of, key_of
from stagectl.problem import Problem, ProblemKind, below, nearest
from stagectl.units import Quantity, StageError, Tagged, quantity_of, unit_in

_OBJECT = re.compile(r"[0-9A-Fa-f]{4}_[0-9A-Fa-f]{1,2}")  # of a drive's dictionary, without its 0x
_MERGE = "<<"
_MERGED = Problem("is a merge key, which is not read: write the keys out", ProblemKind.UNKNOWN)
_ZEROS = re.compile(r"0+[1-9][0-9]*")  # YAML of old read 010 as 8
_POWER = re.compile(r"(2|10)(?:\^|\*\*)([0-9]{1,2})")


class Reader:
    """One file being read: collects problems and goes on."""

    def __init__(self, path: Path, lengths: Lengths) -> None:
        self.path, self.lengths = path, lengths
        self.problems: list[Problem] = []
        self._outermost: tuple[str, ...] = ()  # what may stand at the left margin

    def refuse(self, node: yaml.Node, problem: Problem) -> None:
        """Note a problem at the line of `node`."""
        self.problems.append(problem._replace(file=self.path, line=node.start_mark.line + 1))

    def finish(self) -> None:
        """Raise ConfigError if anything was refused."""
        if self.problems:
            raise ConfigError(*self.problems)

    def value(self, hint: Any, node: yaml.Node, name: str) -> Any:
        """`node` as `hint`; after a problem any stand-in, as `finish` will raise."""
        tag, kind = tag_of(hint), plain(hint)
        if tag is not None:
            return self._tagged(tag, node, name)
        if is_union(kind):
            return self._optional(hint, node, name)
        if get_origin(kind) is tuple:
            return self._list(hint, node, name)
        if hasattr(kind, "_fields"):
            return self.block(hint, node, name)
        return self._scalar(hint, node, name)

    def block(self, hint: Any, node: yaml.Node, name: str, skip: str = "") -> Any:
        """A mapping as the NamedTuple that `hint` names; the key `skip` has been read already."""
        kind, hints = plain(hint), fields_of(hint)
        entries = self.entries(node, name, (*kind._fields, skip))
        values: dict[str, Any] = {}
        for field in kind._fields:
            key = below(name, field)
            if field in entries:
                values[field] = self.value(hints[field], entries[field], key)
            elif field in kind._field_defaults:
                values[field] = kind._field_defaults[field]
            else:
                wanted = self._wanted(hints[field])
                self.refuse(node, Problem("is missing", ProblemKind.MISSING, key, remedy=wanted))
                values[field] = None
        return kind(**values)

    def entries(self, node: yaml.Node, name: str, known: tuple[str, ...]) -> dict[str, yaml.Node]:
        """The nodes of a mapping by key; unknown and repeated keys are refused."""
        if not isinstance(node, yaml.MappingNode):
            reason = f"{'' if name else 'the file '}must be a block of `key: value` lines"
            self.refuse(node, Problem(reason, ProblemKind.SHAPE, name))
            return {}
        self._outermost = self._outermost if name else known
        entries: dict[str, yaml.Node] = {}
        for key, value in node.value:
            word = key.value if isinstance(key, yaml.ScalarNode) else str(key.tag)
            problem = self._wrong_key(word, known, word in entries, isinstance(value, yaml.MappingNode))
            if problem is None:
                entries[word] = value
            else:
                self.refuse(key, problem._replace(key=below(name, _shown(word))))
        return entries

    def _wrong_key(self, word: str, known: tuple[str, ...], repeated: bool, block: bool) -> Problem | None:
        if word == _MERGE:
            return _MERGED
        if repeated:
            return Problem("is written twice", ProblemKind.REPEATED, remedy="remove one")
        if word in known:
            return None
        if block and word in self._outermost:
            return Problem("is a block of its own", ProblemKind.UNKNOWN, remedy=f"write {word}: at the left margin")
        near = nearest(word, known) if len(self.problems) < MOST_PROBLEMS else ""  # the search is slow
        remedy = f"did you mean {near}?" if near else f"known are {', '.join(sorted(filter(None, known)))}"
        return Problem("is not known", ProblemKind.UNKNOWN, remedy=remedy)

    def _without_tag(self, node: yaml.Node, tag: Tagged, name: str) -> None:
        """Refuse a block that does not say its kind, or says it in capitals."""
        for key, _ in entries_of(node):
            if isinstance(key, yaml.ScalarNode) and key.value.casefold() == tag.key != key.value:
                remedy = f"did you mean {tag.key}?"
                self.refuse(key, Problem("is not known", ProblemKind.UNKNOWN, below(name, key.value), remedy=remedy))
                return
        choices = tuple(tag.blocks)
        self.refuse(node, Problem("is missing", ProblemKind.MISSING, below(name, tag.key), choices=choices))

    def _tagged(self, tag: Tagged, node: yaml.Node, name: str) -> Any:
        if not name and not isinstance(node, yaml.MappingNode):
            return self.entries(node, name, ())
        key, choices = below(name, tag.key), tuple(tag.blocks)
        chosen = entry_of(node, tag.key)
        if chosen is None and tag.default and isinstance(node, yaml.MappingNode):
            return self.block(tag.blocks[tag.default], node, name)
        if chosen is None and (merge := key_of(node, _MERGE)) is not None:  # the key may stand in what it merges
            self.refuse(merge, _MERGED._replace(key=below(name, _MERGE)))
            return None
        if not isinstance(chosen, yaml.ScalarNode):
            self._without_tag(node, tag, name)
            return None
        if chosen.value not in tag.blocks:
            self.refuse(chosen, Problem("", ProblemKind.VALUE, key, _shown(chosen.value), choices=choices))
            return None
        return self.block(tag.blocks[chosen.value], node, name, skip=tag.key)

    def _optional(self, hint: Any, node: yaml.Node, name: str) -> Any:
        if isinstance(node, yaml.ScalarNode) and node.tag.endswith(":null"):
            return None
        inner, extras = without_none(hint), extras_of(hint)
        return self.value(Annotated[inner, *extras] if extras else inner, node, name)

    def _list(self, hint: Any, node: yaml.Node, name: str) -> Any:
        kinds, quantity = get_args(plain(hint)), quantity_of(hint)
        fixed = len(kinds) if kinds[-1] is not Ellipsis else 0
        if not isinstance(node, yaml.SequenceNode):
            number = isinstance(node, yaml.ScalarNode) and node.value[:1].isdigit() and len(node.value) <= LONGEST_SHOWN
            remedy = f"[-{node.value}, {node.value}]" if fixed == 2 and number else "[a, b, ...]"
            self.refuse(node, Problem("must be a list", ProblemKind.SHAPE, name, remedy=f"such as {remedy}"))
            return ()
        least = 0 if get_origin(kinds[0]) is Literal else 1  # a choice of words may choose none of them
        if (fixed and len(node.value) != fixed) or not least <= len(node.value) <= LONGEST_LIST:
            entries = "1 entry" if len(node.value) == 1 else f"{len(node.value)} entries"
            reason = f"has {entries}; must have {fixed or f'{least} to {LONGEST_LIST}'}"
            self.refuse(node, Problem(reason, ProblemKind.SHAPE, name))
            return ()
        kind = Annotated[kinds[0], quantity] if quantity else kinds[0]
        return tuple(self.value(kind, item, f"{name}[{j}]") for j, item in enumerate(node.value))

    def _scalar(self, hint: Any, node: yaml.Node, name: str) -> Any:
        if not isinstance(node, yaml.ScalarNode):
            wanted = self._wanted(hint)
            self.refuse(node, Problem("must be a single value", ProblemKind.SHAPE, name, remedy=wanted))
            return None
        quantity = quantity_of(hint)
        unit, interval = self.lengths.unit_of(quantity), quantity.interval if quantity else ""
        out_of_range = Problem("", ProblemKind.RANGE, name, _shown(node.value), unit, interval)
        out_of_range = out_of_range._replace(admissible=self._admissible(quantity, node.value))
        try:
            value = self._convert(plain(hint), unit, node.value)
        except StageError as error:
            cause = error.problems[0]
            problem = out_of_range._replace(reason=cause.reason, kind=cause.kind, choices=cause.choices)
            self.refuse(node, problem._replace(remedy=cause.remedy))
            return None
        if quantity is not None and not quantity.admits(value):
            self.refuse(node, out_of_range)
        return value

    def _admissible(self, quantity: Quantity | None, text: str) -> str:
        """The interval in the unit that was typed, or in that of the table where none was; empty: in SI."""
        unit = self.lengths.unit_of(quantity)
        of_table = unit.replace("rad", "mm") if self.lengths.angle_per_length(unit) else unit
        typed = unit_in(text) or of_table
        if quantity is None or typed == unit:
            return ""
        with contextlib.suppress(StageError):  # a unit of something else
            return quantity.interval_in(typed, self.lengths.number(f"1 {typed}", unit))
        return ""

    def _convert(self, kind: Any, unit: str, text: str) -> Any:
        if kind is bool:
            return _chosen(text, ("true", "false")) == "true"
        if kind is int:
            return _integer(text)
        if kind is float or kind is Any:
            return self.lengths.number(text, unit)
        if get_origin(kind) is Literal:
            return _chosen(text, get_args(kind))
        if not text or len(text) > LONGEST_TEXT or not text.isprintable():
            raise _unusable(f"must be 1 to {LONGEST_TEXT} printable characters")
        return str(text)

    def _wanted(self, hint: Any) -> str:
        """What belongs here, in words."""
        tag, quantity, kind = tag_of(hint), quantity_of(hint), plain(hint)
        if tag is not None:
            return f"a block with {tag.key}: {' or '.join(tag.blocks)}"
        if quantity is not None:
            return f"{quantity.meaning}, in {self.lengths.unit_of(quantity)}".removesuffix(", in ")
        if hasattr(kind, "_fields"):
            required = [field for field in kind._fields if field not in kind._field_defaults]
            return f"a block of {', '.join(required or kind._fields)}"
        return meaning_of(hint) or "required"


def _chosen(text: str, choices: tuple[str, ...]) -> str:
    if text not in choices:
        raise StageError(Problem("", ProblemKind.VALUE, choices=choices))
    return text


def _integer(text: str) -> int:
    try:
        # int() reads the digits of every script, and 6071_00 as 607100: that is an object without its 0x.
        if text.isascii() and len(text) <= LONGEST_TEXT and not _OBJECT.fullmatch(text):
            return int(text, 0)
    except ValueError:
        pass
    raise _unusable("must be a whole number", _whole(text))


def _whole(text: str) -> str:
    """How to write the whole number that is meant."""
    if _OBJECT.fullmatch(text):
        return f"an object is hexadecimal, write 0x{text}"
    if _ZEROS.fullmatch(text):
        return f"without a leading zero, write {text.lstrip('0')}"
    power = _POWER.fullmatch(text)
    return f"write {int(power[1]) ** int(power[2])}" if power else ""


def _unusable(reason: str, remedy: str = "") -> StageError:
    return StageError(Problem(reason, ProblemKind.VALUE, remedy=remedy))


def _shown(text: str) -> str:
    text = text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."
    return text if text.isprintable() and text.strip() else ascii(text)


def load(
    path: Path, read: Callable[[Reader, yaml.Node], Any], lengths: Lengths | None = None, text: str | None = None
) -> Any:
    """Read one file with `read`, or its `text` in memory; raises ConfigError with every problem of the file."""
    reader = Reader(path, lengths or Lengths())
    content = read(reader, compose(path, text))
    reader.finish()
    return content
