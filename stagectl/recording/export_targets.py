"""Where an export goes, and which file it may replace."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from stagectl.problem import Problem, ProblemKind
from stagectl.recording import export_marks
from stagectl.recording.hdf5 import Recording, RecordingError
from stagectl.replacing import check_is_folder, check_replaceable

SUFFIXES = {"csv": ".csv", "parquet": ".parquet", "mat": ".mat", "mcap": ".mcap", "trajectory": ".yaml"}


def targets(recordings: list[Recording], to: str, path: Path | None) -> list[Path]:
    """The file of each recording, next to it where no `path` is given.

    Raises RecordingError where one path cannot take them, StageError where it would replace what is no such export.
    """
    if path is not None and len(recordings) > 1:
        reason = f"{path} is one file for {len(recordings)} recordings; leave it out, or take a folder"
        raise RecordingError(reason, path, ProblemKind.CONFLICT)
    if path is not None:
        _check_suffix(path, to)
    found = [path or recording.path.with_suffix(SUFFIXES[to]) for recording in recordings]
    for target in found:  # under a name that nobody typed may be what somebody has written
        check_replaceable(target, export_marks.MARKS[to] if path else "")
    return found


CAPTURES, NOMINAL = "captures.yaml", "nominal.yaml"
WRITTEN = "# written by stagectl"  # the first line of both


def check_folder(folder: Path, tables: Iterable[str], named: bool) -> None:
    """Raises StageError where a folder of captures would replace what stagectl has not written, or nobody has named."""
    check_is_folder(folder)
    for name in (CAPTURES, NOMINAL):
        check_replaceable(folder / name, WRITTEN if named else "")
    listed = named and (folder / CAPTURES).is_file()  # a table alone may be a log of anybody
    for name in tables:
        for table in (name, injection_table(name), setpoints_table(name)):
            mark = "time_s," if table != setpoints_table(name) else "reference_"
            check_replaceable(folder / table, mark if listed else "")


def injection_table(name: str) -> str:
    """The table of the added current, beside the capture of this name."""
    return f"{Path(name).stem}-injection.csv"


def setpoints_table(name: str) -> str:
    """The table of the setpoints, beside the capture of this name."""
    return f"{Path(name).stem}-setpoints.csv"


def _check_suffix(path: Path, to: str) -> None:
    """Refuse a name that promises another format.  Raises RecordingError."""
    suffix = path.suffix.lower()
    others = {ending: name for name, ending in SUFFIXES.items() if name != to}
    if suffix not in {*others, ".h5"}:
        return
    own = SUFFIXES[to]
    other = f", or --to {others[suffix]}" if suffix in others else ""
    problem = Problem(f"{path}: --to {to} writes {own}", ProblemKind.CONFLICT, file=path)
    raise RecordingError(problem._replace(remedy=f"take -o {path.with_suffix(own)}{other}"))
