"""Many runs of one motion: trials that learn from each other, and repeats that compare layers.

::

    learn      trial 1 --> error --> learning.judged --> learned current --> trial 2 --> ...     --> FILE.h5
    compare    repeat 1: ptc, off, ptc+ilc    repeat 2: ptc+ilc, ptc, off    ...   --> comparison.verdict
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl import comparison, learning
from stagectl.config.stage_file import Setup
from stagectl.daemon.run import Motion
from stagectl.kernels.law import Setpoint
from stagectl.recording import learned
from stagectl.recording.hdf5 import open_recording
from stagectl.session import Say, drive_present, perform, prepare, pretend
from stagectl.units import StageError
from stagectl.words import length

Bar = Callable[[str, int], AbstractContextManager[Any]]
Result = dict[str, Any]
ILC, OFF = "ilc", "off"
_COLUMN = {name: number for number, name in enumerate(Setpoint._fields)}
_APART = 1000  # seeds between the noise of the repeats and that of the trials


class TrialError(StageError):
    """Trials that cannot be made, or one that was stopped."""


class Machine(NamedTuple):
    """Where the runs take place."""

    setup: Setup
    simulated: bool  # compiled, faster than real time; False: on the drive
    plant: Setup | None  # the simulated machine, where it is not the stage's model

    def noisy(self, number: int) -> Machine:
        """The same with other noise, where it is simulated; each number has its own."""
        if not self.simulated:
            return self
        plant = self.plant or self.setup
        simulation = plant.file.simulation
        seed = (simulation.seed + number) % 2**31
        return self._replace(plant=plant._replace(file=plant.file._replace(simulation=simulation._replace(seed=seed))))


class Shown(NamedTuple):
    """How the user sees it."""

    say: Say
    bar: Bar


@contextlib.contextmanager
def _ready(machine: Machine, shown: Shown) -> Iterator[None]:
    """A drive for all the runs, where they are not simulated."""
    if machine.simulated:
        yield
        return
    with drive_present(machine.setup, shown.say):
        yield


def _run(machine: Machine, motion: Motion, update: Callable[[int, int], None]) -> Result:
    """One run; a fault ends all of them.

    Raises TrialError with the fault and the recording that shows it.
    """
    result = pretend(motion, machine.plant) if machine.simulated else perform(motion, _unsaid, update)
    update(len(motion.plan.setpoints), len(motion.plan.setpoints))
    if result["fault"]:
        raise TrialError(f"the run was stopped: {result['fault']}; {result['recording']} shows it")
    return result


def _unsaid(_: str) -> None:
    """What a drive says at its first run holds for all; faults come with the result."""


# -- learning ---------------------------------------------------------------------------------------------------


class Learning(NamedTuple):
    """A motion that learns, as far as it has come."""

    motion: Motion
    layers: list[str]
    filters: learning.Filters
    settings: learning.Settings
    course: learning.Course


def learn(machine: Machine, base: Motion, layers: list[str], trials: int, shown: Shown, folder: Path) -> Result:
    """Make `trials` trials of `base`, recorded in `folder`; the learned current is in ``result["current"]``.

    Raises TrialError where the motion cannot be learned, or its first trial is stopped.
    """
    state = _begin(machine.setup, base, layers)
    total = trials * len(base.plan.setpoints)
    results: list[Result] = []
    stopped = ""
    with _ready(machine, shown), shown.bar(f"learn {base.meta['trajectory']}", total) as update:
        for number in range(1, trials + 1):
            try:
                result, error = _trial(machine.noisy(_APART + number), state, number, folder, update)
            except TrialError as fault:
                if number == 1:
                    raise
                stopped = f"trial {number}: {fault}; it is undone, and what was learned before is kept"
                shown.say(stopped)
                break
            state = state._replace(course=learning.judged(state.filters, state.settings, state.course, error))
            results.append(_said(result, state, number, shown))
    return _learned(state, results, stopped)


def _begin(setup: Setup, base: Motion, layers: list[str]) -> Learning:
    rows, settings = base.plan.setpoints, setup.file.learning
    if not np.all(rows[:, _COLUMN["closed"]] == 1.0) or np.any(rows[:, _COLUMN["injection"]]):
        raise TrialError(
            f"{base.meta['trajectory']} opens the loop or injects a current: there is no tracking error to learn from; "
            "take a trajectory that is a motion alone"
        )
    filters = learning.filters(setup.stage, base.law, settings, setup.dt, len(rows))
    return Learning(base, layers, filters, settings, learning.begun(len(rows)))


def _trial(
    machine: Machine, state: Learning, number: int, folder: Path, update: Callable[[int, int], None]
) -> tuple[Result, NDArray[np.float64]]:
    base = state.motion
    motion = with_current(base, state.course.learned)._replace(recording=folder / f"trial-{number}.h5")
    done = (number - 1) * len(base.plan.setpoints)
    result = _run(machine, motion, lambda now, total: update(done + now, total))
    samples = open_recording(motion.recording).samples
    return result, every_period(samples, len(base.plan.setpoints), machine.setup.dt)


def with_current(motion: Motion, current: NDArray[np.float64]) -> Motion:
    """`motion` with this learned `current` (n,) A."""
    rows = motion.plan.setpoints.copy()
    rows[:, _COLUMN["learned"]] = current
    return motion._replace(plan=motion.plan._replace(setpoints=rows))


def every_period(samples: NDArray[Any], count: int, dt: float) -> NDArray[np.float64]:
    """The error (n,) of all `count` periods; those that were late and left out lie between their neighbours."""
    rows = np.rint(samples["time"] / dt)
    return np.interp(np.arange(count), rows, samples["error"])


def _said(result: Result, state: Learning, number: int, shown: Shown) -> Result:
    """The trial's figures as JSON values, and to the user."""
    trial = state.course.trials[-1]
    scale = state.motion.meta["axis"]["travel_per_unit"]
    error, unit = result["tracking_error"], result["unit"]
    words = f"trial {number}: tracking error peak {length(error['peak'], unit)}, rms {length(error['rms'], unit)}"
    if result["saturated_cycles"]:
        words += f"; the current limit was reached in {result['saturated_cycles']} cycles"
    shown.say(f"{words}{'; ' if trial.words else ''}{trial.words}")
    found = {name: result[name] for name in ("tracking_error", "saturated_cycles", "recording")}
    return {
        "trial": number,
        **found,
        "whole": {"peak": trial.peak * scale, "rms": trial.rms * scale},
        "words": trial.words,
    }


def _learned(state: Learning, results: list[Result], stopped: str) -> Result:
    base, course = state.motion, state.course
    setup = base.setup
    kept = min(range(len(results)), key=lambda k: course.trials[k].rms)
    blank = learned.nothing(setup, base.law, base.plan.setpoints, (base.meta["trajectory"], state.layers))
    check = learning.convergence(setup.stage, base.law, state.settings, setup.dt)
    meta = {**blank.meta, "kept": kept + 1, "settings": state.settings._asdict()}
    return {
        "stage": setup.file.name,
        "trajectory": base.meta["trajectory"],
        "layers": state.layers,
        "unit": base.meta["axis"]["travel_unit"],
        "trials": results,
        "kept": kept + 1,
        "stopped": stopped,
        "convergence": [one._asdict() for one in check],
        "current": blank._replace(current=course.best, meta=meta),
    }


def convergence_words(check: list[Result], settings: learning.Settings) -> list[str]:
    """What a trial leaves of the error, in words; and where it would grow, what to do."""
    shown = ", ".join(f"{100.0 * one['most']:.0f} % ({one['plant']}, at {one['frequency']:.3g} Hz)" for one in check)
    found = [f"by the model a trial leaves at most {shown} of the error"]
    growing = [one for one in check if one["most"] >= 1.0]
    if growing:
        found.append(
            f"an axis {' or '.join(one['plant'] for one in growing)} may learn a larger error near "
            f"{growing[0]['frequency']:.3g} Hz: trials that grow are undone; learning.cutoff below "
            f"{settings.cutoff:g} Hz or a lower learning.gain prevents it"
        )
    return found


# -- comparison -------------------------------------------------------------------------------------------------


class Variant(NamedTuple):
    """One choice of layers, ready to run."""

    name: str
    motion: Motion


def variant_layers(name: str, known: tuple[str, ...]) -> list[str]:
    """``ptc+friction`` as its layers; ``off`` has none.

    Raises TrialError naming those there are.
    """
    layers = [] if name == OFF else name.split("+")
    for layer in layers:
        if layer not in (*known, ILC):
            raise TrialError(f"{name}: no layer {layer}; write {OFF}, or some of {', '.join((*known, ILC))} with +")
    if len(set(layers)) < len(layers):
        raise TrialError(f"{name}: a layer stands there twice")
    return layers


def compare(machine: Machine, variants: list[Variant], plan: tuple[int, int], shown: Shown, folder: Path) -> Result:
    """Run all `variants` in each of `plan` = (repeats, seed), interleaved; figures, differences and verdict.

    Raises TrialError where a run is stopped, or has no tracking error.
    """
    repeats, seed = plan
    blocks = comparison.order([one.name for one in variants], repeats, seed)
    motions = {one.name: one.motion for one in variants}
    found: dict[str, list[Result]] = {one.name: [] for one in variants}
    count = len(variants[0].motion.plan.setpoints)
    with _ready(machine, shown), shown.bar("compare", repeats * len(variants) * count) as update:
        for number, block in enumerate(blocks, 1):
            for place, name in enumerate(block):
                done = ((number - 1) * len(block) + place) * count
                motion = motions[name]._replace(recording=folder / f"repeat-{number}-{name}.h5")
                result = _run(machine.noisy(number), motion, lambda now, total, d=done: update(d + now, total))
                if result["tracking_error"]["peak"] is None:
                    raise TrialError(f"{result['trajectory']} has no tracking error to compare: its loop is open")
                found[name].append(result)
    return _compared(found, blocks)


def _compared(found: dict[str, list[Result]], blocks: list[list[str]]) -> Result:
    figures = [comparison.Figures(name, _each(runs, "peak"), _each(runs, "rms")) for name, runs in found.items()]
    any_run = next(iter(found.values()))[0]
    unit, lowest = any_run["unit"], comparison.best(figures)
    return {
        "stage": any_run["stage"],
        "trajectory": any_run["trajectory"],
        "unit": unit,
        "variants": [_variant(one, found[one.name]) for one in figures],
        "order": blocks,
        "identical": comparison.identical(figures),
        "best": lowest.name,
        "against_first": _against(figures, figures[0]),
        "against_best": _against(figures, lowest),
        "verdict": comparison.verdict(figures, unit),
    }


def _each(runs: list[Result], measure: str) -> NDArray[np.float64]:
    return np.array([run["tracking_error"][measure] for run in runs])


def _variant(one: comparison.Figures, runs: list[Result]) -> Result:
    figures = {
        measure: {"mean": float(np.mean(values)), "values": values.tolist()}
        for measure, values in (("peak", one.peak), ("rms", one.rms))
    }
    return {"name": one.name, **figures, "recordings": [run["recording"] for run in runs]}


def _against(figures: list[comparison.Figures], other: comparison.Figures) -> Result:
    """Differences in both measures; None stands where repeats cannot tell."""
    found: Result = {"other": other.name}
    for measure in ("peak", "rms"):
        rows = comparison.differences(figures, other, measure)
        found[measure] = [
            {key: None if value != value else value for key, value in row._asdict().items()} | {"certain": row.certain}
            for row in rows
        ]
    return found


def fresh_folder(what: str) -> Path:
    """A folder for the recordings of one comparison or one learning that is not there yet."""
    stem = Path("recordings") / f"{time.strftime('%Y%m%d-%H%M%S')}-{what}"
    names = (stem.with_name(f"{stem.name}{suffix}") for suffix in ["", *(f"-{n}" for n in range(2, 100))])
    return next(path for path in names if not path.exists())
