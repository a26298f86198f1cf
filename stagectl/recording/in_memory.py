"""A recording in memory, and what its columns are."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.kernels import law, rollout
from stagectl.problem import ProblemKind, meant
from stagectl.recording.file_lock import RecordingError
from stagectl.units import Quantity, quantities_of


def lacking(lost: int, rows: int) -> str:
    """Rows that are missing, of `rows` that there are and `lost` ones, in words; empty where all are there."""
    return f"the disk did not take {lost} of {lost + rows} rows" if lost else ""


class Recording(NamedTuple):
    """A recording in memory."""

    path: Path
    meta: dict[str, Any]
    samples: NDArray[Any]  # (n,) structured, one float64 field per column
    complete: bool  # written to its end
    ended: str  # why it ended, in words
    lost_rows: int
    gaps: tuple[tuple[int, int], ...] = ()  # rows before each, and how many are lost there

    def filled(self, what: str) -> Recording:
        """The recording itself, where it holds rows.  Raises RecordingError where there is nothing to `what`."""
        if not len(self.samples):
            reason = f"{self.path} holds no rows: there is nothing to {what}"
            lost = lacking(self.lost_rows, 0)
            why = f"{lost}: make room (see `df -h`), and record it again" if lost else self.ended or "record it again"
            raise RecordingError(f"{reason}; {why}", self.path, ProblemKind.MISSING)
        return self

    def column(self, name: object) -> NDArray[np.float64]:
        """One column, (n,), SI, by its name.  Raises RecordingError naming the columns there are."""
        if not isinstance(name, str):
            reason = f"{self.path}: a column is named by text, one at a time, such as 'measured', and not {name!r}"
            raise RecordingError(reason, self.path, ProblemKind.VALUE)
        if name not in (self.samples.dtype.names or ()):
            names = self.samples.dtype.names or ()
            reason = f"{self.path} has no column {name}; {meant(name, names, 'it has')}"
            raise RecordingError(reason, self.path, ProblemKind.UNKNOWN, column=name)
        return np.asarray(self.samples[name], dtype=np.float64)


def of_a_machine(meta: Mapping[str, Any]) -> bool:
    """Whether a real drive has moved for it: no simulation, no virtual drive, no import."""
    drive = str(meta.get("drive", {}).get("drive", "simulated"))
    return not drive.startswith("simulated") and " on embedded " not in drive


def given_twice(name: str) -> str:
    """What to say of a log that stands twice among those that are evaluated together."""
    return f"{name} is there twice; name each log once"


def quantities() -> dict[str, Quantity]:
    """Unit and meaning of every column, as declared with the kernels' fields."""
    known = {"time": Quantity("s", "[-inf, inf]", "start of the period, 0 at the first row")}
    for block in (law.Setpoint, law.Output, rollout.Observed):
        known |= quantities_of(block)
    return known


def units_of(columns: Iterable[str], kind: str) -> dict[str, str]:
    """SI units of these columns, of an axis of this kind; a column that is not a quantity is left out."""
    known = quantities()
    return {name: known[name].unit_for(kind) for name in columns if name in known}


def header(name: str, unit: str) -> str:
    """A column's name with its unit: ``time_s``, ``ahead_velocity_rad_per_s``; a pure number keeps its name."""
    return f"{name}_{unit.replace('/', '_per_').replace(' ', '')}" if unit else name


def column_attributes(axis: dict[str, Any], columns: tuple[str, ...]) -> dict[str, str]:
    """Units and meanings of these columns of an axis, each as JSON."""
    known, units = quantities(), units_of(columns, axis["kind"])
    return {"units": json.dumps(units), "meanings": json.dumps({n: known[n].meaning for n in units})}
