"""From two YAML files to a result: what `run`, `simulate` and the trials share."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from stagectl.config.source import read_text
from stagectl.config.stage_file import Setup, canopen
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.design.control import Layer
from stagectl.drives.bus.frames import Bus
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.bus.other_masters import alone
from stagectl.drives.drive import Canopen, Fault, accepted
from stagectl.evaluation import evaluate
from stagectl.gap.effects.library import left_out
from stagectl.kernels.law import Setpoint
from stagectl.motion_limits import beyond_current, check_noticeable
from stagectl.plan import Plan, Start, plan
from stagectl.problem import Problem, ProblemKind
from stagectl.realtime.envelope import check_braking
from stagectl.recording.file_lock import sweep
from stagectl.recording.hdf5 import Recording, RecordingError, check_target, open_recording, repair
from stagectl.recording.in_memory import lacking
from stagectl.recording.learned_current import Learned, check, load, nothing
from stagectl.recording.metadata import describe
from stagectl.replacing import not_taken
from stagectl.service.single_motion import Ended, Motion, Progress, move
from stagectl.service.virtual_timeouts import HELD_UP, waits_for_sync
from stagectl.trajectories import Experiment
from stagectl.units import StageError

Say = Callable[[str], object]


class Commanded(NamedTuple):
    """A trajectory bound to the axis that it is for."""

    name: str  # of its file
    text: str  # of its file: what a recording keeps of it
    experiment: Experiment


def prepare(
    setup: Setup, trajectory: Path, without: frozenset[str], recording: Path | None, learned: Path | None = None
) -> Motion:
    """Read a trajectory file and lay it out, see `lay_out`."""
    experiment = load_trajectory(trajectory, axis_of(setup))
    return lay_out(setup, Commanded(trajectory.name, read_text(trajectory), experiment), without, recording, learned)


def lay_out(
    setup: Setup,
    commanded: Commanded,
    without: frozenset[str],
    recording: Path | None,
    learned: Path | None = None,
    clock: float = 0.0,
) -> Motion:
    """Check and lay out a motion, with the current that was `learned` for it; nothing moves yet.

    It begins at the session `clock` (s), 0 where the axis is cold.

    `without` names layers, and effects of the model, that are switched off.  Without a `recording` a fresh name in
    ``recordings/`` is planned.
    Raises DesignError, TrajectoryError or LearnedError where the motion is refused.
    """
    controller = setup.controller.without(without)
    effects = without - frozenset(get_args(Layer))
    known = setup._replace(stage=left_out(setup.stage, effects)) if effects else setup
    laid_out = plan(known, commanded.experiment, controller.feedforward, Start(clock=clock))
    check_noticeable(known, laid_out.setpoints[:, 0], laid_out.duration)

    def located(position: float) -> Plan:
        return plan(known, commanded.experiment, controller.feedforward, Start(position, clock=clock))

    layers = sorted(frozenset(setup.layers) - without)
    about = describe(setup, laid_out, controller, commanded.name, commanded.text)
    meta = {**about, "without": sorted(without), "layers": layers}
    if recording is not None:
        check_target(recording)
    place = recording or unused(Path(commanded.name).stem, ".h5")
    motion = Motion(setup, laid_out, controller.law, meta, place, located=located if laid_out.effects else None)
    return motion if learned is None else _with_learned(motion, learned)


def reseeded(setup: Setup, seed: int) -> Setup:
    """The same stage with other noise, where it is simulated."""
    return setup.having(simulation=setup.file.simulation._replace(seed=seed % 2**31))


def _with_learned(motion: Motion, path: Path) -> Motion:
    """The layer ``ilc``: the current in `path` added to the command.

    Raises LearnedError where it was learned on something else.
    """
    learned, expected = load(path), blank(motion)
    check(path, learned, expected)
    about = {name: learned.meta[name] for name in ("kept", "created")}
    meta = {**motion.meta, "layers": [*motion.meta["layers"], "ilc"], "learned": {"name": path.name, **about}}
    return with_current(motion, learned.current)._replace(meta=meta)


def blank(motion: Motion) -> Learned:
    """What a current that is learned on `motion` belongs to; the current is 0 still."""
    return nothing(motion.setup, motion.law, motion.plan.setpoints, motion.meta["trajectory"], motion.meta["layers"])


def with_current(motion: Motion, current: NDArray[np.float64]) -> Motion:
    """`motion` with this learned `current` (n,) A."""
    rows = motion.plan.setpoints.copy()
    rows[:, Setpoint._fields.index("learned")] = current
    return motion._replace(plan=motion.plan._replace(setpoints=rows))


def unused(what: str, suffix: str = "") -> Path:
    """A file or folder in ``recordings/`` whose name is not taken."""
    return not_taken(Path("recordings") / f"{time.strftime('%Y%m%d-%H%M%S')}-{what}{suffix}")


def perform(motion: Motion, say: Say, progress: Progress) -> dict[str, Any]:
    """Run the motion on its drive; the result as JSON values, ``interrupted`` among them: how far the operator let it.

    Raises DriveError where the drive cannot be reached or enabled, StageError where it was stopped before it moved.
    """
    _check_wire(motion.setup, say)
    _repair(motion.recording.parent, say)
    check_braking(motion.setup, motion.plan.setpoints)
    if words := beyond_current(motion.setup, motion.plan.setpoints):
        say(words)
    with drive_present(motion.setup, say):
        ended = move(motion, progress)
    for line in _conditions(ended):
        say(line)
    if waits_for_sync(motion.setup):
        say(f"the virtual drive waits for SYNC: late cycles change nothing, each time-out is at least {HELD_UP:g} s")
    interrupted = _interrupted(ended, motion)
    fault = ended.words or ("" if ended.recorded else "the recorder stopped before the motion did")
    recording = open_recording(motion.recording)
    if lacks := _lacks(ended, recording):
        say(lacks)
    result = evaluate(recording.samples, recording.meta)
    if ended.fault and not interrupted:
        cause = f"{_limited(ended, result, motion.setup)}{ended.reason}"
        say(f"stopped after {ended.cycles} cycles: {ended.words}. {cause}".rstrip())
    counts = {"cycles": ended.cycles, "late_cycles": ended.late, "lost_rows": recording.lost_rows, "fault": fault}
    return {**result, **counts, "interrupted": interrupted, "recording": str(motion.recording), "simulated": False}


def _limited(ended: Ended, result: Mapping[str, Any], setup: Setup) -> str:
    """That the current was at its limit while the axis did not follow, ahead of the causes; empty where it was not."""
    if ended.fault != Fault.FOLLOWING_ERROR or not (cycles := result["saturated_cycles"]):
        return ""
    limit = f"drive.current_limit, {setup.file.drive.current_limit:g} A, was reached in {cycles} of {result['cycles']}"
    return f"{limit} cycles: the motion, or what loads the axis, may take more current. "


def _repair(folder: Path, say: Say) -> None:
    """Finish what dead recorders left in a folder."""
    sweep(folder)
    for path in sorted(folder.glob("*.h5")):
        with contextlib.suppress(RecordingError, OSError):  # no recording of ours: none of our business
            if path.is_file() and repair(path):
                say(f"the recorder of {path} had been cut off: the file is repaired, its rows are all there")


def _interrupted(ended: Ended, motion: Motion) -> str:
    """How far the operator let the motion go, in words.  Raises StageError where nothing has moved, nor is recorded."""
    if ended.fault != Fault.OPERATOR:
        return ""
    if not ended.cycles:
        raise StageError(Problem("interrupted before anything moved", ProblemKind.STOPPED))
    return f"{ended.words} after {ended.cycles * motion.setup.dt:.3g} s; recorded: {motion.recording}"


def check_not_interrupted(result: dict[str, Any]) -> None:
    """Raises StageError where the operator stopped the run, so that he stops what it is part of."""
    if words := result.get("interrupted"):
        raise StageError(Problem(words, ProblemKind.STOPPED))


def _check_wire(setup: Setup, say: Say) -> None:
    """Check what a CANopen drive needs, and say what the stage file accepts that it lacks.  Raises DriveError."""
    wire = setup.file.drive.wire
    if isinstance(wire, Canopen):
        canopen(setup)
        for line in accepted(wire):
            say(line)


def _lacks(ended: Ended, recording: Recording) -> str:
    """Rows that were not recorded, in words."""
    if not ended.recorded:
        return f"the recorder stopped before the motion did: {recording.path} is incomplete; check the disk with `df`"
    if lost := lacking(recording.lost_rows, len(recording.samples)):
        holds = "marks the gaps" if len(recording.samples) else "holds none"
        return f"{lost}: {recording.path} {holds}; make room (see `df -h`), then type the same command"
    return ""


def _conditions(ended: Ended) -> list[str]:
    """Conditions that were not as requested, in words."""
    words = [f"not real time: {refusal}" for refusal in ended.refused]
    if ended.companion:
        words.append(f"the companion process ended early (exit {ended.companion}): the motion is not affected")
    return words


def drive_present(setup: Setup, say: Say) -> contextlib.AbstractContextManager[None]:
    """Make sure that the embedded bus has a drive: a virtual one where none answers."""
    from stagectl.service import virtual_drive  # a node with its object dictionary, which a simulation need not load

    return virtual_drive.present(setup, say)


@contextlib.contextmanager
def line_of(setup: Setup, say: Say, anyway: bool = False) -> Iterator[tuple[Canopen, Bus]]:
    """The wire of the stage's drive and a bus that is open to it; `anyway`: although another master controls it.

    Raises DriveError where the stage has no CANopen drive, the bus is not there, or another master is on it.
    """
    wire = canopen(setup)
    with (
        drive_present(setup, say),
        contextlib.closing(open_bus(wire.interface, wire.channel, wire.bitrate)) as line,
        contextlib.nullcontext() if anyway else alone(wire, line, setup.file.name),
    ):
        yield wire, line
