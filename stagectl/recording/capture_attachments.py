"""Files that captures.yaml names for a capture: the current that was added to its command, and its setpoints.

The header of an injection has ``injection_A`` (or one other column in A or mA) and, where its rows are not those of the
capture, ``time_s``: then a value holds from its time on, as a controller adds it, and none was added outside.

Setpoints are an addition of our own exports: with them a loop is simulated again to the last bit, where a spline
through the reference is another curve than the motion's own formula.
"""

from pathlib import Path
from typing import Any

import numpy as np

from stagectl.extras import arrow
from stagectl.kernels.law import Setpoint
from stagectl.problem import ProblemKind
from stagectl.recording.columns import Array
from stagectl.recording.constants import EARLY
from stagectl.recording.hdf5 import RecordingError, quantities
from stagectl.recording.in_memory import header
from stagectl.recording.scales import bases_of
from stagectl.units import factor

NAME = "injection_A"


def setpoints(path: Path, rows: int, kind: str) -> dict[str, Array]:
    """The fields of `kernels.law.Setpoint` (n,) each, at the rows of a capture on an axis of `kind`.

    Raises RecordingError where a column or a row is missing.
    """
    table = _table(path)
    known = quantities()
    names = {name: header(name, known[name].unit_for(kind)) for name in Setpoint._fields}
    absent = [label for label in names.values() if label not in table.column_names]
    if absent or len(table) != rows:
        what = f"has no column {absent[0]}" if absent else f"has {len(table)} rows, its capture {rows}"
        reason = f"{path} {what}; without setpoints, they are recomputed: take the key out of captures.yaml"
        raise RecordingError(reason, path, ProblemKind.CONFLICT, column=absent[0] if absent else "")
    return {name: _numbers(path, table, label) for name, label in names.items()}


def injection(path: Path, time: Array) -> Array:
    """The added current (n,) A at the rows of a capture, whose own `time` (n,) s is given.

    Raises RecordingError where the file cannot be understood, or does not fit the capture.
    """
    table = _table(path)
    name, scale = _column(path, table.column_names)
    current = scale * _numbers(path, table, name)
    if "time_s" not in table.column_names:
        if len(current) != len(time):
            reason = (
                f"{path} has {len(current)} rows and no time_s, its capture has {len(time)}; it must have as many, or "
                "a time"
            )
            raise RecordingError(reason, path, ProblemKind.CONFLICT)
        return current
    return _held(path, _numbers(path, table, "time_s"), current, time)


def _table(path: Path) -> Any:
    words, causes = f"{path} cannot be read as the CSV of a capture", (arrow().ArrowInvalid, OSError)
    with RecordingError.instead_of(causes, words, path, ProblemKind.FILE):
        table = arrow().csv.read_csv(path, read_options=arrow().csv.ReadOptions(use_threads=False))
    return table


def _column(path: Path, names: list[str]) -> tuple[str, float]:
    """The current's column, and its factor into A."""
    units = {name: name.rsplit("_", 1)[-1] for name in names}
    scales = {name: factor(unit, "A") for name, unit in units.items() if bases_of(unit) == {"A": 1}}
    chosen = [name for name in scales if name.startswith("injection")] or list(scales)
    if len(chosen) != 1:
        reason = f"{path} has the columns {', '.join(names)}; one of them must be the added current: {NAME} (A or mA)"
        raise RecordingError(reason, path, ProblemKind.MISSING, column=NAME)
    return chosen[0], scales[chosen[0]]


def _numbers(path: Path, table: Any, name: str) -> Array:
    try:
        values = np.array(table[name].cast(arrow().float64()).to_numpy(), dtype=np.float64)
    except arrow().ArrowInvalid as error:
        raise RecordingError(
            f"{name} in {path} does not hold numbers: {error}", path, ProblemKind.VALUE, column=name
        ) from error
    if not np.all(finite := np.isfinite(values)):
        reason = f"{path} has no {name} in row {int(np.argmin(finite)) + 1} of its numbers"
        raise RecordingError(reason, path, ProblemKind.MISSING, column=name, row=int(np.argmin(finite)) + 1)
    return values


def _held(path: Path, begins: Array, current: Array, time: Array) -> Array:
    """`current` (m,) A, each from its time in `begins` (m,) s on, at the rows' `time` (n,) s; 0 outside."""
    if len(begins) < 2 or np.any(np.diff(begins) <= 0.0):
        reason = f"{path}: time_s must have at least two rows and increase strictly"
        raise RecordingError(reason, path, ProblemKind.CONFLICT, column="time_s")
    step = float(np.median(np.diff(begins)))
    late = EARLY * min(step, float(np.median(np.diff(time))))
    at = np.searchsorted(begins, time + late, side="right") - 1
    inside = (at >= 0) & (time + late < begins[-1] + step)
    if not np.any(inside):
        reason = (
            f"{path} covers {begins[0]:g} s to {begins[-1]:g} s, its capture {time[0]:g} s to {time[-1]:g} s: none of "
            "it was added in this capture"
        )
        raise RecordingError(reason, path, ProblemKind.CONFLICT, column="time_s")
    return np.where(inside, current[np.maximum(at, 0)], 0.0)
