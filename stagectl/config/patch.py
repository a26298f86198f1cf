"""Values into a stage file that somebody wrote by hand: its comments, order and formatting stay.

Only the characters of a value change.  A block that becomes another one (rolling friction, then stop operators) is
changed entry by entry; what the comments of its removed entries said is kept, with the value that it was said of.
The file is replaced in one step, and only after the new one has been read and its loop designed: a stage that would
be refused is never written.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from stagectl.config import yaml_edit
from stagectl.config.loader import Lengths
from stagectl.config.source import ConfigError, node_at, read_text
from stagectl.config.stage_file import StageFile, load_stage
from stagectl.config.unit_format import hint_at, tag_of, worded
from stagectl.units import StageError

CLOSE = 1e-6  # relative difference between what was to be written and what is read back
KEPT: Any = object()  # for the value of an entry that stays as it stands while its block becomes another one
_MARK = b"\xef\xbb\xbf"


class Change(NamedTuple):
    """What stood at a name, and what stands there now; an empty text where nothing did or does."""

    name: str
    old: str
    new: str

    def __str__(self) -> str:
        """``name: old -> new``, long lists shortened."""
        return f"{self.name}: {_short(self.old) or '(not there)'} -> {_short(self.new) or '(removed)'}"


class Patched(NamedTuple):
    """A text on its way, and what has been changed in it."""

    text: str
    changes: tuple[Change, ...] = ()


def write(source: Path, target: Path, values: Mapping[str, Any]) -> list[Change]:
    """Patch the stage file `target`, or a copy of `source` where there is none; SI values by dotted name.

    Raises ConfigError where the result would be refused, or not be read back as it was meant; `target` is then as it
    was.
    """
    base = target if target.exists() else source
    axis = load_stage(base, judged=False).file.axis  # what is refused today may be what the patch mends
    found = patched(read_text(base), values, Lengths(axis.kind, axis.lead))
    with base.open("rb") as file:
        mark = _MARK if file.read(3) == _MARK else b""
    replace_file(target, mark + found.text.encode(), lambda path: check_values(load_stage(path).file, values))
    return list(found.changes)


def patched(text: str, values: Mapping[str, Any], lengths: Lengths) -> Patched:
    """The text of a stage file with SI values set by dotted name, and what has changed.

    A mapping replaces a block: entries that it does not name are removed, those that are `KEPT` stay as they stand.
    Raises ConfigError where there is no such entry.
    """
    found = Patched(text)
    for name, value in values.items():
        hint = hint_at(StageFile, name, yaml_edit.root_of(found.text))
        found = (
            _block(found, name, value, lengths)
            if isinstance(value, Mapping)
            else _value(found, name, (value, hint), lengths)
        )
    return found


def _block(found: Patched, name: str, values: Mapping[str, Any], lengths: Lengths) -> Patched:
    root = yaml_edit.root_of(found.text)
    tag = tag_of(hint_at(StageFile, name, root))
    before = node_at(root, name) if yaml_edit.holds(root, name) else None
    old = [key.value for key, _ in before.value] if isinstance(before, yaml.MappingNode) else []
    if tag is not None:  # first: it says which entries there are
        found = _value(found, f"{name}.{tag.key}", (values[tag.key], str), lengths, dated=True)
    named = {key: value for key, value in values.items() if value is not KEPT}
    rest = {f"{name}.{key}": value for key, value in named.items() if tag is None or key != tag.key}
    inner = patched(found.text, rest, lengths)
    found = Patched(inner.text, found.changes + inner.changes)
    for key in old:
        if key not in values:
            found = _removed(found, f"{name}.{key}")
    return found


def _value(found: Patched, name: str, wanted: tuple[Any, Any], lengths: Lengths, dated: bool = False) -> Patched:
    """With one value and the hint that describes it; where a tag changes, its comment is `dated`."""
    text, root = found.text, yaml_edit.root_of(found.text)
    if not yaml_edit.holds(root, name):
        return _added(found, name, wanted, lengths)
    place = yaml_edit.place_of(text, root, name)
    old = text[place.begin : place.end]
    new = worded(*wanted, lengths, old, yaml_edit.column(text, place.colon) + 1)
    if " ".join(old.split()) == " ".join(new.split()):
        return found
    if dated:
        text = yaml_edit.dated(text, place.end, old)
    text = yaml_edit.with_value(text, place, node_at(root, name), new)
    return Patched(text, (*found.changes, Change(name, old, new)))


def _added(found: Patched, name: str, wanted: tuple[Any, Any], lengths: Lengths) -> Patched:
    """With a new entry at the end of its block; blocks that are missing on the way are added, too."""
    root, words = yaml_edit.root_of(found.text), name.split(".")
    depth = next(n for n in range(len(words) - 1, -1, -1) if n == 0 or yaml_edit.holds(root, ".".join(words[:n])))
    parent = node_at(root, ".".join(words[:depth])) if depth else root
    if not isinstance(parent, yaml.MappingNode):
        raise ConfigError(f"{'.'.join(words[:depth])} is no block of `key: value` lines, so {name} has no place")
    new = worded(*wanted, lengths, "", 2 * len(words) + len(words[-1]))
    text = yaml_edit.with_entry(found.text, parent, words[depth:], new)
    return Patched(text, (*found.changes, Change(name, "", new)))


def _removed(found: Patched, name: str) -> Patched:
    root = yaml_edit.root_of(found.text)
    place = yaml_edit.place_of(found.text, root, name)
    old = found.text[place.begin : place.end]
    return Patched(yaml_edit.without_entry(found.text, root, name), (*found.changes, Change(name, old, "")))


def _short(text: str) -> str:
    words = " ".join(text.split())
    return words if len(words) <= 60 else f"{words[:40].rsplit(',', 1)[0]}, ... {words.rsplit(',', 1)[-1].strip()}"


def check_values(file: StageFile, values: Mapping[str, Any]) -> None:
    """Raise ConfigError where a stage file that was patched with `values` does not give them."""
    for name, wanted in values.items():
        found: Any = file
        for word in name.split("."):
            found = getattr(found, word)
        if not _close(found, wanted):
            raise ConfigError(f"{name} would be read back as {found!r}, not as {wanted!r}")


def _close(found: Any, wanted: Any) -> bool:
    if wanted is KEPT:
        return True
    if isinstance(wanted, Mapping):
        return all(_close(getattr(found, key), value) for key, value in wanted.items() if hasattr(found, key))
    if isinstance(wanted, float):
        return bool(abs(found - wanted) <= CLOSE * abs(wanted))
    if isinstance(wanted, Sequence) and not isinstance(wanted, str):
        return len(found) == len(wanted) and all(_close(a, float(b)) for a, b in zip(found, wanted, strict=True))
    return bool(found == wanted)


def replace_file(target: Path, content: bytes, check: Callable[[Path], object]) -> None:
    """Write beside `target`, check that, and put it in the place of `target` in one step."""
    real = target.resolve()
    try:
        if real.exists() and not os.access(real, os.W_OK):
            raise ConfigError(f"{target} is protected against writing")
        handle, name = tempfile.mkstemp(suffix=".yaml", prefix=f".{real.stem}-", dir=real.parent)
    except OSError as error:
        raise ConfigError(f"{target} cannot be written: {error.strerror or error}") from error
    fresh = Path(name)
    try:
        _write(handle, content)
        shutil.copymode(real, fresh) if real.exists() else fresh.chmod(0o644)
        check(fresh)
        os.replace(fresh, real)
    except OSError as error:
        raise ConfigError(f"{target} cannot be written: {error.strerror or error}; it is as it was") from error
    except StageError as error:
        reason = str(error).replace(str(fresh), str(target))
        raise ConfigError(f"nothing is written: with what was found the stage would be refused.\n{reason}") from error
    finally:
        with contextlib.suppress(FileNotFoundError):
            fresh.unlink()


def _write(handle: int, content: bytes) -> None:
    with os.fdopen(handle, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
