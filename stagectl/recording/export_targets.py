"""Where an export goes, and which file it may replace: one of ours, by what no other program and no log has."""

from collections.abc import Callable, Iterable
from pathlib import Path

from stagectl.extras import arrow
from stagectl.kernels import rollout
from stagectl.problem import Problem, ProblemKind
from stagectl.recording.hdf5 import Recording, RecordingError
from stagectl.recording.in_memory import header, units_of
from stagectl.replacing import check_is_folder, check_replaceable
from stagectl.units import LINEAR, ROTARY

SUFFIXES = {"csv": ".csv", "parquet": ".parquet", "mat": ".mat", "mcap": ".mcap", "trajectory": ".yaml"}
_MAT = {"samples": "struct", "units": "struct", "meta": "char"}


def _csv(path: Path) -> bool:
    """All columns of a run: fewer of them are what we ask of a log."""
    with path.open(encoding="utf-8", errors="replace") as file:
        names = set(file.readline().strip().split(","))
    columns = (units_of(rollout.COLUMNS, kind) for kind in (ROTARY, LINEAR))
    return any(names >= {header(name, unit) for name, unit in units.items()} for units in columns)


def _parquet(path: Path) -> bool:
    try:
        return b"stagectl" in (arrow().parquet.read_schema(path).metadata or {})
    except (OSError, ValueError):  # no Parquet file
        return False


def _mat(path: Path) -> bool:
    from scipy.io import whosmat

    try:
        return {name: kind for name, _, kind in whosmat(str(path), appendmat=False)} == _MAT
    except Exception:  # whatever scipy meets in a file that is no MAT file
        return False


# A text stands in the beginning of the file; that of an MCAP file is its profile, and the library that wrote it.
MARKS: dict[str, str | Callable[[Path], bool]] = {
    "csv": _csv,
    "parquet": _parquet,
    "mat": _mat,
    "mcap": "ros2\x08\0\0\0stagectl",
    "trajectory": "# The reference of ",
}


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
        check_replaceable(target, MARKS[to] if path else "")
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
        place, marks = folder / name, {"injection": "time_s,", "setpoints": "reference_"}
        check_replaceable(place, "time_s," if listed else "")
        for what, mark in marks.items():
            check_replaceable(beside(place, what), mark if listed else "")


def beside(capture: Path, what: str) -> Path:
    """The table of the added current (`injection`), or of the setpoints, beside that of a capture."""
    return capture.with_name(f"{capture.stem}-{what}.csv")


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
