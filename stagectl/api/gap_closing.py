"""`close_gap`: record, diagnose, apply and compare on the machine, until the tracking error shrinks no more."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stagectl.api.arguments import PathLike, ProgressOption, Say, reported
from stagectl.api.comparison import machine_of
from stagectl.api.result import ReportedResult, Sheet, frame
from stagectl.api.stage import StageLike
from stagectl.workflows import gap_closing
from stagectl.workflows.motion import unused
from stagectl.workflows.trials import Shown

if TYPE_CHECKING:
    from stagectl.report.page import Page


@dataclass(frozen=True, repr=False, eq=False)
class GapClosing(ReportedResult):
    """What each round found, and what the controller makes of it on the machine."""

    result: dict[str, Any]

    @property
    def model(self) -> Path:
        """The stage file with all that was found and kept."""
        return Path(self.result["model"])

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON values."""
        return self.result

    def to_frame(self) -> Any:
        """One motion and model a row: peak and rms of the tracking error, means of the repeats."""
        rows = [(motion, row) for motion, variants in self.result["errors"].items() for row in variants.values()]
        columns: dict[str, list[Any]] = {
            "motion": [motion for motion, _ in rows],
            "model": [row["name"] for _, row in rows],
        }
        columns |= {measure: [row[measure]["mean"] for _, row in rows] for measure in ("peak", "rms")}
        return frame(columns, dict.fromkeys(("peak", "rms"), self.result["unit"]))

    def sheet(self) -> Sheet:
        """What was reached, and the errors."""
        from stagectl.report import gap_closing as shown

        result = self.result
        return Sheet(result["stage"], shown.sentence(result), shown.tables(result), shown.notes(result))

    def page(self, command: str = "") -> Page:
        """The page with all figures."""
        from stagectl.report import gap_closing as shown

        return shown.page(self.result, [command] if command else [])


def close_gap(
    stage: StageLike,
    *,
    simulate: bool = True,
    plant: StageLike | None = None,
    rounds: int = 3,
    folder: PathLike | None = None,
    seed: int = 1,
    repeats: int = gap_closing.REPEATS,
    progress: ProgressOption = False,
    say: Say | None = None,
) -> GapClosing:
    """Close the gap between model and machine, in the controller.

    The recommended experiments are recorded once.  Each round diagnoses them against the model so far, applies what was
    found to a copy of the stage file, and compares old and new controller on motions that nothing has seen.  All of it
    goes to `folder`, else into ``recordings/``; the stage file itself stays as it is.

    Raises StageError where a run is stopped or the machine cannot be diagnosed, ArgumentError for a plant next to a
    drive.
    """
    machine = machine_of(stage, simulate, plant)
    place = unused(f"close-{machine.setup.path.stem}") if folder is None else Path(folder)
    shown = Shown(say or (lambda _: None), partial(reported, progress))
    return GapClosing(gap_closing.close(gap_closing.Closing(machine, place, rounds, seed, repeats), shown))
