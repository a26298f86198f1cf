"""Many runs of one motion that learn from each other.

::

    trial 1 --> error --> learning.after_trial --> learned current --> trial 2 --> error --> ...     --> FILE.h5
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl import learning
from stagectl.config.stage_file import Setup
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.number_format import length
from stagectl.problem import Problem, ProblemKind
from stagectl.recording import learned_current
from stagectl.recording.hdf5 import open_recording
from stagectl.service.single_motion import Motion, Progress
from stagectl.units import StageError
from stagectl.workflows.motion import Say, blank, check_not_interrupted, drive_present, perform, reseeded, with_current
from stagectl.workflows.simulated_motion import Elsewhere, pretend

Bar = Callable[[str, int], AbstractContextManager[Any]]
Result = dict[str, Any]
Array = NDArray[np.float64]
_APART = 1000  # seeds between the noise of the repeats and that of the trials


class TrialError(StageError):
    """Trials that cannot be made, or one that was stopped."""


class Machine(NamedTuple):
    """Where the runs take place."""

    setup: Setup
    simulated: bool  # compiled, faster than real time; False: on the drive
    plant: Setup | None  # the simulated machine, where it is not the stage's model
    clock: float = 0.0  # s on the session's clock when the trials take place: how warm the axis is
    elsewhere: Elsewhere | None = None  # the simulated machine, where no stage file describes it: its noise is its own

    def noisy(self, number: int) -> Machine:
        """The same with other noise, where it is simulated; each number has its own."""
        if not self.simulated:
            return self
        plant = self.plant or self.setup
        return self._replace(plant=reseeded(plant, plant.file.simulation.seed + number))


class Shown(NamedTuple):
    """How the user sees it."""

    say: Say
    bar: Bar


@contextlib.contextmanager
def ready(machine: Machine, shown: Shown) -> Iterator[None]:
    """A drive for all the runs, where they are not simulated."""
    if machine.simulated:
        yield
        return
    with drive_present(machine.setup, shown.say):
        yield


def run_once(machine: Machine, motion: Motion, update: Progress) -> Result:
    """One run; a fault ends all of them, and so does the operator.

    Raises TrialError with the fault and the recording that shows it.
    """
    if machine.simulated:
        result = pretend(motion, machine.plant, machine.clock, machine.elsewhere)
    else:
        result = perform(motion, lambda _: None, update)  # what a drive says at its first run holds for all
    update(len(motion.plan.setpoints), len(motion.plan.setpoints))
    check_not_interrupted(result)
    if result["fault"]:
        raise TrialError(f"the run was stopped: {result['fault']}; {result['recording']} shows it")
    return result


def after(done: int, total: int, update: Progress) -> Progress:
    """Progress of a run as part of all runs, after `done` periods of `total`."""
    return lambda now, _: update(done + now, total)


class Learning(NamedTuple):
    """A motion that learns, as far as it has come."""

    motion: Motion
    filters: learning.Filters
    settings: learning.LearningSettings
    course: learning.LearningState


def learn(machine: Machine, base: Motion, trials: int, shown: Shown, folder: Path) -> Result:
    """Make `trials` trials of `base`, recorded in `folder`; the learned current is in ``result["current"]``.

    Raises TrialError where the motion cannot be learned, or its first trial is stopped.
    """
    state = _begin(machine.setup, base)
    total = trials * len(base.plan.setpoints)
    results: list[Result] = []
    stopped, end = "", Problem()
    with ready(machine, shown), shown.bar(f"learn {base.meta['trajectory']}", total) as update:
        for number in range(1, trials + 1):
            try:
                done = after((number - 1) * len(base.plan.setpoints), total, update)
                result, error = _trial(machine.noisy(_APART + number), state, number, folder, done)
            except (StageError, KeyboardInterrupt) as fault:
                if number == 1:
                    raise
                end = halted(fault)
                stopped = f"trial {number}: {end}; it is undone, and what was learned before is kept"
                shown.say(stopped)
                break
            state = state._replace(course=learning.after_trial(state.filters, state.settings, state.course, error))
            results.append(_said(result, state, number, shown))
    return _learned(state, results, stopped) | {"interrupted": interruption(end)}


def halted(fault: StageError | KeyboardInterrupt) -> Problem:
    """Why a series of runs ends before its last one."""
    return fault.problems[-1] if isinstance(fault, StageError) else Problem("interrupted", ProblemKind.STOPPED)


def interruption(end: Problem) -> str:
    """How far the operator let a series go, in words; empty where it ended otherwise."""
    return str(end) if end.kind is ProblemKind.STOPPED else ""


def learn_into(machine: Machine, base: Motion, trials: int, shown: Shown, path: Path) -> Result:
    """`learn`, recorded beside the recording of `base`; the learned current goes into the file `path`.

    Raises LearnedError where the file cannot be written, before anything moves.
    """
    learned_current.claim(path)
    result = learn(machine, base, trials, shown, base.recording.parent)
    learned_current.save(path, result.pop("current"))
    for line in (*convergence_words(result), learned_words(result), f"learned: {path}"):
        shown.say(line)
    return {**result, "learned": str(path), "simulated": machine.simulated}


def _begin(setup: Setup, base: Motion) -> Learning:
    rows, settings = base.plan.setpoints, setup.file.learning
    if not np.all(rows[:, SETPOINT_COLUMNS["closed"]] == 1.0) or np.any(rows[:, SETPOINT_COLUMNS["injection"]]):
        raise TrialError(
            f"{base.meta['trajectory']} opens the loop or injects a current: there is no tracking error to learn from; "
            "take a trajectory that is a motion alone"
        )
    filters = learning.filters(setup.stage, base.law, settings, setup.dt, len(rows))
    return Learning(base, filters, settings, learning.initial_state(len(rows)))


def _trial(machine: Machine, state: Learning, number: int, folder: Path, update: Progress) -> tuple[Result, Array]:
    base = state.motion
    motion = with_current(base, state.course.learned)._replace(recording=folder / f"trial-{number}.h5")
    result = run_once(machine, motion, update)
    rows = open_recording(motion.recording).samples
    return result, every_period(rows["time"], rows["error"], (0, len(base.plan.setpoints)), machine.setup.dt)


def every_period(time: Array, error: Array, periods: tuple[int, int], dt: float) -> Array:
    """The error of all periods from the first on to before the last; late ones lie between their neighbours."""
    return np.interp(np.arange(*periods), np.rint(time / dt), error)


def _said(result: Result, state: Learning, number: int, shown: Shown) -> Result:
    """The trial's figures as JSON values, and to the user."""
    trial = state.course.trials[-1]
    scale = state.motion.meta["axis"]["travel_per_unit"]
    error, unit = result["tracking_error"], result["unit"]
    words = f"trial {number}: tracking error peak {length(error['peak'], unit)}, rms {length(error['rms'], unit)}"
    if result["saturated_cycles"]:
        words += f"; the current limit was reached in {result['saturated_cycles']} cycles"
    shown.say(f"{words}{'; ' if trial.words else ''}{trial.words}")
    figures = {name: result[name] for name in ("tracking_error", "saturated_cycles", "recording")}
    whole = {"peak": trial.peak * scale, "rms": trial.rms * scale}
    return {"trial": number, **figures, "whole": whole, "words": trial.words}


def _learned(state: Learning, results: list[Result], stopped: str) -> Result:
    base, course = state.motion, state.course
    setup = base.setup
    kept = min(range(len(results)), key=lambda k: course.trials[k].rms)
    ratios = learning.plant_ratios(setup.stage, base.law, setup.dt)
    learned = blank(base)
    meta = {**learned.meta, "kept": kept + 1, "settings": state.settings._asdict()}
    return {
        "stage": setup.file.name,
        "trajectory": base.meta["trajectory"],
        "layers": base.meta["layers"],
        "unit": base.meta["axis"]["travel_unit"],
        "trials": results,
        "kept": kept + 1,
        "stopped": stopped,
        "settings": state.settings._asdict(),
        "convergence": [ratio._asdict() for ratio in learning.convergence(ratios, state.settings)],
        "calmest_cutoff": learning.highest_convergent_cutoff(ratios, state.settings),
        "current": learned._replace(current=course.best, meta=meta),
    }


def convergence_words(result: Result) -> list[str]:
    """What a trial leaves of the error, in words; and where it would grow, what to do."""
    check, cutoff = result["convergence"], result["settings"]["cutoff"]
    shown = ", ".join(
        f"{100.0 * ratio['most']:.0f} % ({ratio['plant']}, at {ratio['frequency']:.3g} Hz)" for ratio in check
    )
    sentences = [f"by the model a trial leaves at most {shown} of the error"]
    growing = [ratio for ratio in check if ratio["most"] >= 1.0]
    if growing:
        calm = result["calmest_cutoff"]
        advice = f"with learning.cutoff at {calm:.3g} Hz it shrinks everywhere" if calm else "no cutoff prevents it"
        sentences.append(
            f"near {growing[0]['frequency']:.3g} Hz the error of an axis "
            f"{' or '.join(ratio['plant'] for ratio in growing)} would grow; {advice}, at {cutoff:g} Hz "
            "trials that grow are undone"
        )
    return sentences


def learned_words(result: Result) -> str:
    """What came of it."""
    unit, kept = result["unit"], result["trials"][result["kept"] - 1]
    peaks = [length(trial["tracking_error"]["peak"], unit) for trial in (result["trials"][0], kept)]
    if result["kept"] == 1:
        return f"no trial was better than the first one ({peaks[0]}): the current that is kept is 0"
    return f"the current of trial {result['kept']} is kept: it cuts the peak error from {peaks[0]} to {peaks[1]}"
