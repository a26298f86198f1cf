"""`load_log`, and the record that it, `simulate` and `run` return: arrays with units, and what the run achieved."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stagectl.api.arguments import PathLike
from stagectl.api.checked import checked
from stagectl.api.result import PrintedResult, Sheet, frame
from stagectl.api.stage import StageLike, as_stage
from stagectl.evaluation import evaluate, tracking_error
from stagectl.extras import require
from stagectl.kernels import rollout
from stagectl.problem import Problem, ProblemKind
from stagectl.recording.hdf5 import Recording, RecordingError, check_target, quantities, save
from stagectl.recording.opening import recordings_at

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
_ENDINGS = (".h5", ".csv", ".parquet", ".mat", ".mcap")  # that a record can be saved with


@dataclass(frozen=True, repr=False, eq=False)
class MotionRecord(PrintedResult):
    """Rows of a motion, simulated, run or logged: ``record["error"]`` is a column (n,) in SI and axis units.

    Axis units are rad and N m on a rotary axis, m and N on a linear one; `units` names the unit of each column.
    `summary` is what the run achieved, as ``--json`` writes it; empty for a log that holds too little.  `notes` are the
    messages of the run.
    """

    made_by: ClassVar[str] = "simulate, run or load_log"

    recording: Recording
    summary: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def path(self) -> Path:
        """Where it is recorded, or would be."""
        return self.recording.path

    @property
    def samples(self) -> NDArray[Any]:
        """All rows (n,), structured; read-only, as the record is what was measured."""
        rows = self.recording.samples.view()
        rows.flags.writeable = False
        return rows

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns."""
        return tuple(self.samples.dtype.names or ())

    @cached_property
    def units(self) -> dict[str, str]:
        """Unit of each column; empty for a pure number."""
        kind, known = self.recording.meta["axis"]["kind"], quantities()
        return _OfColumns(self, ((name, known[name].unit_for(kind) if name in known else "") for name in self.columns))

    @cached_property
    def meanings(self) -> dict[str, str]:
        """Meaning of each column."""
        known = quantities()
        return _OfColumns(self, ((name, known[name].meaning if name in known else "") for name in self.columns))

    def __getitem__(self, name: str) -> Array:
        """A copy of one column (n,), the caller's own.  Raises RecordingError naming the columns there are."""
        return self.recording.column(name).copy()

    def __len__(self) -> int:
        return len(self.samples)

    def to_arrays(self) -> dict[str, Array]:
        """Every column (n,) by its name."""
        return {name: self[name] for name in self.columns}

    def to_frame(self) -> Any:
        """Every column, indexed by row."""
        return frame(self.to_arrays(), self.units)

    def tracking_error(self) -> Array:
        """Reference minus measured position (n,) of the instant it was latched, in m of travel (or rad).

        Of a log that does not say how late its position is, both are of the same row.
        Raises RecordingError where the log lacks one of the two.
        """
        for name in ("reference", "measured"):
            self.recording.column(name)  # raises where there is none
        return tracking_error(self.samples, self.recording.meta)

    def sheet(self) -> Sheet:
        """What it achieved; of a log the range of each column."""
        from stagectl.report.page import Table
        from stagectl.report.tables import run as tables

        if self.summary:
            title = f"{self.summary['stage']}, {self.summary['trajectory']}"
            table = tables.achieved(self.summary, self.recording.meta)
            return Sheet(title, tables.answer(self.summary, self.samples), [table], self.notes)
        rows = [[name, *_range(self[name]), self.units[name]] for name in self.columns]
        notes = (*self.notes, *self.recording.meta.get("notes", ()))
        table = Table("", ["column", "lowest", "highest", "unit"], rows)
        return Sheet(str(self.path), f"{len(self)} rows", [table], notes)

    def plot(self) -> Figure:
        """Position, tracking error and current over time."""
        require("report", "plot")
        from stagectl.report.figures import detached
        from stagectl.report.run import figure

        return detached(figure(self.recording))

    @checked
    def save(self, path: PathLike | None = None) -> Path:
        """Write a recording (``.h5``), or export it as ``.csv``, ``.parquet``, ``.mat`` or ``.mcap``.

        Without a `path` it goes where its recording was planned, in ``recordings/``.
        Raises RecordingError where the file cannot be written, or is of another kind.
        """
        target = self.path if path is None else Path(path)
        if not target.suffix:
            what = "is a folder" if target.is_dir() else "has no ending"
            reason = f"{target} {what}: give a file such as {target / 'run.h5' if target.is_dir() else f'{target}.h5'}"
            raise RecordingError(reason, target, ProblemKind.FILE)
        if target.suffix not in _ENDINGS:
            problem = Problem("", ProblemKind.VALUE, f"ending of {target}", target.suffix, choices=_ENDINGS)
            raise RecordingError(problem._replace(file=target))
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.suffix == ".h5":
            if target != self.path:  # of its own it is the same
                check_target(target)
            save(target, self.recording.meta, self.samples, self.recording.ended, self.recording.complete)
            return target
        from stagectl.recording.exports import export

        return export([self.recording], target.suffix.removeprefix("."), target)[0].path


class _OfColumns(dict[str, str]):
    """A word on each column of a record; a name that is no column is refused as the record refuses it."""

    def __init__(self, record: MotionRecord, words: Iterable[tuple[str, str]]) -> None:
        super().__init__(words)
        self._record = record

    def __missing__(self, name: str) -> str:
        return str(self._record[name])  # raises: it has no such column


class RecordFolder(Sequence[MotionRecord], PrintedResult):
    """The records of a folder, in their order."""

    made_by: ClassVar[str] = "simulate, run or load_log"

    def __init__(self, records: Sequence[MotionRecord]) -> None:
        self.records = tuple(records)

    def __getitem__(self, number: Any) -> Any:
        return self.records[number]

    def __len__(self) -> int:
        return len(self.records)

    def sheet(self) -> Sheet:
        """One record a row."""
        from stagectl.report.page import Table

        rows = [[record.path.name, str(len(record)), f"{record['time'][-1]:.4g} s"] for record in self.records]
        return Sheet(f"{len(self)} records", "", [Table("", ["record", "rows", "duration"], rows)])

    def to_frame(self) -> Any:
        """One record a row; each record has a data frame of its own."""
        columns = {"record": [str(record.path) for record in self], "rows": [len(record) for record in self]}
        return frame(columns, {})


@checked
def load_log(
    path: PathLike, columns: Mapping[str, str] | str | None = None, stage: StageLike | None = None
) -> MotionRecord | RecordFolder:
    """A recording (``.h5``), a log (a text table, ``.mat``), or all records of a folder.

    `columns` gives the meaning of columns whose names do not show it: ``{"time": "t", "position": "qm:mm"}``.  `stage`
    is the machine of the log, for its scales.

    Raises RecordingError with file, row and reason.
    """
    place = Path(path)
    setup = None if stage is None else as_stage(stage, judged=False).setup  # a log was recorded by whatever loop
    try:
        found = recordings_at(place, setup, named_columns(columns))
        records = [record_of(recording.filled("load")) for recording in found]
    except RecordingError as error:
        error.problems = tuple(one._replace(reason=_in_python(one.reason)) for one in error.problems)
        raise
    return RecordFolder(records) if place.is_dir() else records[0]


def _in_python(reason: str) -> str:
    """The option of the command line as the argument that it is here."""
    return (
        re.sub(r"--columns (\w+=[^\s;)]*[^\s;):])", r"columns='\1'", reason)
        .replace("--columns", "`columns`")
        .replace("--stage", "`stage`")
    )


def named_columns(columns: Mapping[str, str] | str | None) -> Mapping[str, str] | None:
    """Names of columns as a mapping; a text is what ``--columns`` takes.

    Raises RecordingError where the text cannot be understood.
    """
    from stagectl.recording.columns import split

    return split(columns) if isinstance(columns, str) else columns


def record_of(recording: Recording) -> MotionRecord:
    """A recording with what it achieved, if its columns show that."""
    whole = set(rollout.COLUMNS) <= set(recording.samples.dtype.names or ())
    known = [recording.meta.get(name) is not None for name in ("steady", "duration", "nm")]  # an import's nm is not
    if not (whole and all(known)):
        return MotionRecord(recording)
    return MotionRecord(recording, {**evaluate(recording.samples, recording.meta), "lost_rows": recording.lost_rows})


def _range(column: Array) -> tuple[str, str]:
    """Least and largest number of a column; NaN where there is none."""
    ends = (np.nanmin(column), np.nanmax(column)) if np.isfinite(column).any() else (np.nan, np.nan)
    return f"{ends[0]:.6g}", f"{ends[1]:.6g}"
