"""From a stage file to a stage: read, checked, assembled into the model, and its controller designed once."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

import yaml

from stagectl import design
from stagectl.compensation import model_effects
from stagectl.config.bounds import LONGEST_LEAD, SHORTEST_LEAD
from stagectl.config.friction_laws import friction_of
from stagectl.config.lengths import Lengths
from stagectl.config.loader import Reader
from stagectl.config.machine_file import composed, load_axis
from stagectl.config.source import entry_of, node_at, placed
from stagectl.config.stage_blocks import Axis, StageFile
from stagectl.config.stage_checks import conflicts
from stagectl.config.time_outs import with_time_outs
from stagectl.config.wire_checks import eds_path
from stagectl.drives.drive import Canopen, DriveError
from stagectl.kernels import effects, equilibrium, jit, stage
from stagectl.problem import Problem, ProblemKind


class _Stage(NamedTuple):
    path: Path
    file: StageFile
    stage: stage.Stage  # the model: what the law is designed for, and the plant where there is no machine
    text: str = ""  # of the stage file, where `path` does not hold it


class Setup(_Stage):
    """A stage file, read, checked and assembled.

    The controller is designed when it is first needed, and kept; what `_replace` returns designs its own.
    """

    @property
    def dt(self) -> float:
        """Control period Ts (s)."""
        return self.file.control.period

    @property
    def canopen(self) -> Canopen:
        """The wire of a stage that is known to have a CANopen drive."""
        wire = self.file.drive.wire
        assert isinstance(wire, Canopen)
        return wire

    def having(self, **blocks: Any) -> Setup:
        """The same with other blocks of its file; the model stays."""
        return self._replace(file=self.file._replace(**blocks))

    def with_wire(self, **entries: Any) -> Setup:
        """The same with other entries of its wire."""
        return self._replace(file=self.file.with_wire(**entries))

    @property
    def load(self) -> float:
        """The most that acts on the axis at rest within its travel, without friction (N m | N)."""
        return equilibrium.load(self.stage.mechanics, self.stage.motor, self.file.limits.travel)

    @property
    def layers(self) -> tuple[str, ...]:
        """The layers that act: those of ``control.layers``, `effects` only where the model holds some."""
        answered = model_effects.present(self.stage)
        return tuple(layer for layer in self.file.control.layers if answered or layer != "effects")

    @functools.cached_property
    def controller(self) -> design.Controller:
        """The law that runs and its feedforward.

        Raises DesignError where the loop has less than the margin that the file demands.
        """
        return design.design(self.stage, self.file.control)

    @functools.cached_property
    def margins(self) -> design.Margins:
        """How far the loop is from instability, the disturbance observer included.

        Raises DesignError where the loop cannot be computed.
        """
        return design.margins(self.stage, *design.loop_parts(self.stage, self.file.control))

    @functools.cached_property
    def unrest(self) -> str:
        """Why the loop would swing by itself, at standstill or in slow motions; empty where it does not.

        Raises DesignError where its gains cannot be realised.
        """
        control = self.file.control
        words = [design.limit_cycle_warning(self.stage, control)]
        speed = design.sticking_speed(self.stage, *design.loop_parts(self.stage, control))
        if speed is not None:
            below = self.file.axis.travel.length(speed, "/s")
            words.append(
                f"below {below} friction falls faster with the speed than the loop can bear: slow motions stick and "
                "slip, whatever is compensated; move faster there, or take a faster loop with less delay"
            )
        return "; ".join(filter(None, words))


def load_stage(path: Path, designed: bool = True, text: str | None = None) -> Setup:
    """Read a stage file, or an axis of one (``xy.yaml#x``); unless `designed`, its loop may be one that must not run.

    `text` is the file's content where that is in memory; `path` then only names it and its folder.
    Raises ConfigError with every problem, and DesignError where the loop that the file describes is refused.
    """
    file: StageFile = load_axis(path, read_stage, text)
    if isinstance(wire := file.drive.wire, Canopen):  # with the EDS file by the path under which it exists
        file = file.with_wire(eds=str(eds_path(wire.eds, path)))
    setup = setup_of(path, file, text or "")
    if designed:
        _design(setup)
    return setup


def setup_of(path: Path, file: StageFile, text: str = "") -> Setup:
    """The set-up of a stage file that has been read, as a recording carries it; `path` names it."""
    return Setup(path, file, _assembled(file), text)


def read_stage(reader: Reader, root: yaml.Node) -> StageFile | None:
    """The content of a stage file; every problem is noted in `reader`, nothing is designed."""
    axis_reader = Reader(reader.path, Lengths())
    lengths = _lengths(axis_reader, root)
    if lengths is None:
        reader.problems = axis_reader.problems
        return None
    reader.lengths = lengths
    file: StageFile = reader.value(StageFile, root, "")
    if not reader.problems:
        file = with_time_outs(file)
        reader.problems = [placed(problem, reader.path, root) for problem in conflicts(file, reader.path)]
    reader.problems = [_elsewhere(problem) for problem in reader.problems]
    return file


def _elsewhere(problem: Problem) -> Problem:
    """An unknown entry of a block that another block has: it belongs there."""
    block, _, word = problem.key.rpartition(".")
    if problem.kind is not ProblemKind.UNKNOWN or block not in StageFile._fields:
        return problem
    hints = get_type_hints(StageFile)
    others = [f"{name}.{word}" for name, kind in hints.items() if word in getattr(kind, "_fields", ())]
    return problem._replace(remedy=f"did you mean {others[0]}?") if len(others) == 1 else problem


def _lengths(reader: Reader, root: yaml.Node) -> Lengths | None:
    """How lengths and angles convert; None where the axis is wrong, as then everything else would look wrong, too."""
    trajectory = entry_of(root, "type")
    if trajectory is not None and entry_of(root, "axis") is None:
        remedy = "give the stage file in its place"
        reader.refuse(trajectory, Problem("belongs to a trajectory file", ProblemKind.UNKNOWN, "type", remedy=remedy))
        return None
    entries = reader.entries(root, "", StageFile._fields)
    if "axis" not in entries:
        remedy = f"a block of {', '.join(Axis._fields)}"
        reader.refuse(root, Problem("is missing", ProblemKind.MISSING, "axis", remedy=remedy))
        return None
    before = len(reader.problems)
    axis = reader.value(Axis, entries["axis"], "axis")
    if axis is not None and axis.lead and not SHORTEST_LEAD <= axis.lead <= LONGEST_LEAD:
        node = node_at(root, "axis.lead")
        reader.refuse(node, _mistaken(str(node.value)))
    return Lengths(axis.kind, axis.lead) if len(reader.problems) == before else None


def _mistaken(lead: str) -> Problem:
    """The problem of a `lead` that no screw or belt has; refused first, as it would shift every limit."""
    interval = f"[{SHORTEST_LEAD:g}, {LONGEST_LEAD:g}]"
    problem = Problem("", ProblemKind.RANGE, "axis.lead", lead, "m", interval)
    shown = f"[{1e3 * SHORTEST_LEAD:g}, {1e3 * LONGEST_LEAD:g}] mm"
    return problem._replace(admissible=shown, remedy="check the unit; 0 m where there is no lead")


def _design(setup: Setup) -> design.Controller:
    """Design the loop here, before anything moves; an error names the place of the entry that it is about."""
    try:
        return setup.controller
    except design.DesignError as error:
        file, root = composed(setup.path)
        error.problems = tuple(placed(problem, file, root) for problem in error.problems)
        raise


def _assembled(file: StageFile) -> stage.Stage:
    wire, table, p = file.drive.wire, effects.NO_TABLE, file.residual
    if p is not None:
        table = effects.Table(effects.COORDINATES.index(p.coordinate), p.start, p.step, jit.table(p.values))
    return stage.Stage(
        stage.Drive(
            wire.command_scale if isinstance(wire, Canopen) else 0.0,
            file.drive.delay_samples,
            file.drive.current_limit,
            file.drive.current_lag,
            *(getattr(file.drive, name) for name in stage.Drive._fields[4:]),
        ),
        file.motor,
        file.mechanics,
        friction_of(file.friction),
        stage.Encoder(file.encoder.one_count, *(getattr(file.encoder, name) for name in stage.Encoder._fields[1:])),
        table,
    )


def canopen(setup: Setup) -> Canopen:
    """The CANopen wire of the stage.  Raises DriveError where the stage has none."""
    wire = setup.file.drive.wire
    if not isinstance(wire, Canopen):
        words = "this is for a drive on a CAN bus; `stagectl run` and `serve` take other drives, too"
        raise DriveError(f"drive.wire.kind of {setup.path} is not canopen: {words}")
    if setup.stage.drive.delay_samples < 1:
        raise DriveError(
            f"drive.delay_samples = 0; over CAN the command acts from the next SYNC on, so it is at least 1: "
            f"`simulate` can do without the delay, a bus cannot ({setup.path})"
        )
    return wire


def on_channel(setup: Setup, channel: str | None) -> Setup:
    """The same stage on another channel of its bus."""
    if channel is None:
        return setup
    canopen(setup)
    return setup.with_wire(channel=channel)


def lasting(setup: Setup) -> Setup:
    """The same stage, whose virtual machine is not made anew for each run: it stays where it is, its noise goes on."""
    wire = setup.file.drive.wire
    if not isinstance(wire, Canopen) or wire.interface != "embedded":
        return setup
    return setup.with_wire(reset="none")


def with_machine_of_the_day(setup: Setup, seed: int) -> Setup:
    """The same stage, whose virtual drive is a machine drawn with this `seed`."""
    return setup.having(virtual_drive=setup.file.virtual_drive._replace(machine_of_the_day=seed))
