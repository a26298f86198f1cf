"""Changes of one axis into the file that describes several: as entries of that axis, what the axes share stays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import yaml

from stagectl.config import yaml_edit
from stagectl.config.machine_file import AXES, split
from stagectl.config.source import children_of, node_at

_ON_ONE_LINE = 100_000  # characters, more than any block has


def into_axis(text: str, axis: str, changes: Sequence[tuple[str, str, str]], patched: str) -> str:
    """`text`, of several axes, with `changes` (name, old, new) of one `axis`; `patched` is the text of that axis alone.

    A block that loses entries becomes an entry of the axis as a whole: the shared one must keep them.
    """
    whole = {name.split(".")[0] for name, _, new in changes if not new}
    for name, _, new in changes:
        if name.split(".")[0] not in whole:
            text = _with_entry(text, axis, name, new)
    for block in sorted(whole):
        text = _with_entry(text, axis, block, _flow(node_at(yaml_edit.root_of(patched), block)))
    return text


def axis_reference(path: Path, source: Path) -> Path:
    """`path` as the stage file of the axis that `source` names."""
    file, axis = split(path)[0], split(source)[1]
    return file.with_name(f"{file.name}#{axis}") if axis else path


def _with_entry(text: str, axis: str, name: str, new: str) -> str:
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
