"""Which file may be replaced: one that stagectl wrote, of the kind that it writes now; no other, whoever named it.

And how: the new one is written beside the old one and takes its place at the end.
"""

import contextlib
import itertools
import json
import os
import shutil
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError

_HEAD = 512  # bytes in which a file says what it is
PAGE = '<meta name="generator" content="stagectl">'
WRITTEN_BY = {"written_by": "stagectl"}  # the first entry of our JSON, as any other program's looks like it
JSON, JSON_LINES = '{\n  "written_by": "stagectl"', '{"written_by": "stagectl"'


def check_replaceable(
    path: Path, mark: str | Callable[[Path], bool], why: str = "was not written by stagectl as a file of this kind"
) -> None:
    """Raises StageError where a file stands there that is none of ours: without the `mark` in its beginning.

    `mark` may be a function that knows; an empty one refuses any file.  `why` says what a file without it is not.
    A `PAGE` must have the name of one, too: what is written there would be taken for something else.
    """
    if mark == PAGE and path.suffix.lower() not in (".html", ".htm"):
        reason, remedy = f"{path}: a page ends in .html", f"take {path.with_suffix('.html')}"
        raise StageError(Problem(reason, ProblemKind.FILE, remedy=remedy))
    if not path.is_file():  # what else may stand there, the system refuses
        return
    if not (mark and (not path.stat().st_size or (mark(path) if callable(mark) else _begins(path, mark)))):
        raise left_as_it_is(path, why if mark else "was not named")


def _begins(path: Path, mark: str) -> bool:
    with path.open("rb") as file:
        return mark.encode() in file.read(_HEAD)


def check_ending(path: Path, ending: str, what: str) -> None:
    """Raises StageError where a result under this name would be taken for something else."""
    if path.suffix != ending:
        meant = path / f"NAME{ending}" if path.is_dir() else path.with_suffix(ending)
        raise _refused(path, f"is not the name of {what}, which ends in {ending}", f"take {meant}")


def not_taken(path: Path, others: Collection[Path] = ()) -> Path:
    """`path`, or with a number behind its name where that or one of `others` has it: two may begin in one second."""
    names = itertools.chain([path], (path.with_name(f"{path.stem}-{n}{path.suffix}") for n in itertools.count(2)))
    return next(name for name in names if not name.exists() and name not in others)


def check_is_file(path: Path) -> None:
    """Raises StageError where a folder, a device or a pipe stands where a file is to be written."""
    if path.exists() and not path.is_file():
        what = "is a folder" if path.is_dir() else "is no ordinary file"
        raise _refused(path, f"{what} and is left as it is", "name a file")


def check_is_folder(path: Path) -> None:
    """Raises StageError where a file stands where a folder is to be written."""
    if path.exists() and not path.is_dir():
        raise _refused(path, "is a file and no folder", "name a folder, or move the file away")


def check_folder_to_be(path: Path) -> None:
    """Raises StageError where this folder cannot be made or written into, before the work whose results go there."""
    check_is_folder(path)
    there = next(place for place in (path.absolute(), *path.absolute().parents) if place.exists())
    if not there.is_dir():
        raise _refused(path, f"cannot be written: {there} is a file where a folder is needed", "name another folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise _refused(path, f"cannot be written: you may not write into {there}", "name another folder")


def check_file_to_be(path: Path) -> None:
    """Raises StageError where this file cannot be written, before the work whose result goes there."""
    if path.is_dir():
        raise _refused(path, "is a folder", "give the name of a file")
    if not path.exists():
        check_folder_to_be(path.parent)


def left_as_it_is(path: Path, why: str) -> StageError:
    """The error for a file that is not replaced, and `why`."""
    remedy = "name another file, or move this one away"
    return _refused(path, f"exists, {why}, and is left as it is", remedy, ProblemKind.CONFLICT)


def _refused(path: Path, why: str, remedy: str, kind: ProblemKind = ProblemKind.FILE) -> StageError:
    return StageError(Problem(f"{path} {why}", kind, remedy=remedy, file=path))


@contextlib.contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A path beside `path` to write to; what is written there takes its place at the end, else nothing changes.

    A link stays one; a device or a pipe is written to itself.  An OSError names `path`.
    """
    place = path.resolve()
    with naming(path):
        if place.exists() and not place.is_file():
            yield place
            return
        if place.exists() and not os.access(place, os.W_OK):
            raise PermissionError(13, "it is protected against writing")
        fresh = place.with_name(f".{place.stem}-{os.getpid()}{place.suffix}")
        try:
            yield fresh
            _put(fresh, place)
        finally:
            fresh.unlink(missing_ok=True)


def _put(fresh: Path, place: Path) -> None:
    """Let a whole file, that is on the disk, take the place of another."""
    with fresh.open("rb") as file:
        os.fsync(file.fileno())
    if place.exists():
        shutil.copymode(place, fresh)
    os.replace(fresh, place)


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let an OSError inside name this file: that of a full disk names none, that of a helper file names it."""
    try:
        yield
    except OSError as error:
        error.filename = str(path)
        raise


def json_text(result: dict[str, Any]) -> str:
    """A result as JSON that is known to be ours, see `JSON`."""
    return json.dumps({**WRITTEN_BY, **result}, indent=2, allow_nan=False) + "\n"


def write_json(path: Path, result: dict[str, Any]) -> None:
    """Write a result where no file, or JSON of ours, stands.  Raises StageError where another file does."""
    check_replaceable(path, JSON)
    write_text(path, json_text(result))


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all, in a folder that exists afterwards."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replaced(path) as fresh:
        fresh.write_text(text, encoding="utf-8")
