"""From a path to a tree of YAML nodes, whatever the path turns out to be.

Only nodes are composed, never objects: no tag of a file can make Python do anything.
"""

from __future__ import annotations

import re
import stat
from itertools import accumulate
from pathlib import Path

import yaml

from stagectl.units import StageError

LARGEST_FILE = 256_000  # bytes; a configuration is text written by hand, and YAML is slow to parse
DEEPEST = 50  # brackets within each other on one line
_HIDDEN = re.compile("[\x85\u2028\u2029]")  # YAML 1.1 breaks lines there, no editor shows it


class ConfigError(StageError):
    """A configuration file that cannot be used; the message lists every reason with its place."""


class UnreadableError(ConfigError):
    """No such file, not permitted, or no file at all: nothing is known of its content."""


def compose(path: Path, text: str | None = None) -> yaml.Node:
    """The file's YAML node tree; `text` is the file's content where that is in memory already.

    Raises UnreadableError where there is no file to read, ConfigError where it is no YAML.
    """
    text = read_text(path) if text is None else text
    _check_brackets(path, text)
    hidden = _HIDDEN.search(text)
    if hidden:
        raise ConfigError(_forbidden(path, text, hidden.start()))
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise ConfigError(_words(path, text, error)) from error
    except RecursionError as error:
        raise ConfigError(f"blocks are nested too deep ({path}:1)") from error
    except Exception as error:  # PyYAML lets several other kinds out on malformed escapes and directives
        raise ConfigError(f"not usable as YAML: {type(error).__name__} while parsing ({path}:1)") from error
    if node is None:
        raise ConfigError(f"the file is empty ({path}:1)")
    return node


def _check_brackets(path: Path, text: str) -> None:
    """PyYAML takes a second for every line of a thousand brackets within each other."""
    for number, line in enumerate(text.split("\n"), 1):
        if line.count("[") + line.count("{") > DEEPEST:
            depth = max(accumulate((letter in "[{") - (letter in "]}") for letter in line))
            if depth > DEEPEST:
                raise ConfigError(f"brackets are nested too deep ({path}:{number})")


def node_at(node: yaml.Node, name: str) -> yaml.Node:
    """The node of a dotted `name` such as ``parts[2].distance``, or the innermost one on the way there."""
    for word in re.findall(r"[^.\[\]]+", name):
        entries = node.value if isinstance(node, yaml.MappingNode) else []
        items = enumerate(node.value) if isinstance(node, yaml.SequenceNode) else []
        found = [value for key, value in entries if key.value == word] + [item for j, item in items if str(j) == word]
        if not found:
            break
        node = found[0]
    return node


def read_text(path: Path, largest: int = LARGEST_FILE) -> str:
    """Text of a regular file of at most `largest` bytes; a byte order mark is no part of it.

    Raises UnreadableError where there is no file to read, ConfigError where it is no text.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # reading a pipe or a device might never end
            raise UnreadableError(f"{path} is not a file: give the path of a text file")
        with path.open("rb") as file:
            raw = file.read(largest + 1)
    except OSError as error:
        raise UnreadableError(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise UnreadableError(f"{str(path)!r} cannot be the path of a file: {error}") from error
    if len(raw) > largest:
        raise ConfigError(f"larger than {largest} bytes: not a file of this kind ({path}:1)")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ConfigError(f"not UTF-8 text: byte {error.start} is {raw[error.start]:#04x} ({path}:{line})") from error


def _words(path: Path, text: str, error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.reader.ReaderError):
        return _forbidden(path, text, error.position)
    mark = getattr(error, "problem_mark", None)
    line = mark.line + 1 if mark is not None else 1
    problem = getattr(error, "problem", None) or "not YAML"
    return f"{problem}; check indentation, quotes and colons around this line ({path}:{line})"


def _forbidden(path: Path, text: str, position: int) -> str:
    line = text.count("\n", 0, position) + 1
    return f"character U+{ord(text[position]):04X} is not allowed here: delete it ({path}:{line})"
