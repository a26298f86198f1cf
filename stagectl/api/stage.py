"""`load_stage`: a stage file, read, checked and its controller designed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from stagectl.api.arguments import ArgumentError, PathLike
from stagectl.api.checked import checked
from stagectl.api.result import PrintedResult, Sheet, gains_frame
from stagectl.compensation.forms import name_of
from stagectl.config import stage_file
from stagectl.config.lengths import Lengths
from stagectl.config.machine_file import split, text_of
from stagectl.config.patch import Change, axis_reference, check_values, in_its_file, patched, replace_file
from stagectl.config.source import ConfigError
from stagectl.config.stage_checks import doubtful
from stagectl.extras import require
from stagectl.problem import Problem, ProblemKind
from stagectl.realtime.envelope import unwatched
from stagectl.replacing import left_as_it_is

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stagectl.design import Margins
    from stagectl.tuning.search import Tuned


@dataclass(frozen=True, repr=False, eq=False)
class DesignedStage(PrintedResult):
    """A machine, its model and its controller.

    `setup` is the input of the package's other functions; `changes` lists how the stage differs from its file.
    """

    made_by: ClassVar[str] = "load_stage"

    setup: stage_file.Setup
    changes: tuple[Change, ...] = ()

    @property
    def path(self) -> Path:
        """The stage file."""
        return self.setup.path

    @property
    def text(self) -> str:
        """Content of the stage file, with all changes."""
        return self.setup.text or text_of(self.path)

    @property
    def period(self) -> float:
        """Control period Ts (s)."""
        return self.setup.dt

    @property
    def compensator(self) -> str:
        """Name of the friction compensator that acts."""
        return name_of(self.setup.file.compensation)

    @cached_property
    def loop(self) -> Tuned:
        """The feedback as designed, with what each loop reaches."""
        from stagectl.tuning.families import Family
        from stagectl.tuning.search import as_designed

        return as_designed(Family(self.setup.stage, self.setup.file.control))

    @property
    def gains(self) -> dict[str, tuple[float, str]]:
        """Continuous gains by name: (value, unit)."""
        from stagectl.tuning import sheet

        return sheet.named_gains(self.setup, self.setup.file.control)

    @cached_property
    def margins(self) -> Margins:
        """Margins of the running loop: phase (rad), gain (factor), crossover (Hz), delay (s)."""
        return self.setup.margins

    @property
    def unrest(self) -> str:
        """Why the loop would swing by itself, at standstill or in slow motions; empty where it does not."""
        return self.setup.unrest

    def sheet(self) -> Sheet:
        """Gains and margins."""
        from stagectl.report.tables.tuning import design
        from stagectl.tuning import sheet
        from stagectl.tuning.families import law_of

        file = self.setup.file
        changed = " (changed in memory)" if self.changes else ""
        layers = " + ".join(self.setup.layers) or "none"
        answer = (
            f"{sheet.NAMES[law_of(file.control)]} of {self.loop.bandwidth:g} Hz every {self.period * 1e3:g} ms, "
            f"layers: {layers}; phase margin {math.degrees(self.margins.phase):.1f} deg"
        )
        tables = design(self.setup, self.loop)
        notes = [*sheet.notes(self.loop), *filter(None, [doubtful(file), unwatched(self.setup)])]
        return Sheet(f"{file.name}, {self.path}{changed}", answer, tables, notes)

    def to_frame(self) -> Any:
        """The gains, one a row."""
        return gains_frame(self.gains)

    def plot(self) -> Figure:
        """Bode plot of the open loop with its margins."""
        require("report", "plot")
        from stagectl.report import tuning as report
        from stagectl.report.figures import detached
        from stagectl.tuning.families import judged_loops

        return detached(report.bode(judged_loops(self.setup.stage, self.setup.file.control), self.loop))

    @checked
    def changed(self, values: Mapping[str, Any]) -> DesignedStage:
        """The stage with values by dotted name, in memory: ``{"mechanics.inertia": 0.0102}``.

        A text has its unit: ``{"limits.speed": "200 mm/s"}``.  A number is in the unit of the axis: positions and
        speeds of a rotary axis are rad and rad/s at the motor, with a lead, too, where its file says mm and mm/s.
        Raises ConfigError where there is no such entry, DesignError where the loop would be refused.
        """
        axis = self.setup.file.axis
        lengths = Lengths(axis.kind, axis.lead)
        patch = patched(self.text, values, lengths)
        if not patch.changes:
            return self
        with _blocks_told(values):
            setup = stage_file.load_stage(self.path, text=patch.text)
        check_values(setup.file, patch)
        return DesignedStage(setup, (*self.changes, *patch.changes))

    @checked
    def on_channel(self, channel: str | None) -> DesignedStage:
        """The stage on another channel of its bus.  Raises DriveError where it is on no CAN bus."""
        return DesignedStage(stage_file.on_channel(self.setup, channel), self.changes)

    @checked
    def save(self, path: PathLike) -> DesignedStage:
        """Write the stage file, and return the stage that it holds.

        Changes of one axis among several (``xy.yaml#x``) go into its own file, as entries of that axis; another file
        gets that axis alone.

        Raises ConfigError where `path` cannot be written, or the stage would be refused there; ArgumentError where it
        is no name of a stage file, StageError where another file is there than the one that the stage was loaded from.
        """
        target, text = split(Path(path))[0], self.text
        if target.suffix not in (".yaml", ".yml"):
            raise ArgumentError("path", target, "; must end in .yaml")
        own, axis = split(self.path)
        into_plane = bool(axis) and target.resolve() == own.resolve()
        if into_plane:  # the other axes stay as they are
            text = in_its_file(self.path, text, self.changes)
        elif target.is_file() and target.resolve() != own.resolve() and target.read_bytes() != text.encode():
            raise left_as_it_is(target, "is not the file of this stage")
        target.parent.mkdir(parents=True, exist_ok=True)
        replace_file(target, text.encode(), lambda fresh: load_stage(self._named(fresh, into_plane)))
        return load_stage(self._named(target, into_plane))

    def _named(self, file: Path, into_plane: bool) -> Path:
        return axis_reference(file, self.path) if into_plane else file


@contextmanager
def _blocks_told(values: Mapping[str, Any]) -> Iterator[None]:
    """Errors about an entry that a block in `values` leaves out say that a block is replaced as a whole."""
    try:
        yield
    except ConfigError as error:
        error.problems = tuple(_of_block(problem, values) for problem in error.problems)
        raise


def _of_block(problem: Problem, values: Mapping[str, Any]) -> Problem:
    block = problem.key.rpartition(".")[0]
    if problem.kind is not ProblemKind.MISSING or not isinstance(given := values.get(block), Mapping):
        return problem
    entries = ", ".join(f"'{block}.{name}': {value!r}" for name, value in given.items())
    return problem._replace(remedy=f"a block is replaced as a whole; to change single entries write {{{entries}}}")


def check_same_kind(found: DesignedStage, target: DesignedStage, what: str) -> None:
    """Raises ArgumentError where `what` was found on one kind of axis and goes to another, whose units differ."""
    kind, other = found.setup.file.axis.kind, target.setup.file.axis.kind
    if kind != other:
        reason = f"; the {what} are those of {found.path}, which is {kind}, and it is {other}: must be of the same kind"
        raise ArgumentError("stage", target.path, reason)


StageLike = DesignedStage | PathLike


@checked
def load_stage(path: PathLike, *, judged: bool = True) -> DesignedStage:
    """Read a stage file, or one axis of it (``xy.yaml#x``), and design its controller.

    With ``judged=False`` a stage whose loop must not run is loaded, too: `tune` may find gains for it.

    Raises ConfigError with every error of the file, DesignError where the phase margin is too small.
    """
    return DesignedStage(stage_file.load_stage(Path(path), judged))


def as_stage(stage: StageLike, *, judged: bool = True) -> DesignedStage:
    """A stage, or the stage file at a path; `judged` as in `load_stage`."""
    return stage if isinstance(stage, DesignedStage) else load_stage(stage, judged=judged)
