"""By what an export is known to be ours: something that no other program writes, and no log that is made for us has."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from stagectl.extras import arrow
from stagectl.kernels import rollout
from stagectl.recording.in_memory import header, units_of
from stagectl.units import LINEAR, ROTARY

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
