"""`compare`: one motion with different layers, interleaved, and which of them help."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stagectl.api.arguments import ArgumentError, Count, PathLike, ProgressOption, Say, entry, paths_of, reported
from stagectl.api.checked import checked
from stagectl.api.result import ReportedResult, Sheet, frame
from stagectl.api.stage import StageLike, as_stage
from stagectl.api.trajectory import TrajectoryLike, as_trajectory
from stagectl.extras import require
from stagectl.workflows import layer_comparison
from stagectl.workflows.motion import unused
from stagectl.workflows.trials import Machine, Shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stagectl.report.page import Page


@dataclass(frozen=True, repr=False, eq=False)
class LayerComparison(ReportedResult):
    """Tracking errors of all repeats, their paired differences, and the verdict."""

    result: dict[str, Any]
    folder: Path  # of the recordings

    @property
    def verdict(self) -> list[str]:
        """Which variants help, and how certain that is, a line a variant."""
        return list(self.result["verdict"])

    @property
    def best(self) -> str:
        """The variant with the lowest peak error."""
        return str(self.result["best"])

    def __getitem__(self, variant: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Peak tracking error (m or rad) of each repeat of a variant, (n,)."""
        rows = {row["name"]: row["peak"]["values"] for row in self.result["variants"]}
        return np.array(entry("variant", variant, rows))

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON values."""
        return self.result

    def to_arrays(self) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
        """Peak tracking error (m or rad) of each repeat, (n,) by variant."""
        return {row["name"]: self[row["name"]] for row in self.result["variants"]}

    def to_frame(self) -> Any:
        """One run a row: variant, repeat, peak and rms of the tracking error."""
        rows = [(row, number) for row in self.result["variants"] for number in range(len(row["peak"]["values"]))]
        columns: dict[str, list[Any]] = {
            "variant": [row["name"] for row, _ in rows],
            "repeat": [number + 1 for _, number in rows],
        }
        columns |= {measure: [row[measure]["values"][number] for row, number in rows] for measure in ("peak", "rms")}
        return frame(columns, dict.fromkeys(("peak", "rms"), self.result["unit"]))

    def sheet(self) -> Sheet:
        """Errors and differences, then the verdict."""
        from stagectl.report.tables.comparison import tables

        title = f"{self.result['stage']}, {self.result['trajectory']}"
        return Sheet(title, "", tables(self.result), [*self.result["notes"], *self.verdict])

    def plot(self) -> Figure:
        """Peak error of each repeat."""
        require("report", "plot")
        from stagectl.report.comparison import peaks
        from stagectl.report.figures import detached

        return detached(peaks(self.result))

    def page(self, command: str = "") -> Page:
        """The page with all figures."""
        from stagectl.report.comparison import page

        return page(self.result, [command])


@checked
def compare(
    stage: StageLike,
    trajectory: TrajectoryLike,
    *variants: str,
    simulate: bool = True,
    repeats: Count = 5,
    plant: StageLike | None = None,
    learned: PathLike | Sequence[PathLike] = (),
    trials: Count = 8,
    seed: int = 1,
    folder: PathLike | None = None,
    progress: ProgressOption = False,
    say: Say | None = None,
) -> LayerComparison:
    """Run a motion with different layers, interleaved, and report which of them help.

    A variant is ``"off"`` (feedback alone) or layers joined by +: ``"ptc+friction"``, also with ``observer`` and
    ``ilc``.  Instead of ``friction``, name a compensator of the stage file, such as ``"ptc+table"``: ``model``,
    ``table``, ``gms``, ``rheology`` or a form of zero-crossing.  The other variants are compared with the first one.
    ``ilc`` is the learned current; it is learned first, in `trials`, unless `learned` names files that contain it.
    Recordings go to `folder`; default: into ``recordings/``.  `seed` is the seed of the order.

    Raises TrialError where the variants are wrong or a run is stopped, ArgumentError for a plant next to a drive.
    """
    machine, source = machine_of(stage, simulate, plant), as_trajectory(trajectory)
    place = unused(f"compare-{source.name}") if folder is None else Path(folder)
    shown = Shown(say or (lambda _: None), partial(reported, progress))
    motions = layer_comparison.laid_out(machine.setup, source.bound(machine.setup), variants, place)
    courses = layer_comparison.learn_missing(machine, motions, paths_of(learned), trials, shown)
    result = layer_comparison.compare(machine, motions, (repeats, seed), shown, place)
    notes = layer_comparison.course_words(courses)
    return LayerComparison(result | {"simulated": simulate, "seed": seed, "learned": courses, "notes": notes}, place)


def machine_of(stage: StageLike, simulate: bool, plant: StageLike | None) -> Machine:
    """The machine that all runs take place on.  Raises ArgumentError for a plant together with a drive."""
    if plant is not None and not simulate:
        raise ArgumentError(
            "plant", plant, " needs simulate: the runs are on a drive, which has its own machine", needs="simulate"
        )
    return Machine(as_stage(stage).setup, simulate, None if plant is None else as_stage(plant).setup)
