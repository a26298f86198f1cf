"""From a path to a tree of YAML nodes, whatever the path turns out to be.

Only nodes are composed, never objects: no tag of a file can make Python do anything.
"""

import errno
import re
import reprlib
import stat
from itertools import accumulate
from pathlib import Path

import yaml

from stagectl.config.bounds import DEEPEST_BRACKETS, LARGEST_FILE, MOST_PROBLEMS
from stagectl.problem import Problem, ProblemKind, absent, why_unread
from stagectl.units import StageError

_GLUED = re.compile(r"^[ -]*(\w+:)([^\s:/][^\n]*?)\s*$", re.MULTILINE)  # ``dwell:0.2 s``
_HIDDEN = re.compile("[\x85\u2028\u2029]")  # YAML 1.1 breaks lines there, no editor shows it


class ConfigError(StageError):
    """A configuration file that cannot be used; `problems` holds everything that is wrong, each with file and line."""

    def __str__(self) -> str:
        """The first problems, a line each, and how many more there are."""
        shown = list(map(str, self.problems[:MOST_PROBLEMS]))
        if (more := len(self.problems) - MOST_PROBLEMS) > 0:
            shown.append(f"and {more} more errors ({self.problems[-1].file})")
        return "\n".join(shown)


class UnreadableError(ConfigError):
    """A file that is absent, not permitted, or no regular file: nothing is known of its content."""

    kind = ProblemKind.FILE


def malformed(path: Path, reason: str, line: int = 1) -> ConfigError:
    """The error for a file that cannot be parsed at `line`."""
    return ConfigError(Problem(reason, ProblemKind.SYNTAX, file=path, line=line))


def compose(path: Path, text: str | None = None) -> yaml.Node:
    """The file's YAML node tree; `text` is the file's content where that is in memory already.

    Raises UnreadableError where there is no file to read, ConfigError where it is not YAML.
    """
    text = read_text(path) if text is None else text
    _check_brackets(path, text)
    hidden = _HIDDEN.search(text)
    if hidden:
        raise _forbidden(path, text, hidden.start())
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise _syntax_error(path, text, error) from error
    except RecursionError as error:
        raise malformed(path, "blocks are nested too deep") from error
    except Exception as error:  # PyYAML lets several other kinds out on malformed escapes and directives
        raise malformed(path, f"not usable as YAML: {type(error).__name__} while parsing") from error
    if node is None:
        raise malformed(path, "the file is empty; must have `key: value` lines")
    if isinstance(node, yaml.ScalarNode) and (glued := _GLUED.search(text)):
        raise _no_blank(path, text, glued)
    return node


def _check_brackets(path: Path, text: str) -> None:
    """PyYAML takes a second for every line of a thousand brackets within each other."""
    for number, line in enumerate(text.split("\n"), 1):
        if line.count("[") + line.count("{") > DEEPEST_BRACKETS:
            depth = max(accumulate((letter in "[{") - (letter in "]}") for letter in line))
            if depth > DEEPEST_BRACKETS:
                raise malformed(path, "brackets are nested too deep", number)


def children_of(node: yaml.Node) -> list[yaml.Node]:
    """The values of a block, or the items of a list; none of a single value."""
    return list(node.value) if isinstance(node, yaml.SequenceNode) else [value for _, value in entries_of(node)]


def entry_of(node: yaml.Node | None, name: str) -> yaml.Node | None:
    """The value under `name` in a block; None where there is none, or no block."""
    return next((value for key, value in entries_of(node) if key.value == name), None)


def key_of(node: yaml.Node | None, name: str) -> yaml.Node | None:
    """The key `name` itself, as it stands in a block; None where there is none, or no block."""
    return next((key for key, _ in entries_of(node) if key.value == name), None)


def entries_of(node: yaml.Node | None) -> list[tuple[yaml.Node, yaml.Node]]:
    """Keys and values of a block; none of anything else."""
    return node.value if isinstance(node, yaml.MappingNode) else []


def node_at(node: yaml.Node, name: str) -> yaml.Node:
    """The node of a dotted `name` such as ``parts[2].distance``, or the innermost one on the way there."""
    for word in re.findall(r"[^.\[\]]+", name):
        items = {str(j): item for j, item in enumerate(node.value)} if isinstance(node, yaml.SequenceNode) else {}
        inner = items.get(word) or entry_of(node, word)
        if inner is None:
            break
        node = inner
    return node


def placed(problem: Problem, path: Path, root: yaml.Node) -> Problem:
    """`problem` with the file and the line of its key."""
    return problem._replace(file=path, line=node_at(root, problem.key).start_mark.line + 1)


def read_text(path: Path, largest: int = LARGEST_FILE) -> str:
    """Text of a regular file of at most `largest` bytes; a byte order mark is no part of it.

    Raises UnreadableError where there is no file to read, ConfigError where it is not text.
    """
    raw = _read(path, largest)
    if len(raw) > largest:
        raise malformed(path, f"larger than {largest} bytes: not a file of this kind")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if raw.startswith(b"\x89HDF"):
            raise malformed(path, "it is a recording: see `stagectl report`") from error
        line = raw.count(b"\n", 0, error.start) + 1
        raise malformed(
            path, f"not UTF-8 text: byte {error.start} is {raw[error.start]:#04x}; save it as UTF-8", line
        ) from error


def _read(path: Path, largest: int) -> bytes:
    """At most one byte more than `largest`."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # reading a pipe or a device might never end
            raise UnreadableError(_unreadable(path, "is not a file: give the path of a text file"))
        with path.open("rb") as file:
            return file.read(largest + 1)
    except FileNotFoundError as error:
        raise UnreadableError(_unreadable(path, f"cannot be read: {absent(path)}")) from error
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and error.errno != errno.ENAMETOOLONG:
            words = f"cannot be read: {why_unread(error)}; see `ls -ld {path}`"
            raise UnreadableError(_unreadable(path, words)) from error
        reason = f"{reprlib.repr(str(path))} cannot be the path of a file: {why_unread(error)}"
        raise UnreadableError(f"{reason}; give a path, not the text of a file") from error


def _unreadable(path: Path, reason: str) -> Problem:
    return Problem(f"{path} {reason}", ProblemKind.FILE, file=path)


def _syntax_error(path: Path, text: str, error: yaml.YAMLError) -> ConfigError:
    if isinstance(error, yaml.reader.ReaderError):
        return _forbidden(path, text, error.position)
    if glued := _GLUED.search(text):
        return _no_blank(path, text, glued)
    reason = getattr(error, "problem", None) or "not YAML"
    if not isinstance(error, yaml.MarkedYAMLError) or error.problem_mark is None:
        return malformed(path, f"{reason}; {_CHECK}")
    opened = error.context_mark if error.context == "while scanning a quoted scalar" else None
    if opened is not None and reason.startswith("found unexpected"):
        return malformed(path, "a quote opens here and is not closed: close it", opened.line + 1)
    mark = error.problem_mark
    return malformed(path, _in_words(reason, mark, text.splitlines()), mark.line + 1)


_CHECK = "check indentation, quotes and colons around this line"
_UNIT_OF_LIST = re.compile(r"\[([-+.,0-9eE ]{1,80})\] *([A-Za-zµ°%^/*0-9 ]{1,20})")  # ``[-50, 50] mm``


def _in_words(reason: str, mark: yaml.Mark, lines: list[str]) -> str:
    """What the parser found at `mark`, in words, and what to do."""
    if "'\\t'" in reason:
        return "a tab; YAML indents with spaces: replace each tab by two"
    if reason == "but found another document":
        return "a second document begins here; a file holds one: remove the `---`"
    if reason == "mapping values are not allowed here":
        return "a second `:` on the line: one entry a line, or all of them in { }, and a text with a colon in quotes"
    if not reason.startswith("expected <block end>"):
        return f"{reason}; {_CHECK}"
    if united := _UNIT_OF_LIST.search(lines[mark.line] if mark.line < len(lines) else ""):
        meant = ", ".join(f"{value.strip()} {united[2].strip()}" for value in united[1].split(","))
        return f"words behind a list; each value has its own unit: write [{meant}]"
    above = next((line for line in reversed(lines[: mark.line]) if line.strip()), "")
    indent = len(above) - len(above.lstrip())
    if above.lstrip().startswith("- ") and mark.column == indent:
        return "an item of a list begins with `- `, as in the line above it, and an entry after the list further left"
    return f"indented by {mark.column}, the line above it by {indent}; align what belongs together"


def _no_blank(path: Path, text: str, glued: re.Match[str]) -> ConfigError:
    line = text.count("\n", 0, glued.start(1)) + 1
    meant = f"'{glued[1]} {glued[2]}'"
    return malformed(
        path, f"a blank after the colon is missing: write {meant if meant.isprintable() else ascii(meant)}", line
    )


def _forbidden(path: Path, text: str, position: int) -> ConfigError:
    reason = f"character U+{ord(text[position]):04X} is not allowed here: delete it"
    return malformed(path, reason, text.count("\n", 0, position) + 1)
