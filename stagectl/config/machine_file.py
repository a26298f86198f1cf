"""Several axes in one stage file: the shared entries at their usual places, and the entries of each axis under `axes`.

::

    axes:
      x: {drive.wire.node: 5}
      y: {drive.wire.node: 6, mechanics.inertia: 0.014 kg m^2}

``machine.yaml#x`` is the stage file of the axis x wherever a stage file is expected.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from stagectl.config.bounds import MOST_AXES
from stagectl.config.loader import Reader, load
from stagectl.config.source import ConfigError, compose, entries_of, entry_of, read_text
from stagectl.problem import Problem, ProblemKind

AXES, COUPLED = "axes", "coupled"


def split(path: Path) -> tuple[Path, str]:
    """The file, and the name of the axis in it; empty where the file describes one axis only."""
    name, _, axis = path.name.partition("#")
    return (path.with_name(name), axis) if name and axis and not os.path.exists(path) else (path, "")


def load_axis(path: Path, read: Callable[[Reader, yaml.Node], Any], text: str | None) -> Any:
    """Read the stage file, or the axis of one, with `read`; `text` is that of one axis, as `text_of` gives it.

    Raises ConfigError with every problem.
    """
    file, axis = split(path) if text is None else (path, "")
    return load(file, lambda reader, root: read(reader, chosen(reader, root, axis)), text=text)


def composed(path: Path, text: str | None = None) -> tuple[Path, yaml.Node]:
    """The file, and the nodes of the stage that `path` names, or of its `text`.  Raises ConfigError."""
    return split(path)[0], load_axis(path, lambda _, root: root, text)


def axes_of(path: Path) -> list[Path]:
    """A reference to each axis of a file; the file itself where it describes one axis only.  Raises ConfigError."""
    file, axis = split(path)
    if axis:
        return [path]
    names = [key for key, _ in entries_of(entry_of(compose(file), AXES))]
    for key in names:
        if not key.value.isidentifier():  # it could lead to another folder
            raise ConfigError(_misnamed(key.value)._replace(file=file, line=key.start_mark.line + 1))
    return [file.with_name(f"{file.name}#{key.value}") for key in names] or [file]


def coupled(path: Path) -> bool:
    """Whether a fault of one axis stops the others; true without ``coupled: false`` next to `axes`."""
    return getattr(entry_of(compose(split(path)[0]), COUPLED), "value", "true") != "false"


def text_of(path: Path) -> str:
    """The text of a stage file; of one axis among several, with the entries of that axis filled in."""
    file, axis = split(path)
    if not axis:
        return read_text(file)
    text: str = yaml.serialize(composed(path)[1], allow_unicode=True)
    return text


def chosen(reader: Reader, root: yaml.Node, axis: str) -> yaml.Node:
    """The nodes of this `axis`; `root` unchanged where it names no axes.

    Raises ConfigError where there is no such axis.
    """
    entries = {key.value: value for key, value in entries_of(entry_of(root, AXES))}
    if axis not in entries:
        if axis or entries:
            raise ConfigError(_which(reader.path, axis, list(entries)))
        return root
    _check(reader, root, entries)
    for key, value in entries_of(entries[axis]):
        _put(reader, root, key, value)
    root.value = [(key, value) for key, value in root.value if key.value not in (AXES, COUPLED)]
    return root


def _which(path: Path, axis: str, names: list[str]) -> Problem:
    if not names:
        reason = f"{path} has no block `axes`, it describes one axis"
        return Problem(reason, ProblemKind.UNKNOWN, remedy=f"leave out #{axis}", file=path)
    reason = f"{path} has no axis {axis}" if axis else f"{path} has several axes"
    references = ", ".join(f"{path}#{name}" for name in names)
    return Problem(reason, ProblemKind.UNKNOWN, remedy=f"take one of {references}", file=path)


def _misnamed(name: str) -> Problem:
    return Problem("the name of an axis must be a word, such as x", ProblemKind.VALUE, AXES, ascii(name))


def _check(reader: Reader, root: yaml.Node, entries: dict[str, yaml.Node]) -> None:
    for name, block in entries.items():
        if not name.isidentifier():
            reader.refuse(block, _misnamed(name))
        if not isinstance(block, yaml.MappingNode):
            reason = "must be a block such as {drive.wire.node: 6}"
            reader.refuse(block, Problem(reason, ProblemKind.SHAPE, f"{AXES}.{name}"))
    if len(entries) > MOST_AXES:
        reader.refuse(root, Problem(f"has {len(entries)} entries; must have 1 to {MOST_AXES}", ProblemKind.SHAPE, AXES))
    coupling = entry_of(root, COUPLED)
    if coupling is not None and getattr(coupling, "value", "") not in ("true", "false"):
        reader.refuse(coupling, Problem("must be true or false", ProblemKind.VALUE, COUPLED))


def _put(reader: Reader, root: yaml.Node, key: yaml.Node, value: yaml.Node) -> None:
    """Put a value under its dotted name in place of the one that is there; unknown names are refused later."""
    *blocks, last = str(key.value).split(".")
    node = root
    for word in blocks:
        inner = entry_of(node, word)
        if inner is None:
            inner = yaml.MappingNode("tag:yaml.org,2002:map", [], key.start_mark, key.end_mark)
            node.value.append((_word(word, key), inner))
        if not isinstance(inner, yaml.MappingNode):
            reader.refuse(key, Problem(f"{word} is not a block", ProblemKind.SHAPE, str(key.value)))
            return
        node = inner
    node.value = [entry for entry in node.value if entry[0].value != last] + [(_word(last, key), value)]


def _word(word: str, place: yaml.Node) -> yaml.ScalarNode:
    return yaml.ScalarNode("tag:yaml.org,2002:str", word, place.start_mark, place.end_mark)
