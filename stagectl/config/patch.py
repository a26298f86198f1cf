"""Values into a stage file that somebody wrote by hand: its comments, order and formatting stay.

Only the characters of a value change.  A block that becomes another one (rolling friction, then stop operators) is
changed entry by entry; the comments of its removed entries are kept, each with the value that it was about.
The file is replaced in one step, and only after the new one has been read and its loop designed: a stage that would
be refused is never written.
"""

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_args

import yaml

from stagectl.config import yaml_edit
from stagectl.config.bounds import LONGEST_SHOWN, SAME_VALUE
from stagectl.config.hints import plain, tag_of, without_none
from stagectl.config.lengths import Lengths
from stagectl.config.machine_file import AXES, split, text_of
from stagectl.config.source import ConfigError, children_of, entries_of, node_at, read_text
from stagectl.config.stage_blocks import StageFile
from stagectl.config.stage_file import load_stage
from stagectl.config.unit_format import hint_at, worded
from stagectl.problem import Problem, ProblemKind
from stagectl.replacing import check_file_to_be, replaced
from stagectl.units import StageError, UnitError, quantity_of

_REFUSED = (
    "nothing is written, as the changed stage would be refused; change this in the stage file first, then repeat the "
    "command:"
)
_ON_ONE_LINE = 100_000  # characters, more than any block has
KEPT: Any = object()  # the value of an entry that stays as it is while its block becomes another one
_NUMBER = re.compile(r"[+-]?[0-9.]+(e[+-]?[0-9]+)?", re.IGNORECASE)
_MARK = b"\xef\xbb\xbf"


class Change(NamedTuple):
    """The old and the new text of an entry; empty where there was or is none."""

    name: str
    old: str
    new: str

    def __str__(self) -> str:
        """``name: old -> new``, long lists shortened."""
        return f"{self.name}: {_short(self.old) or '(not there)'} -> {_short(self.new) or '(removed)'}"


class Patched(NamedTuple):
    """A text that is being changed, the changes so far, and all values that were set."""

    text: str
    changes: tuple[Change, ...] = ()
    values: tuple[tuple[str, Any], ...] = ()  # by dotted name, SI


class Entry(NamedTuple):
    """A value that is to be written."""

    name: str  # dotted
    value: Any  # SI
    hint: Any  # type hint that describes it
    lengths: Lengths


def write(source: Path, target: Path, values: Mapping[str, Any]) -> list[Change]:
    """Write `target`, a copy of the stage file `source` with SI values by dotted name; or patch `source` itself.

    Values of one axis among several (``xy.yaml#x``) become entries of that axis.

    Raises ConfigError where another file of that name is there, the result would be refused, or would not be read back
    as it was meant; `target` is then as it was.
    """
    check_target(source, target)
    file, target = split(source)[0], split(target)[0]
    axis = load_stage(source, designed=False).file.axis  # the patch may be what makes a refused loop run
    result = patched(text_of(source), values, Lengths(axis.kind, axis.lead))
    with file.open("rb") as opened:
        mark = _MARK if opened.read(3) == _MARK else b""
    content = mark + in_its_file(source, result.text, result.changes).encode()
    replace_file(target, content, lambda path: check_values(load_stage(axis_reference(path, source)).file, result))
    return list(result.changes)


def check_target(source: Path, target: Path) -> None:
    """Raises ConfigError where `write` would not write this copy of `source`: asked before the work that it ends."""
    if target != source and split(target)[0].suffix not in (".yaml", ".yml"):
        reason = f"{target} does not end in .yaml, as a stage file does"
        raise ConfigError(Problem(reason, ProblemKind.FILE, remedy=f"take {target}.yaml", file=target))
    file, target = split(source)[0], split(target)[0]
    if target.exists() and not target.samefile(file):
        reason = f"{target} exists: choose another name, or patch that file by naming it as the stage file"
        raise ConfigError(Problem(reason, ProblemKind.CONFLICT))
    check_file_to_be(target)


def in_its_file(source: Path, text: str, changes: Sequence[Change]) -> str:
    """The changed `text` of the stage `source` as its file holds it; of one axis among several, as entries of it.

    What the axes share stays: a block that loses entries becomes an entry of the axis as a whole.
    """
    file, axis = split(source)
    if not axis:
        return text
    plane, whole = read_text(file), {change.name.split(".")[0] for change in changes if not change.new}
    for change in changes:
        if change.name.split(".")[0] not in whole:
            plane = _axis_with(plane, axis, change.name, change.new)
    for block in sorted(whole):
        plane = _axis_with(plane, axis, block, _flow(node_at(yaml_edit.root_of(text), block)))
    return plane


def axis_reference(path: Path, source: Path) -> Path:
    """`path` as the stage file of the axis that `source` names."""
    file, axis = split(path)[0], split(source)[1]
    return file.with_name(f"{file.name}#{axis}") if axis else path


def _axis_with(text: str, axis: str, name: str, new: str) -> str:
    """With an entry of the axis under its dotted name, which is one key there."""
    block = node_at(yaml_edit.root_of(text), f"{AXES}.{axis}")
    for key, value in block.value:
        if key.value == name:
            return yaml_edit.with_value(text, yaml_edit.place_between(text, key, value, name), value, new)
    assert isinstance(block, yaml.MappingNode)  # as the axis has been read
    return yaml_edit.with_entry(text, block, [name], new)


def _flow(node: yaml.Node) -> str:
    """A block in braces, on one line."""
    for part in [node, *children_of(node)]:
        if isinstance(part, yaml.CollectionNode):
            part.flow_style = True
    text: str = yaml.serialize(node, allow_unicode=True, width=_ON_ONE_LINE)
    return text.strip()


def patched(text: str, values: Mapping[str, Any], lengths: Lengths) -> Patched:
    """The text of a stage file with values set by dotted name, and what has changed.

    A value is in SI, or a text with its unit.  They are set one after the other: a block that is replaced decides which
    entries there are for those that follow.  A mapping replaces a block: entries that it does not name are removed,
    those that are `KEPT` stay as they are.
    Raises ConfigError where there is no such entry, or the unit does not fit.
    """
    result = Patched(text)
    for name, value in values.items():
        hint = hint_at(StageFile, name, yaml_edit.root_of(result.text))
        if isinstance(value, Mapping):
            result = _with_block(result, name, value, lengths)
        else:
            number = _in_si(name, value, hint, lengths)
            result = _with_value(result, Entry(name, number, hint, lengths))
            result = result._replace(values=(*result.values, (name, number)))
    return result


def _in_si(name: str, value: Any, hint: Any, lengths: Lengths) -> Any:
    """One value, or each of a list; as it is where the file has no number there."""
    kind, quantity = without_none(hint), quantity_of(hint)
    if get_args(kind)[:1] == (float,) and isinstance(value, list | tuple):
        return [_in_si(name, each, Annotated[float, quantity], lengths) for each in value]
    if plain(kind) is not float or isinstance(value, bool):
        return value
    if isinstance(value, Real):
        return float(value)  # 3 is the number 3.0: both are written and read back in the same way
    unit = lengths.unit_of(quantity)
    if not isinstance(value, str):
        reason = "must be a single value: a number in SI, or text with its unit"
        raise ConfigError(Problem(reason, ProblemKind.SHAPE, name, repr(value), unit))
    try:
        return lengths.number(value, unit)
    except UnitError as error:
        remedy = f"write '{value} {unit}', or the number {value}" if _NUMBER.fullmatch(value) else ""
        raise ConfigError(Problem(str(error), ProblemKind.UNIT, name, value, unit, remedy=remedy)) from error


def _with_block(before: Patched, name: str, values: Mapping[str, Any], lengths: Lengths) -> Patched:
    root, result = yaml_edit.root_of(before.text), before
    tag = tag_of(hint_at(StageFile, name, root))
    block = node_at(root, name) if yaml_edit.holds(root, name) else None
    old = [key.value for key, _ in entries_of(block)]
    if tag is not None:  # first: it decides which entries there are
        result = _with_value(result, Entry(f"{name}.{tag.key}", values[tag.key], str, lengths), dated=True)
    written = {key: value for key, value in values.items() if value is not KEPT}
    rest = {f"{name}.{key}": value for key, value in written.items() if tag is None or key != tag.key}
    inner = patched(result.text, rest, lengths)
    result = Patched(inner.text, result.changes + inner.changes, result.values + inner.values)
    for key in old:
        if key not in values:
            result = _without(result, f"{name}.{key}")
    return result


def _with_value(before: Patched, entry: Entry, dated: bool = False) -> Patched:
    """With one value; `dated`: the comment of the old value says that it was about the old value."""
    text, root = before.text, yaml_edit.root_of(before.text)
    if not yaml_edit.holds(root, entry.name):
        return _with_new(before, entry)
    place = yaml_edit.place_of(text, root, entry.name)
    old = text[place.begin : place.end]
    new = worded(entry.value, entry.hint, entry.lengths, old, yaml_edit.column(text, place.colon) + 1)
    if " ".join(old.split()) == " ".join(new.split()):
        return before
    if dated:
        text = yaml_edit.dated(text, place.end, old)
    text = yaml_edit.with_value(text, place, node_at(root, entry.name), new)
    return before._replace(text=text, changes=(*before.changes, Change(entry.name, old, new)))


def _with_new(before: Patched, entry: Entry) -> Patched:
    """With a new entry at the end of its block; missing blocks on the way are added, too."""
    root, words = yaml_edit.root_of(before.text), entry.name.split(".")
    depth = next(n for n in range(len(words) - 1, -1, -1) if n == 0 or yaml_edit.holds(root, ".".join(words[:n])))
    parent = node_at(root, ".".join(words[:depth])) if depth else root
    if not isinstance(parent, yaml.MappingNode):
        reason = f"is not a block of `key: value` lines, so {entry.name} has no place"
        raise ConfigError(Problem(reason, ProblemKind.SHAPE, ".".join(words[:depth])))
    new = worded(entry.value, entry.hint, entry.lengths, "", 2 * len(words) + len(words[-1]))
    text = yaml_edit.with_entry(before.text, parent, words[depth:], new)
    return before._replace(text=text, changes=(*before.changes, Change(entry.name, "", new)))


def _without(before: Patched, name: str) -> Patched:
    root = yaml_edit.root_of(before.text)
    place = yaml_edit.place_of(before.text, root, name)
    old = before.text[place.begin : place.end]
    text = yaml_edit.without_entry(before.text, root, name)
    return before._replace(text=text, changes=(*before.changes, Change(name, old, "")))


def _short(text: str) -> str:
    words = " ".join(text.split())
    if len(words) <= LONGEST_SHOWN:
        return words
    return f"{words[:40].rsplit(',', 1)[0]}, ... {words.rsplit(',', 1)[-1].strip()}"


def check_values(file: StageFile, patch: Patched) -> None:
    """Raise ConfigError where a stage file with this patch does not give the values that it sets."""
    for name, wanted in patch.values:
        read: Any = functools.reduce(getattr, name.split("."), file)
        if not _close(read, wanted):
            raise ConfigError(Problem(f"would be read back as {read!r}, not as {wanted!r}", ProblemKind.VALUE, name))


def _close(read: Any, wanted: Any) -> bool:
    if isinstance(wanted, float):
        return bool(abs(read - wanted) <= SAME_VALUE * abs(wanted))
    if isinstance(wanted, Sequence) and not isinstance(wanted, str):
        return len(read) == len(wanted) and all(
            _close(a, b if isinstance(b, str) else float(b)) for a, b in zip(read, wanted, strict=True)
        )
    return bool(read == wanted)


def replace_file(target: Path, content: bytes, check: Callable[[Path], object]) -> None:
    """Write a new file next to `target`, check it, and replace `target` by it in one step."""
    try:
        with replaced(target) as fresh:
            fresh.write_bytes(content)
            check(fresh)
    except OSError as error:
        reason = f"{target} cannot be written: {error.strerror or error}; it is as it was"
        raise ConfigError(Problem(reason, ProblemKind.FILE, file=target)) from error
    except StageError as error:
        reasons = (p._replace(file=None, line=0) if p.file == fresh else p for p in error.problems)  # on no disk
        raise ConfigError(_REFUSED, *reasons) from error
