"""`load_trajectory`: a motion or experiment, from a file or from arrays, bound to an axis when it is used."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from stagectl.api.arguments import ArgumentError, PathLike, Step
from stagectl.api.checked import checked
from stagectl.api.result import PrintedResult, Sheet, frame
from stagectl.api.stage import DesignedStage
from stagectl.config import trajectory_file
from stagectl.config.source import read_text
from stagectl.config.trajectory_file import axis_of
from stagectl.extras import require
from stagectl.motion_limits import check_limits
from stagectl.trajectories import Experiment, Recorded, TrajectoryError, check, peaks, phases
from stagectl.workflows.motion import Commanded

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stagectl.config.stage_file import Setup


@dataclass(frozen=True, repr=False, eq=False)
class TrajectorySource(PrintedResult):
    """A trajectory as it was written: lengths and angles are converted by the axis that it runs on.

    `text` is the file's content, or the samples as CSV; `stage` is the stage it was loaded for, if any.
    """

    made_by: ClassVar[str] = "load_trajectory"

    path: Path
    text: str
    samples: Recorded | None = None
    stage: DesignedStage | None = None

    @property
    def name(self) -> str:
        """Name of the motion."""
        return self.path.stem

    def bound(self, setup: Setup) -> Commanded:
        """The trajectory on this axis: positions in metres of travel, rad on a rotary axis without a lead.

        Raises ConfigError or TrajectoryError with the place and the reason.
        """
        if self.samples is not None:
            return Commanded(self.path.name, self.text, self.samples)
        experiment = trajectory_file.load_trajectory(self.path, axis_of(setup), self.text)
        return Commanded(self.path.name, self.text, experiment)

    @checked
    def duration(self, stage: DesignedStage) -> float:
        """How long it takes on this stage (s)."""
        return phases(self.bound(stage.setup).experiment).duration

    def sheet(self) -> Sheet:
        """What it does on its stage; its text where it was loaded for none."""
        from stagectl.report.page import Table

        if self.stage is None and self.samples is None:
            return Sheet(f"trajectory {self.path}", "", (), self.text.splitlines())
        motion, unit = phases(self._experiment()).motion, self._unit()
        most = peaks(motion, 1e-3)
        rows = [
            ["duration", f"{motion.duration:.6g} s"],
            ["travel", f"{most.lowest:.5g} to {most.highest:.5g} {unit}"],
            ["speed", f"at most {most.speed:.5g} {unit}/s"],
            ["acceleration", f"at most {most.acceleration:.5g} {unit}/s^2"],
        ]
        return Sheet(f"trajectory {self.path}", "", [Table("", ["", ""], rows)])

    def _experiment(self) -> Experiment:
        if self.samples is not None:
            return self.samples
        if self.stage is None:
            raise ArgumentError("stage", None, f"; {self.path} is bound to an axis first: load_trajectory(path, stage)")
        return self.bound(self.stage.setup).experiment

    def _unit(self) -> str:
        return "m" if self.stage is None else self.stage.setup.file.axis.travel_unit

    @checked
    def to_arrays(self, dt: Step = 1e-3) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
        """Time (s), position (m of travel, or rad) and injected current (A) every `dt` (s), all (n,).

        Raises ArgumentError where the axis is not known yet, TrajectoryError where the axis is let go.
        """
        from stagectl.trajectories.experiments import sampled

        return dict(sampled(self._experiment(), dt, 0.0)._asdict())

    def to_frame(self) -> Any:
        """Time, position and injected current, a row every millisecond."""
        return frame(self.to_arrays(), {"time": "s", "position": self._unit(), "current": "A"})

    def plot(self) -> Figure:
        """Position over time, and the injected current where there is one."""
        require("report", "plot")
        from stagectl.report.figures import detached
        from stagectl.report.panels import Frame, Line, stacked

        columns = self.to_arrays()
        shown = [("position", self._unit())] + ([("current", "A")] if columns["current"].any() else [])
        curves = [
            ([Line(columns["time"], columns[name])], Frame("time [s]", f"{name} [{unit}]")) for name, unit in shown
        ]
        return detached(stacked(curves))


TrajectoryLike = TrajectorySource | PathLike | tuple[ArrayLike, ArrayLike]


@checked
def load_trajectory(
    source: PathLike | tuple[ArrayLike, ArrayLike], stage: DesignedStage | None = None
) -> TrajectorySource:
    """A trajectory or experiment from a YAML file, or from samples ``(time, position)``.

    Samples are in s and in m of travel (rad on a rotary axis without a lead), both (n,), at rest at both ends; a
    quintic spline goes through them.  With a `stage` the trajectory is checked at once, also against the limits;
    otherwise when it is used.

    Raises ConfigError or TrajectoryError with the place and the reason, LimitError for a motion beyond the limits of
    the stage, ArgumentError for arrays that do not fit.
    """
    if isinstance(source, tuple):
        read = TrajectorySource(Path("samples.csv"), *_sampled(*source), stage)
    else:
        read = TrajectorySource(Path(source), read_text(Path(source)), None, stage)
    if stage is not None:
        check_limits(stage.setup, phases(read.bound(stage.setup).experiment).motion)
    return read


def _sampled(time: ArrayLike, position: ArrayLike) -> tuple[str, Recorded]:
    """The samples as CSV text and as a trajectory."""
    if any(map(np.iscomplexobj, (time, position))):
        raise ArgumentError("source", "", "holds complex numbers; must be real numbers: (time, position) in SI")
    if any(map(np.ma.is_masked, (time, position))):
        raise ArgumentError("source", "", "holds masked values; fill them or leave their rows out")
    if any(np.asarray(values).dtype.kind in "mM" for values in (time, position)):
        raise ArgumentError(
            "source", "", "holds dates; give the time in s, such as (t - t[0]) / np.timedelta64(1, 's')"
        )
    try:
        columns = [np.asarray(values, dtype=np.float64) for values in (time, position)]
    except (TypeError, ValueError) as error:
        raise ArgumentError("source", "", "holds what is no number; must be numbers: (time, position) in SI") from error
    if columns[0].shape != columns[1].shape or columns[0].ndim != 1:
        shapes = " and ".join(str(column.shape) for column in columns)
        raise ArgumentError("source", f"of shapes {shapes}", "; time and position must both be (n,)")
    motion = Recorded(columns[0], columns[1])
    check(motion)
    rows = (f"{t!r},{x!r}" for t, x in zip(columns[0].tolist(), columns[1].tolist(), strict=True))
    return "\n".join(["time_s,reference_m", *rows, ""]), motion


def as_trajectory(trajectory: TrajectoryLike) -> TrajectorySource:
    """A trajectory, the file at a path, or samples."""
    return trajectory if isinstance(trajectory, TrajectorySource) else load_trajectory(trajectory)


__all__ = ["TrajectoryError", "TrajectoryLike", "TrajectorySource", "as_trajectory", "load_trajectory"]
