"""Several axes in one stage file: what they share stands where it always does, what is each axis' own under `axes`.

::

    axes:
      x: {drive.wire.node: 5}
      y: {drive.wire.node: 6, mechanics.inertia: 0.014 kg m^2}

``machine.yaml#x`` is the stage file of the axis x wherever a stage file is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from stagectl.config.loader import Lengths, Reader, load
from stagectl.config.source import ConfigError, compose, read_text

AXES, COUPLED = "axes", "coupled"
_MOST = 16  # axes


def split(path: Path) -> tuple[Path, str]:
    """The file, and the name of the axis in it; empty where it is the only one."""
    name, _, axis = path.name.partition("#")
    return (path.with_name(name), axis) if name and axis and not path.exists() else (path, "")


def load_axis(path: Path, read: Callable[[Reader, yaml.Node], Any], text: str | None = None) -> Any:
    """Read the stage file, or the axis of one, with `read`; `text` is that of one axis, as `text_of` gives it.

    Raises ConfigError with every error found.
    """
    file, axis = split(path) if text is None else (path, "")
    return load(file, lambda reader, root: read(reader, chosen(reader, root, axis)), text=text)


def axes_of(path: Path) -> list[Path]:
    """A reference to each axis of a file; the file itself where it has one only.

    Raises ConfigError.
    """
    file, axis = split(path)
    if axis:
        return [path]
    names = [key.value for key, _ in _entries(compose(file))]
    return [file.with_name(f"{file.name}#{name}") for name in names] or [file]


def coupled(path: Path) -> bool:
    """Whether a fault of one axis stops the others: unless ``coupled: false`` stands beside `axes`."""
    return getattr(_value(compose(split(path)[0]), COUPLED), "value", "true") != "false"


def text_of(path: Path) -> str:
    """The text of a stage file; of an axis among several, what is its own filled in."""
    file, axis = split(path)
    if not axis:
        return read_text(file)
    reader = Reader(path, Lengths())
    text: str = yaml.serialize(chosen(reader, compose(file), axis), allow_unicode=True)
    reader.finish()
    return text


def chosen(reader: Reader, root: yaml.Node, axis: str) -> yaml.Node:
    """The stage file of this `axis`; as it stands where it names no axes.

    Raises ConfigError where there is no such axis.
    """
    entries = {key.value: value for key, value in _entries(root)}
    if axis not in entries:
        if axis or entries:
            raise ConfigError(_which(reader.path, axis, list(entries)))
        return root
    _check(reader, root, entries)
    for key, value in entries[axis].value if isinstance(entries[axis], yaml.MappingNode) else []:
        _put(reader, root, key, value)
    root.value = [(key, value) for key, value in root.value if key.value not in (AXES, COUPLED)]
    return root


def _which(path: Path, axis: str, there: list[str]) -> str:
    file = split(path)[0]
    if not there:
        return f"{path}: {file.name} has no block `axes`, it is one axis: leave #{axis} away"
    named = f"there is no axis {axis}" if axis else "it has several axes"
    return f"{path}: {named}: take one of {', '.join(f'{file}#{name}' for name in there)}"


def _check(reader: Reader, root: yaml.Node, entries: dict[str, yaml.Node]) -> None:
    for name, block in entries.items():
        if not name.isidentifier():
            reader.refuse(block, f"axes.{name}: the name of an axis must be a word, such as x")
        if not isinstance(block, yaml.MappingNode):
            reader.refuse(block, f"axes.{name} must be a block such as {{drive.wire.node: 6}}")
    if len(entries) > _MOST:
        reader.refuse(root, f"axes has {len(entries)} entries; must have 1 to {_MOST}")
    said = _value(root, COUPLED)
    if said is not None and getattr(said, "value", "") not in ("true", "false"):
        reader.refuse(said, f"{COUPLED} must be true or false")


def _entries(root: yaml.Node) -> list[tuple[yaml.Node, yaml.Node]]:
    """Axis names and their blocks."""
    block = _value(root, AXES)
    return list(block.value) if isinstance(block, yaml.MappingNode) else []


def _value(root: yaml.Node, name: str) -> yaml.Node | None:
    entries = root.value if isinstance(root, yaml.MappingNode) else []
    return next((value for key, value in entries if key.value == name), None)


def _put(reader: Reader, root: yaml.Node, key: yaml.Node, value: yaml.Node) -> None:
    """Put a value under its dotted name, over the one that is there; what no stage file knows is refused later."""
    *blocks, last = str(key.value).split(".")
    node = root
    for word in blocks:
        inner = _value(node, word)
        if inner is None:
            inner = yaml.MappingNode("tag:yaml.org,2002:map", [], key.start_mark, key.end_mark)
            node.value.append((yaml.ScalarNode("tag:yaml.org,2002:str", word, key.start_mark, key.end_mark), inner))
        if not isinstance(inner, yaml.MappingNode):
            reader.refuse(key, f"{key.value}: {word} is no block")
            return
        node = inner
    name = yaml.ScalarNode("tag:yaml.org,2002:str", last, key.start_mark, key.end_mark)
    node.value = [entry for entry in node.value if entry[0].value != last] + [(name, value)]
