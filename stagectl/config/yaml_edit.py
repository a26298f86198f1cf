"""Characters of a YAML text changed at the marks of its nodes, and nothing else: comments and line breaks stay."""

import functools
import re
from collections.abc import Sequence
from typing import NamedTuple

import yaml

from stagectl.config.source import ConfigError, entry_of, node_at
from stagectl.problem import Problem, ProblemKind

_BETWEEN = re.compile(r"\s*:\s*(#[^\r\n]*\s*)*")  # key and value, without an anchor, alias or tag
_COMMENT = re.compile(r"(?:^|(?<=\s))#[^\r\n]*", re.MULTILINE)
_BEHIND = re.compile(r"([ \t]+)(#[^\r\n]*)")


class Place(NamedTuple):
    """An entry of a block, by its characters."""

    key: int  # where the key begins
    colon: int  # behind the colon
    begin: int  # where the value begins
    end: int  # where it ends, without blanks, comments and the line break behind


@functools.lru_cache(maxsize=4)
def root_of(text: str) -> yaml.Node:
    """The node tree of a text that has been read before.  Raises ConfigError where a change has made it unreadable."""
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        reason = f"the file cannot be changed without damage ({error}): write the values yourself"
        raise ConfigError(Problem(reason, ProblemKind.SYNTAX)) from error
    if root is None:
        raise ConfigError(Problem("the file is empty", ProblemKind.SYNTAX))
    return root


def holds(root: yaml.Node, name: str) -> bool:
    """Whether there is an entry of this dotted `name`."""
    node: yaml.Node | None = root
    for word in name.split("."):
        node = entry_of(node, word)
    return node is not None


def place_of(text: str, root: yaml.Node, name: str) -> Place:
    """The place of the entry `name`.  Raises ConfigError where a change of it would change something else, too."""
    words = name.split(".")
    parent = node_at(root, ".".join(words[:-1])) if len(words) > 1 else root
    key, value = next(entry for entry in parent.value if entry[0].value == words[-1])
    return place_between(text, key, value, name)


def place_between(text: str, key: yaml.Node, value: yaml.Node, name: str) -> Place:
    """The place of an entry by its nodes; `name` is for the error.  Raises as `place_of` does."""
    begin, behind = value.start_mark.index, key.end_mark.index
    if begin < behind or not _BETWEEN.fullmatch(text[behind:begin]) or text[begin : begin + 1] in ("&", "*", "!"):
        reason = "is written with an anchor, an alias or a tag, so that a change of it would change something else"
        raise ConfigError(Problem(reason, ProblemKind.SHAPE, name, remedy="write its value out"))
    return Place(key.start_mark.index, text.index(":", behind) + 1, begin, end_of(text, value))


def end_of(text: str, node: yaml.Node) -> int:
    """Where the last value of `node` ends; PyYAML's own mark of a block lies behind all comments that follow it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return end_of(text, last[1] if isinstance(node, yaml.MappingNode) else last)
    return len(text[: node.end_mark.index].rstrip())


def comments_in(text: str, place: Place, node: yaml.Node) -> list[str]:
    """Comments between the key and the end of its value."""
    last = place.begin if isinstance(node, yaml.ScalarNode) else place.end
    return [match[0] for match in _COMMENT.finditer(text, place.colon, last)]


def with_value(text: str, place: Place, node: yaml.Node, new: str) -> str:
    """`new` for the value at `place`; comments inside the old one go above it, the one behind stays in its column."""
    inside = comments_in(text, place, node)
    begin = place.begin
    if "\n" in text[place.colon : begin]:
        begin, new = place.colon, f" {new}"
    return above(_spliced(text, begin, place.end, new), place.key, inside)


def _spliced(text: str, begin: int, end: int, new: str) -> str:
    behind = _BEHIND.match(text, end)
    if behind is None:
        return text[:begin] + own_breaks(new, text) + text[end:]
    last = new.rsplit("\n", 1)[-1]
    used = len(last) if "\n" in new else column(text, begin) + len(last)
    gap = max(column(text, behind.start(2)) - used, min(2, len(behind[1])))
    return text[:begin] + own_breaks(new, text) + " " * gap + text[behind.start(2) :]


def above(text: str, at: int, comments: Sequence[str]) -> str:
    """With comments in separate lines above the line of character `at`."""
    start = _line_start(text, at)
    indent = re.compile(" *").match(text, start)
    lines = "".join(f"{indent[0] if indent else ''}{comment}\n" for comment in comments)
    return text[:start] + own_breaks(lines, text) + text[start:]


def dated(text: str, end: int, old: str) -> str:
    """With the comment behind a value marked as being about `old`."""
    behind = _BEHIND.match(text, end)
    if behind is None:
        return text
    return text[: behind.start(2)] + f"# before, {old}: {behind[2].lstrip('# ')}" + text[behind.end(2) :]


def with_entry(text: str, parent: yaml.MappingNode, words: Sequence[str], new: str) -> str:
    """With a new last entry in a block: ``words[0]: words[1]: ... new``, nested."""
    if parent.flow_style:
        inside = ": {".join(words) + f": {' '.join(new.split())}" + "}" * (len(words) - 1)
        at = len(text[: parent.end_mark.index - 1].rstrip())
        return text[:at] + (", " if parent.value else "") + inside + text[at:]
    first = column(text, parent.value[0][0].start_mark.index)
    lines = [f"{' ' * (first + 2 * depth)}{word}:" for depth, word in enumerate(words)]
    at = _line_end(text, end_of(text, parent))
    spaced = "\n" if first == 0 and len(words) > 1 and re.search(r"\n\r?\n", text) else ""  # as between the others
    return text[:at] + own_breaks(f"\n{spaced}" + "\n".join(lines) + f" {new}", text) + text[at:]


def without_entry(text: str, root: yaml.Node, name: str) -> str:
    """Without an entry; its comments are kept in separate lines."""
    place, node = place_of(text, root, name), node_at(root, name)
    parent, word = node_at(root, name.rsplit(".", 1)[0]), name.rsplit(".", 1)[-1]
    if isinstance(parent, yaml.MappingNode) and parent.flow_style:
        begin, end = _flow_span(text, parent, word)
        return above(text[:begin] + text[end:], parent.start_mark.index, comments_in(text, place, node))
    begin, end = _line_start(text, place.key), _line_end(text, place.end)
    label = f"{word} {text[place.begin : place.end]}" if isinstance(node, yaml.ScalarNode) else word
    kept = [_kept(line, column(text, place.key), label) for line in text[begin:end].splitlines()]
    lines = "\n".join(line for line in kept if line)
    break_ = 2 if text.startswith("\r\n", end) else min(1, len(text) - end)
    return text[:begin] + own_breaks(lines, text) + text[end if lines else end + break_ :]


def _kept(line: str, indent: int, label: str) -> str:
    """What remains of a line of a removed entry: its comment."""
    comment = _COMMENT.search(line)
    if comment is None or line.strip().startswith("#"):
        return line if comment else ""
    return f"{' ' * indent}# before, {label}: {comment[0].lstrip('# ')}"


def _flow_span(text: str, parent: yaml.MappingNode, word: str) -> tuple[int, int]:
    """The characters of an entry between braces, with the comma that goes with it."""
    keys = [key.value for key, _ in parent.value]
    at = keys.index(word)
    if at + 1 < len(keys):
        return parent.value[at][0].start_mark.index, parent.value[at + 1][0].start_mark.index
    begin = end_of(text, parent.value[at - 1][1]) if at else parent.start_mark.index + 1
    return begin, end_of(text, parent.value[at][1])


def own_breaks(new: str, text: str) -> str:
    """`new` with the line breaks that `text` has."""
    return new.replace("\n", "\r\n") if "\r\n" in text else new


def column(text: str, at: int) -> int:
    """Characters before `at` in its line."""
    return at - _line_start(text, at)


def _line_start(text: str, at: int) -> int:
    return text.rfind("\n", 0, at) + 1


def _line_end(text: str, at: int) -> int:
    """Where the line of character `at` ends, before its break."""
    end = text.find("\n", at)
    return len(text) if end < 0 else end - (text[end - 1] == "\r")
