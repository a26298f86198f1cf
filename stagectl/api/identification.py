"""`identify`: parameters of an axis from records of its motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stagectl.api.arguments import ArgumentError, PathLike, ProgressOption, entry, quantity, reported
from stagectl.api.checked import checked
from stagectl.api.record import MotionRecord, RecordFolder, named_columns
from stagectl.api.result import ReportedResult, Sheet, frame
from stagectl.api.stage import DesignedStage, StageLike, as_stage, check_same_kind
from stagectl.config.patch import Change, write
from stagectl.extras import require
from stagectl.identification import capture_checks, captures, methods
from stagectl.identification.capture import Capture
from stagectl.identification.methods import check_forms, with_compensators
from stagectl.identification.result import IdentificationResult, Parameter, Topic, biases, topics
from stagectl.units import Quantity, StageError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stagectl.recording.hdf5 import Recording
    from stagectl.report.page import Page

DataLike = MotionRecord | RecordFolder | PathLike
_DELAY = Quantity("s", "[-0.1, 0.1]", "known delay")


@dataclass(frozen=True, repr=False, eq=False)
class IdentifiedModel(ReportedResult):
    """Parameters with 95 % intervals, in SI; ``fit["inertia"].value``.

    `implausible` lists parameters that cannot be those of this machine; `held_out` the captures that were not used.
    """

    method: str
    stage: DesignedStage
    estimate: IdentificationResult
    captures: Sequence[Capture]
    held_out: Sequence[str]
    implausible: Sequence[str]

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Values with their intervals and units, by name."""
        return self.estimate.parameters

    def __getitem__(self, name: str) -> Parameter:
        return entry("parameter", name, self.estimate.parameters)

    @property
    def changes(self) -> Mapping[str, Any]:
        """What it changes in a stage file, by dotted name (SI)."""
        return self.estimate.changes

    @property
    def notes(self) -> tuple[str, ...]:
        """Parameters that cannot be distinguished, and doubts."""
        return tuple(self.to_json()["notes"])

    @property
    def doubts(self) -> list[str]:
        """Reasons against all values: far from the stage file, or from a column whose unit is doubtful."""
        about = [note for capture in self.captures for note in capture.notes if topics((note,)) == {Topic.UNITS}]
        return [*self.implausible, *dict.fromkeys(about)]

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON values."""
        return self._json

    @cached_property
    def _json(self) -> dict[str, Any]:
        return methods.result(self.method, self.stage.setup, self.captures, self.estimate, self.held_out)

    def to_arrays(self) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
        """Values and the ends of their intervals, (n,) in the order of `parameters`."""
        rows = self.parameters.values()
        return {name: np.array([getattr(row, name) for row in rows], float) for name in ("value", "low", "high")}

    def to_frame(self) -> Any:
        """One parameter a row: value, low, high and unit."""
        units = {name: row.unit for name, row in self.parameters.items()}
        return frame({"parameter": list(units), **self.to_arrays(), "unit": list(units.values())}, units)

    def sheet(self) -> Sheet:
        """Parameters, captures, and what is to be known about them."""
        from stagectl.report.tables import identification as tables

        result = self.to_json()
        others = [line for line in tables.remarks(result) if line.strip() not in self.doubts]
        first = "\n".join(f"doubtful: {doubt}" for doubt in self.doubts)
        return Sheet(f"{result['stage']}, {self.method}", first, [tables.parameters(result)], others)

    def plot(self) -> Figure:
        """Friction after a reversal where the method finds it, else the first capture."""
        require("report", "plot")
        from stagectl.report import identification as report
        from stagectl.report.figures import detached

        if self.estimate.table is not None:
            return detached(report.characteristic(self.estimate.table, self.stage.setup))
        return detached(report.motion(self.captures[0], self.stage.setup))

    def page(self, command: str = "") -> Page:
        """The page with the figures of its method."""
        from stagectl.report.identification import page

        return page(self.to_json(), (self.estimate, self.captures, self.stage.setup), command)

    @checked
    def apply(self, stage: StageLike | None = None, *, doubtful: bool = False) -> DesignedStage:
        """The stage, or the file at a path, with these parameters, in memory.

        Raises StageError where there is nothing to apply, or, without `doubtful`, where a value is implausible
        or a note tells of a bias; ArgumentError for a stage of another kind of axis.
        """
        target = self.stage if stage is None else as_stage(stage)
        check_same_kind(self.stage, target, "parameters")
        self._check(target.path, doubtful)
        return target.changed(self.changes)

    @checked
    def write(self, path: PathLike, *, doubtful: bool = False) -> list[Change]:
        """Write a copy of the stage file with these parameters to `path`, or patch that file itself; comments stay.

        Raises as `apply` does, and ConfigError where another file is there or the result would be refused.
        """
        self._check(Path(path), doubtful)
        return write(self.stage.path, Path(path), self.changes)

    def _check(self, target: Path, doubtful: bool) -> None:
        if not self.changes:
            raise StageError(
                f"{target}: the method {self.method} finds nothing that a stage file holds; it is unchanged"
            )
        reasons = [*self.implausible, *biases(self.estimate.notes)]
        if reasons and not doubtful:
            raise StageError(
                f"{target}: nothing is written, as {reasons[0]}; doubtful=True (--doubtful) writes it anyway"
            )


@checked
def identify(
    stage: StageLike,
    data: DataLike | Sequence[DataLike],
    method: str = "simultaneous",
    *,
    current: str | None = None,
    columns: Mapping[str, str] | str | None = None,
    doubtful: bool = False,
    compensation: str | None = None,
    compensators: Sequence[str] = (),
    progress: ProgressOption = False,
    **options: Any,
) -> IdentifiedModel:
    """Find the parameters of an axis from runs, logs, files or folders of captures.

    `current` names the column that is the motor's current, `columns` the columns of logs, see `load_log`.  `doubtful`
    continues even if a capture's units or current look wrong.  `options` are the method's own: ``delay`` (s, or text
    with a unit), ``gravity``, ``directions``, ``form``, ``seed``.  Of the friction that is found, `changes` get the
    `compensation` that acts and the `compensators` next to it: ``table``, ``gms``, ``rheology``.

    Raises IdentificationError if the data do not determine the parameters, RecordingError where they cannot be read.
    """
    methods.chosen(method)
    check_forms([*([compensation] if compensation else []), *compensators])
    designed = as_stage(stage, judged=False)  # a log was recorded by whatever loop
    recordings = _recordings(data, designed, named_columns(columns))
    held_out = [str(recording.path) for recording in recordings if captures.held_out(recording)]
    used = captures.prepared(recordings, designed.setup, current, doubtful)
    del recordings  # all their columns: the captures have copies of those that they need
    if "delay" in options:
        options["delay"] = quantity("delay", options["delay"], _DELAY, "a time such as 0.2ms")
    with reported(progress, f"identify {method}", 1) as update:
        estimate = methods.identify(method, used, designed.setup.file, update, options)
    values = {name: parameter.value for name, parameter in estimate.parameters.items()}
    if not doubtful:
        capture_checks.check_possible(estimate.parameters)
    implausible = capture_checks.implausible(values, designed.setup.stage)
    implausible += capture_checks.contradictions(used, estimate, designed.setup.file)
    estimate = estimate._replace(notes=(*implausible, *estimate.notes))
    estimate = with_compensators(estimate, method, compensation, compensators)
    return IdentifiedModel(method, designed, estimate, used, held_out, implausible)


def _recordings(
    data: DataLike | Sequence[DataLike], stage: DesignedStage, columns: Mapping[str, str] | None
) -> list[Recording]:
    if isinstance(data, MotionRecord):
        return [data.recording]
    if isinstance(data, Sequence) and not isinstance(data, str):
        return [recording for part in data for recording in _recordings(part, stage, columns)]
    if columns and Path(data).suffix == ".h5":
        given = ",".join(f"{column}={name}" for column, name in columns.items())
        words = f"; {data} is a recording, which names its own: give it with logs only"
        raise ArgumentError("columns", given, words)
    return captures.opened([Path(data)], stage.setup, columns)
