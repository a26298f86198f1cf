"""A campaign: the experiments of a battery on one machine, repeats interleaved, each a recording of its own.

::

    repeat 1: sine-slow, stairs, ... check-scan    repeat 2: sine-slow, stairs, ...    repeat 3: ...
                  |
                  v
    FOLDER/trajectories/sine-slow.yaml --> motion.perform | pretend --> FOLDER/sine-slow-1.h5

A run is recorded in ``FOLDER/unfinished`` and moved when it is complete.  The same command continues with the rest.
"""

import contextlib
import functools
import hashlib
import os
import time
from collections.abc import Callable, Iterator
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stagectl.gap.experiment_design.experiment import HELD_OUT, Experiment, yaml_of
from stagectl.gap.logs.session import GapError
from stagectl.problem import Problem
from stagectl.recording.hdf5 import Recording, open_recording
from stagectl.recording.metadata import STAMP, made_at, portable
from stagectl.replacing import write_text
from stagectl.service.single_motion import Motion, Progress
from stagectl.units import StageError
from stagectl.workflows.motion import Say, check_not_interrupted, perform, prepare, reseeded
from stagectl.workflows.simulated_motion import pretend
from stagectl.workflows.trials import Machine, Shown, after, halted, interruption

HELD_OUT_REPEATS = 2  # enough for a floor
PAUSE = 1.0  # s between runs, on the clock of a simulated session
_APART = 1000  # seeds from the noise of one experiment to that of the next


class Run(NamedTuple):
    """One repeat of one experiment."""

    experiment: Experiment
    number: int  # of the experiment in its battery
    repeat: int
    start: float  # s, session clock, where the runs follow each other with a pause

    @property
    def name(self) -> str:
        """Of its recording."""
        return f"{self.experiment.name}-{self.repeat}"


class Campaign(NamedTuple):
    """What is to be recorded, and where."""

    machine: Machine
    runs: tuple[Run, ...]
    motions: dict[str, Motion]  # of each experiment by its name
    folder: Path
    seed: int  # of the noise of a simulated machine, and of a virtual drive that is started here
    clock: Callable[[], float]  # s since the epoch

    def place(self, run: Run) -> Path:
        """The recording of a run that is complete."""
        return self.folder / f"{run.name}.h5"


def chosen(experiments: tuple[Experiment, ...], only: list[str], skip: list[str]) -> tuple[tuple[int, Experiment], ...]:
    """Those named in `only`, all where it names none, but for those in `skip`; with their numbers in the battery.

    Raises GapError for a name that is none of theirs, or where nothing is left.
    """
    known = [experiment.name for experiment in experiments]
    for option, name in [("only", name) for name in only] + [("skip", name) for name in skip]:
        if name not in known:
            raise GapError(f"--{option} {name}: no such experiment; the experiments are: {', '.join(known)}")
    wanted = set(only or known) - set(skip)
    if not wanted:
        raise GapError("--skip leaves no experiment to record: skip fewer of them")
    return tuple((number, experiment) for number, experiment in enumerate(experiments) if experiment.name in wanted)


def schedule(experiments: tuple[tuple[int, Experiment], ...], repeats: int) -> tuple[Run, ...]:
    """All runs in order: a whole round of every experiment, then the next, so that drift meets all alike."""
    order = [
        (number, experiment, repeat)
        for repeat in range(1, repeats + 1)
        for number, experiment in experiments
        if repeat <= (HELD_OUT_REPEATS if experiment.use == HELD_OUT else repeats)
    ]
    starts = accumulate((experiment.duration + PAUSE for _, experiment, _ in order), initial=0.0)
    timed = zip(order, starts, strict=False)
    return tuple(Run(experiment, number, repeat, start) for (number, experiment, repeat), start in timed)


def laid_out(machine: Machine, runs: tuple[Run, ...], folder: Path) -> dict[str, Motion]:
    """Each experiment's trajectory written into `folder`, read again and laid out; nothing moves yet.

    Raises GapError where the folder has another trajectory of that name, TrajectoryError where a limit forbids one.
    """
    texts = {run.experiment.name: yaml_of(run.experiment) for run in runs}
    place = folder / "trajectories"
    for name, text in texts.items():
        path = place / f"{name}.yaml"
        if path.is_file() and path.read_text(encoding="utf-8") != text:
            raise GapError(
                f"{path} is another motion than the one for {machine.setup.path}: the folder belongs to another stage "
                "or version; choose another with -o"
            )
        write_text(path, text)
    return {name: prepare(machine.setup, place / f"{name}.yaml", frozenset(), folder / f"{name}.h5") for name in texts}


def planned(
    machine: Machine, experiments: tuple[tuple[int, Experiment], ...], repeats: int, folder: Path, seed: int
) -> Campaign:
    """The campaign of these numbered `experiments`, laid out: see `chosen`, `schedule` and `laid_out`."""
    runs = schedule(experiments, repeats)
    return Campaign(machine, runs, laid_out(machine, runs, folder), folder, seed, time.time)


def record(campaign: Campaign, shown: Shown) -> dict[str, Any]:
    """Record what the folder does not hold yet; the result as JSON values.

    A fault or an interrupt ends it, with what is done kept.  Raises StageError where not even the first run was made.
    """
    done = {run.name: recording for run in campaign.runs if (recording := _recorded(campaign, run))}
    left = [run for run in campaign.runs if run.name not in done]
    if done:
        rest = f"going on with {left[0].name}" if left else "no run is left"
        shown.say(f"{len(done)} of {len(campaign.runs)} runs are in {campaign.folder} already: {rest}")
    starts = (made_at(log.meta) - log.meta["capture"]["start_s"] for log in done.values())
    end = _made(campaign, left, min(starts, default=campaign.clock()), shown) if left else Problem()
    stopped = str(end)
    count = len(left) if not stopped else next(k for k, run in enumerate(left) if not campaign.place(run).is_file())
    if stopped:
        shown.say(
            f"{left[count].name}: {stopped}.  {len(done) + count} of {len(campaign.runs)} runs are kept in "
            f"{campaign.folder}; the same command with -o {campaign.folder} goes on with {left[count].name}; "
            f"--skip {left[count].experiment.name} leaves that experiment out"
        )
    kept = [run for run in campaign.runs if campaign.place(run).is_file()]
    notes = [] if stopped else _identical(campaign, kept)
    for note in notes:
        shown.say(note)
    return {
        "folder": str(campaign.folder),
        "stage": campaign.machine.setup.file.name,
        "runs": [
            {**open_recording(path, only=("time",)).meta["capture"], "recording": str(path)}
            for path in map(campaign.place, kept)
        ],
        "left": [run.name for run in campaign.runs if run not in kept],
        "stopped": stopped,
        "interrupted": interruption(end),
        "notes": notes,
        "simulated": campaign.machine.simulated,
        "seed": campaign.seed,
    }


def _made(campaign: Campaign, left: list[Run], begun: float, shown: Shown) -> Problem:
    """Make the runs that are `left`; why it ended before the last one, an empty problem where it did not."""
    counts = [len(campaign.motions[run.experiment.name].plan.setpoints) for run in left]
    unfinished = campaign.folder / "unfinished"
    say = functools.cache(shown.say)  # a message may hold for all runs: once is enough
    with shown.bar(f"record {len(left)} runs", sum(counts)) as update, _emptied(unfinished):
        for run, before in zip(left, accumulate(counts, initial=0), strict=False):
            motion = _motion(campaign, run, begun)._replace(recording=unfinished / f"{run.name}.h5")
            try:
                fault = _once_made(campaign, run, motion, (say, after(before, sum(counts), update)))
            except (StageError, KeyboardInterrupt) as error:
                if run is left[0] and isinstance(error, StageError):
                    raise
                fault = halted(error)
            if fault != Problem():
                return fault
            os.replace(motion.recording, campaign.place(run))
    return Problem()


def _once_made(campaign: Campaign, run: Run, motion: Motion, shown: tuple[Say, Progress]) -> Problem:
    """Make one run; its fault, an empty problem where there was none."""
    say, update = shown
    machine, number = campaign.machine, run.repeat + _APART * run.number
    if machine.simulated:
        plant = reseeded(machine.plant or machine.setup, campaign.seed + number)
        result = pretend(motion, plant, run.start, machine.elsewhere)
        update(len(motion.plan.setpoints), len(motion.plan.setpoints))
    else:
        result = perform(motion._replace(setup=reseeded(motion.setup, campaign.seed + number)), say, update)
    check_not_interrupted(result)
    return Problem(f"{result['fault']}; {motion.recording} shows it" if result["fault"] else "")


def _motion(campaign: Campaign, run: Run, begun: float) -> Motion:
    """The run's motion, whose recording says what it is a capture of, and when in the session."""
    motion, now = campaign.motions[run.experiment.name], campaign.clock()
    start = round(run.start if campaign.machine.simulated else now - begun, 3)
    experiment = run.experiment
    capture = {"experiment": experiment.name, "repeat": run.repeat, "use": experiment.use, "start_s": start}
    about = {"created": time.strftime(STAMP, time.localtime(now)), "capture": capture, "campaign": _campaign(campaign)}
    return motion._replace(meta={**motion.meta, **about})


def _campaign(campaign: Campaign) -> dict[str, Any]:
    """What runs of one session share; of a plant that is not the model the file's name and a mark of its parameters."""
    machine = campaign.machine
    plant = machine.plant
    content = repr((portable(plant.stage), plant.file.simulation)) if plant else ""
    mark = hashlib.sha256(content.encode()).hexdigest()[:16] if plant else ""
    name = plant.path.name if plant else ""
    return {"simulated": machine.simulated, "plant": name, "plant_mark": mark, "seed": campaign.seed}


def _recorded(campaign: Campaign, run: Run) -> Recording | None:
    """The run's recording, where it was made before; None where it is still to be made.

    Raises GapError where it was made of something else.
    """
    path = campaign.place(run)
    if not path.is_file():
        return None
    recording, motion = open_recording(path, only=("time",)), campaign.motions[run.experiment.name]
    here = {**motion.meta, "campaign": _campaign(campaign)}
    for what in ("files", "layers", "campaign"):
        if recording.meta.get(what) != here[what]:
            raise GapError(
                f"{path} was recorded with {_WHICH[what]} than this campaign has: runs of one folder belong together; "
                "choose another folder with -o"
            )
    return recording if recording.complete else None


_WHICH = {
    "files": "another stage file or trajectory",
    "layers": "other layers",
    "campaign": "another machine, simulation or seed",
}


def _identical(campaign: Campaign, kept: list[Run]) -> list[str]:
    """Repeats that are the same to the last bit: they show no chance, so no floor."""
    first: dict[str, Any] = {}
    same: dict[str, None] = {}  # in order
    for run in kept:
        measured = open_recording(campaign.place(run), only=("measured",)).column("measured")
        if run.experiment.name in first and np.array_equal(first[run.experiment.name], measured):
            same[run.experiment.name] = None
        first.setdefault(run.experiment.name, measured)
    if not same:
        return []
    return [
        f"the repeats of {', '.join(same)} are identical to the last bit: nothing varied from run to run, so the floor "
        "of the gap is 0; a simulated machine takes simulation.current_noise and simulation.encoder_noise, and a "
        "virtual drive that was started by hand begins its noise anew at each run: let this command start it"
    ]


@contextlib.contextmanager
def _emptied(folder: Path) -> Iterator[None]:
    """The folder of the run that is being made, gone when nothing was left in it."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # a run that was stopped stays to be looked at
            folder.rmdir()
