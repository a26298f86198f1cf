"""Which file may be replaced: one that stagectl wrote, of the kind that it writes now; no other, whoever named it."""

from __future__ import annotations

from pathlib import Path

from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError

_HEAD = 512  # bytes in which a file says what it is
PAGE = '<meta name="generator" content="stagectl">'
JSON, JSON_LINES = '{\n  "', '{"'


def check_replaceable(path: Path, mark: str) -> None:
    """Raises StageError where a file stands there without the `mark` of ours in its beginning; empty: any file."""
    if not path.is_file():  # what else may stand there, the system refuses
        return
    with path.open("rb") as file:
        head = file.read(_HEAD)
    if not (mark and (not head or mark.encode() in head)):
        raise left_as_it_is(path, "is not of the kind that is written here" if mark else "was not named")


def left_as_it_is(path: Path, why: str) -> StageError:
    """The error for a file that is not replaced, and `why`."""
    remedy = "name another file, or move this one away"
    return StageError(
        Problem(f"{path} exists, {why}, and is left as it is", ProblemKind.CONFLICT, remedy=remedy, file=path)
    )
