"""One thing that is wrong with an input: fields for a program, and the sentence for a person that follows from them."""

import difflib
import enum
import errno
import itertools
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple


def below(place: str, name: str) -> str:
    """The dotted path of the entry `name` in the block at `place`."""
    return f"{place}.{name}" if place else name


def nearest(word: str, known: Sequence[str]) -> str:
    """The known name that a mistyped `word` is most like, but for its case; empty where it is like none."""
    same = (name for name in known if name.casefold() == word.casefold())
    return next(itertools.chain(same, difflib.get_close_matches(word, known, 1)), "")


def meant(word: str, known: Sequence[str], otherwise: str = "must be one of") -> str:
    """``did you mean sine?``; where no known name is like the mistyped `word`, `otherwise` and all of them."""
    near = nearest(word, known)
    return f"did you mean {near}?" if near else f"{otherwise} {', '.join(known)}"


_ADDRESS = re.compile(r"(https?|ftp|file|s3):/")  # a path has one slash left of the two


def absent(path: Path) -> str:
    """What to say of a file that is not there: ``no such file or folder: did you mean config/ball-screw.yaml?``."""
    if path.is_dir():
        return f"it is a folder, and a file is expected here: choose one, see `ls {path}`"
    if path.is_symlink():
        return f"it is a link to {path.readlink()}, which is not there: see `ls -l {path}`"
    if _ADDRESS.match(str(path)):
        return "no address of a network is read: download it first, `curl -O`, and give the file"
    if str(path) == "-":
        return "standard input is not read here: write it to a file first, and give the file"
    meant, whole = _meant(path)
    if not whole and Path(path.name).exists():  # named from another folder than the one that this is
        meant, whole = Path(path.name), True
    return f"no such file or folder: {f'did you mean {meant}?' if whole else _listed(meant)}"


def _listed(there: Path) -> str:
    """Where to look, from what is `there` of a path."""
    folder = there if there.is_dir() else there.parent
    return f"see `ls {folder}`" if str(folder) != "." else f"you are in {Path.cwd()}, see `ls .`"


def _nearest_file(name: str, names: Sequence[str]) -> str:
    """The file whose stem is most like that of `name`: a common ending makes no two files alike."""
    path = Path(name)
    stems = {Path(other).stem: other for other in sorted(names, key=lambda other: Path(other).suffix == path.suffix)}
    return stems.get(nearest(path.stem, list(stems)), "")


def _meant(path: Path) -> tuple[Path, bool]:
    """What is there of a path, each name of it the nearest one; whether that is all of it.

    A ``~`` that the shell left is the home folder; a backslash separates folders on Windows.
    """
    wanted = Path(os.path.expanduser(str(path).replace("\\", "/")))
    there = Path(wanted.anchor)
    for name in wanted.relative_to(wanted.anchor).parts:
        near = name if os.path.lexists(there / name) else _nearest_file(name, _names(there))
        if not near:
            return there, False
        there /= near
    return there, True


def _names(folder: Path) -> list[str]:
    try:
        return [entry.name for entry in folder.iterdir()]
    except OSError:  # no folder, or not ours to read
        return []


_REMEDIES = {
    errno.EEXIST: "a file is where a folder is needed: choose another path",
    errno.ENOTDIR: "a file is where a folder is needed: choose another path",
    errno.EISDIR: "give the path of a file",
    errno.EACCES: "choose another path, or see `ls -ld` for who may write there",
    errno.EPERM: "choose another path: what stands there may not be changed",
    errno.EROFS: "choose another path: this disk may only be read",
    errno.ENOSPC: "make room: see `df -h`",
    errno.EDQUOT: "make room: see `quota`",
    errno.EFBIG: "choose another disk, or see `ulimit -f` for the largest file that you may write",
}


def remedy_of(cause: Exception) -> str:
    """What to do where the system refuses to write; empty where that is not known."""
    return _REMEDIES.get(getattr(cause, "errno", None) or 0, "")


def why_unread(cause: Exception) -> str:
    """Why a file could not be read, in plain words: neither an error's number nor the words of a decoder."""
    if isinstance(cause, UnicodeDecodeError):
        return f"byte {cause.start + 1} is not UTF-8 text"
    if isinstance(cause, json.JSONDecodeError):
        return f"line {cause.lineno}, column {cause.colno} is not JSON"
    return getattr(cause, "strerror", None) or str(cause)


class ProblemKind(enum.Enum):
    """What sort of mistake it is."""

    OTHER = "other"
    FILE = "file"  # there is no file that can be read
    SYNTAX = "syntax"  # the file is not YAML, CSV or text
    SHAPE = "shape"  # a list where a value belongs, a value where a block belongs
    MISSING = "missing"  # a required entry is absent
    UNKNOWN = "unknown"  # there is no entry of this name
    REPEATED = "repeated"  # an entry is written twice
    VALUE = "value"  # no number, no whole number, or none of the choices
    UNIT = "unit"  # the unit is missing, unknown or of another dimension
    RANGE = "range"  # outside the admissible interval
    CONFLICT = "conflict"  # admissible by itself, but not together with another entry
    LOOP = "loop"  # the control loop would be unstable or too close to it
    LIMIT = "limit"  # a motion exceeds a limit of the machine
    STOPPED = "stopped"  # nothing is wrong: the operator wanted it to end


class Problem(NamedTuple):
    """One problem.  `str` composes ``key = value; reason; must lie in interval unit: remedy (file:line)``."""

    reason: str = ""  # a clause: "the unit is missing"; without a value it follows the key: "is missing"
    kind: ProblemKind = ProblemKind.OTHER
    key: str = ""  # dotted path of the entry in its file, such as ``control.bandwidth`` or ``parts[1].distance``
    value: str = ""  # what was found, with its unit
    unit: str = ""  # SI unit of the entry
    interval: str = ""  # admissible values in `unit`, such as ``(0, 2000]``
    choices: tuple[str, ...] = ()  # admissible words
    remedy: str = ""  # what to do next
    file: Path | None = None
    line: int = 0  # from 1; 0 where it is not known
    admissible: str = ""  # the interval in the unit that was typed, where that is another

    def __str__(self) -> str:
        stated = (f"{self.key} = {self.value}", self.reason)
        begins = stated if self.key and self.value else (f"{self.key} {self.reason}".strip(),)
        lies = self.admissible or f"{self.interval} {self.unit}".rstrip()
        interval = f"must lie in {lies}" if self.interval else ""
        choices = f"must be one of {', '.join(self.choices)}" if self.choices else ""
        remedy = f": {self.remedy}" if self.remedy else ""
        place = f" ({self.file}:{self.line})" if self.file and self.line else ""
        return "; ".join(filter(None, (*begins, interval, choices))) + remedy + place
