"""`simulate` and `run`: one motion on the model, or on the drive."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stagectl.api.arguments import ArgumentError, PathLike, ProgressOption, Say, Seed, reported, switched_off
from stagectl.api.checked import checked
from stagectl.api.record import MotionRecord
from stagectl.api.stage import StageLike, as_stage
from stagectl.api.trajectory import TrajectoryLike, as_trajectory
from stagectl.recording.hdf5 import open_recording
from stagectl.simulation import FrictionLaw
from stagectl.trajectories.profiles import unreached
from stagectl.workflows import motion as workflow
from stagectl.workflows import simulated_motion

if TYPE_CHECKING:
    from stagectl.service.single_motion import Motion


@checked
def simulate(
    stage: StageLike,
    trajectory: TrajectoryLike,
    *,
    plant: StageLike | None = None,
    seed: Seed = None,
    without: str | Iterable[str] = (),
    learned: PathLike | None = None,
    friction: FrictionLaw | None = None,
) -> MotionRecord:
    """Run the law on the stage's model, compiled, faster than real time; nothing is written.

    `plant` is a machine that differs from the model; `seed` is the seed of its noise.  `without` switches off layers
    (``"ptc"``, ``"friction"`` or its compensator by name, ``"effects"``, ``"observer"``) and effects of the model
    (``"cogging"``).  `learned` is a file that ``stagectl learn`` wrote.  `friction(velocity, position, dt)` returns a
    force (N m | N, positive against positive velocity) that replaces the plant's friction; the run is then interpreted,
    about as fast as real time.

    Raises StageError where the motion is beyond a limit, or the plant is another kind of axis.
    """
    if friction is not None:
        _takes_three(friction)
    designed = as_stage(stage)
    commanded = as_trajectory(trajectory).bound(designed.setup)
    off = switched_off(without, designed.compensator)
    motion = workflow.lay_out(designed.setup, commanded, off, None, _path(learned))
    machine = None if plant is None else as_stage(plant).setup
    if seed is not None:
        machine = workflow.reseeded(machine or designed.setup, seed)
    recording = simulated_motion.simulated(motion, machine, friction=friction)
    notes = unreached(commanded.experiment, designed.setup.file.axis.travel_unit) + simulated_motion.gave(recording)
    return MotionRecord(recording, simulated_motion.simulated_result(motion, recording), tuple(notes))


def _takes_three(friction: FrictionLaw) -> None:
    try:
        inspect.signature(friction).bind(0.0, 0.0, 0.0)
    except TypeError as error:
        raise ArgumentError("friction", "", "must take (velocity, position, dt)") from error
    except ValueError:  # a function of C does not tell
        pass


@checked
def run(
    stage: StageLike,
    trajectory: TrajectoryLike,
    *,
    recording: PathLike | None = None,
    without: str | Iterable[str] = (),
    learned: PathLike | None = None,
    twin: bool = False,
    twin_record: PathLike | None = None,
    reset_fault: bool = False,
    progress: ProgressOption = False,
    say: Say | None = None,
) -> MotionRecord:
    """Run a trajectory on the drive that the stage names, and record it; default: into ``recordings/``.

    If no drive answers on the embedded bus, a virtual one is started.  `twin` runs the model next to the axis;
    `twin_record` is the file of its minute-by-minute record.  A drive that is in Fault stays there unless
    `reset_fault`. `say` is called with each message; the result's `notes` contain all of them.

    Raises DriveError where the drive cannot be reached or enabled, StageError where the motion is beyond a limit.
    """
    messages: list[str] = []

    def heard(words: str) -> None:
        messages.append(words)
        if say is not None:
            say(words)

    designed = as_stage(stage)
    commanded = as_trajectory(trajectory).bound(designed.setup)
    off = switched_off(without, designed.compensator)
    motion = workflow.lay_out(designed.setup, commanded, off, _path(recording), _path(learned))
    motion = motion._replace(reset_fault=reset_fault)
    for words in unreached(commanded.experiment, designed.setup.file.axis.travel_unit):
        heard(f"note: {words}")
    if twin or twin_record is not None:
        motion = _with_twin(motion, twin_record, heard)
    with reported(progress, f"run {motion.meta['trajectory']}", len(motion.plan.setpoints)) as update:
        summary = workflow.perform(motion, heard, update)
    summary |= _seen(motion, heard)
    return MotionRecord(open_recording(motion.recording), summary, tuple(messages))


def _path(place: PathLike | None) -> Path | None:
    return None if place is None else Path(place)


def _with_twin(motion: Motion, record: PathLike | None, say: Say) -> Motion:
    from stagectl.twin.start import companion

    say("starting the twin: some seconds, and longer once for each version, while its kernels are compiled")
    return motion._replace(companion=companion(motion.setup, motion.law, motion.recording, _path(record)))


def _seen(motion: Motion, say: Say) -> dict[str, Any]:
    """What the twin saw, where there was one."""
    if motion.companion is None:
        return {}
    from stagectl.twin.record import live_file, load_snapshot

    path = live_file(motion.recording)
    if not path.exists():
        say("twin: it saw nothing of this run")
        return {"twin": None}
    comparison = load_snapshot(path)
    skipped = f"; {comparison['skipped_rows']} rows were skipped" if comparison["skipped_rows"] else ""
    say(f"twin: {comparison['words']}{skipped}")
    return {"twin": comparison}
