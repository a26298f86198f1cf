"""The next experiment: the one that separates what the present data leave ambiguous, at least machine time a sigma.

::

    models that explain the data alike --+
    experiments of the library ----------+--> predicted records --> distance that no refit hides --> the best a second
    room that the logs have shown -------+                                  |
                                                             none: what is to be done by hand

First all promising experiments with the nuisances taken as linear, then the best of them refitted in earnest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from stagectl.gap.experiment_design import catalogue, coverage, manual_experiments, nuisance_refit, prediction_distance
from stagectl.gap.experiment_design.experiment import Experiment, yaml_of
from stagectl.gap.experiment_design.nuisance_refit import Tangent
from stagectl.gap.experiment_design.operating_range import Room, laid_out, room
from stagectl.gap.experiment_design.prediction_distance import Bench, Noise
from stagectl.gap.logs.session import Session
from stagectl.gap.result.diagnosis import NextExperiment
from stagectl.kernels.stage import Stage
from stagectl.parallel import in_parallel

PROMISING = 12  # experiments that are simulated
FINALISTS = 3  # ... and refitted
MOTION, MOTION_REFITTED = 90.0, 30.0  # s of machine time that they may take together
CLEAR = 10.0  # sigma that one run of the experiment should give
HIDDEN = 1.0  # sigma below which all motions look alike
LONGEST = 60.0  # s, of an experiment that is simulated
BEYOND = 1.1  # of what the logs have shown: from there on it is said
_ROLLING = frozenset({"presliding", "backlash", "cable_hysteresis"})  # friction's own curve may imitate them
_COLD = "thermal_viscous"  # experiments that bear on it are run with the machine cold

Models = Mapping[str, Stage]
T = TypeVar("T")


class Trial(NamedTuple):
    """An experiment with what the models predict of it."""

    experiment: Experiment
    bench: Bench
    separation: float  # sigma, of the two models that are closest
    current: float  # A, largest that any model predicts
    speed: float  # rad/s | m/s, largest

    @property
    def rate(self) -> float:
        """Information per second of machine time: separation squared grows with time."""
        return self.separation * self.separation / self.experiment.duration


def propose(session: Session, models: Models, floor: float, seen: Collection[str] = ()) -> NextExperiment | None:
    """The experiment that tells `models` apart, each of which explains the data of `session`.

    `floor` (rad | m rms) is what repeats differ by in position, for a session without repeats; `seen` are names of
    experiments that were recorded elsewhere.  With fewer than two models it is the one for what no run has shown; None
    where nothing is left to show, or neither a motion nor a hand can tell.  Raises GapError where no log moves.
    """
    space = room(session)
    if len(models) < 2:
        return _uncovered(session, space, floor)
    best = _best(session, space, models, floor, {*seen, *(log.experiment for log in session.logs)})
    if best is None or best.separation < HIDDEN:
        return _by_hand(tuple(models))
    return _next(space, best, tuple(models))


def _best(session: Session, space: Room, models: Models, floor: float, known: Collection[str]) -> Trial | None:
    noise = prediction_distance.noise_of(session, floor)
    smooth = _stepless(models)
    chosen = promising([one for one in catalogue.made(space.scale) if one.name not in known], tuple(models))
    tried = in_parallel(lambda one: _tried(_bench(session, space, noise, one), one, smooth), chosen)
    return max(_refitted(finalists(tried, space), smooth), key=lambda one: one.rate, default=None)


def _stepless(models: Models) -> dict[str, Stage]:
    """Without the steps of command and encoder that all share: two simulations that round apart differ by chance.

    First those that are quick to simulate, as it is they that are refitted.
    """
    shared = len({(p.drive.current_quantum, p.encoder.step) for p in models.values()}) == 1
    return {
        name: _smooth(models[name]) if shared else models[name]
        for name in sorted(models, key=lambda name: _slow(models[name]))
    }


def _smooth(p: Stage) -> Stage:
    return p._replace(drive=p.drive._replace(current_quantum=0.0), encoder=p.encoder._replace(step=0.0))


def _slow(p: Stage) -> bool:
    """Whether a resonance within the axis makes its simulation slow: such a model is not the one that is refitted."""
    return p.mechanics.transmission.load_share > 0.0


def promising(known: Sequence[Experiment], names: Collection[str]) -> list[Experiment]:
    """The experiments that bear on most of these effects, the shorter first where they bear on as many."""
    short = [one for one in known if one.duration <= LONGEST]
    bearing = [one for one in short if set(one.effects) & set(names)]
    ranked = sorted(bearing or short, key=lambda one: (-len(set(one.effects) & set(names)), one.duration))
    return _within(ranked, [one.duration for one in ranked], PROMISING, MOTION)


def _within(ranked: Sequence[T], durations: Sequence[float], most: int, seconds: float) -> list[T]:
    """The first of `ranked`, at least one, as many as take `seconds` of motion together."""
    total = itertools.accumulate(durations)
    return [
        one
        for k, (one, until) in enumerate(zip(ranked, total, strict=True))
        if k < most and (k == 0 or until <= seconds)
    ]


def _bench(session: Session, space: Room, noise: Noise, one: Experiment) -> Bench:
    ends = [log.start + log.rows * session.dt for log in session.logs]
    rows = laid_out(session, space, one)
    return Bench(
        rows,
        space.law,
        noise,
        space.start,
        0.0 if _COLD in one.effects else max(ends),
        session.dt,
        prediction_distance.measured(session),
        prediction_distance.rests_of(rows, session.dt),
    )


def _tried(bench: Bench, one: Experiment, models: Models) -> Trial:
    """The separation with few nuisances, taken as linear at the first of the models."""
    first, *others = models.values()
    at = nuisance_refit.tangent(bench, first, nuisance_refit.nuisances(first, False))
    told = [at, *(_plain(bench, model) for model in others)]
    pairs = itertools.combinations(told, 2)
    distances = [nuisance_refit.linear(Tangent(a.model, a.value, at.slopes, 0.0), b.value) for a, b in pairs]
    speed = float(np.abs(np.diff(bench.setpoints[:, 0])).max()) / bench.dt
    return Trial(one, bench, _smallest(distances), max(x.current for x in told), speed)


def _plain(bench: Bench, model: Stage) -> Tangent:
    at = prediction_distance.told(bench, model)
    return Tangent(model, at.values, np.zeros((0, len(at.values))), at.current)


def _smallest(distances: Sequence[float]) -> float:
    """Zero where a simulation has diverged: nothing can be said of such an experiment."""
    return min(distances, default=0.0) if all(map(math.isfinite, distances)) else 0.0


def finalists(tried: Sequence[Trial], space: Room) -> list[Trial]:
    """The best by what they tell a second; beyond what the logs have shown only where nothing else is clear."""
    within = [one for one in tried if one.separation > CLEAR and not exceeding(one, space)]
    ranked = sorted(within or tried, key=lambda one: -one.rate)
    return _within(ranked, [one.experiment.duration for one in ranked], FINALISTS, MOTION_REFITTED)


def _refitted(chosen: Sequence[Trial], models: Models) -> list[Trial]:
    """`chosen` with each model refitted in earnest to the predictions of those after it."""
    weights = bool(_ROLLING & set(models))
    ready = {name: nuisance_refit.spread(model) if weights else model for name, model in models.items()}
    free = {name: nuisance_refit.nuisances(model, weights) for name, model in ready.items()}
    last = list(ready)[-1]
    tasks = list(itertools.product(range(len(chosen)), ready))

    def at(task: tuple[int, str]) -> Tangent:
        number, name = task
        return nuisance_refit.tangent(chosen[number].bench, ready[name], [] if name == last else free[name])

    known = dict(zip(tasks, in_parallel(at, tasks), strict=True))

    def apart(pair: tuple[int, str, str]) -> float:
        number, one, truth = pair
        return nuisance_refit.refitted(chosen[number].bench, known[number, one], free[one], known[number, truth].value)

    pairs = [(k, one, truth) for k in range(len(chosen)) for one, truth in itertools.combinations(ready, 2)]
    distances = dict(zip(pairs, in_parallel(apart, pairs), strict=True))
    return [
        trial._replace(separation=_smallest([distance for pair, distance in distances.items() if pair[0] == k]))
        for k, trial in enumerate(chosen)
    ]


def _by_hand(names: tuple[str, ...]) -> NextExperiment | None:
    """What is to be done by hand where every motion looks alike under all of the models."""
    bearing = [(len(set(one.effects) & set(names)), -one.duration, one) for one in manual_experiments.MANUAL]
    count, _, best = max(bearing, key=lambda entry: entry[:2])
    if count == 0:
        return None
    words = f"No motion tells them apart, so something is to be done by hand.  {best.words}"
    return NextExperiment(best.name, "", names, 0.0, best.duration, words)


def exceeding(p: Trial, space: Room) -> list[str]:
    """What goes beyond all that the logs have shown, in words."""
    unit, per_unit = space.scale.unit, space.per_unit
    said = []
    if p.speed > BEYOND * space.seen.speed:
        said.append(f"{p.speed * per_unit:.3g} {unit}/s (the logs: {space.seen.speed * per_unit:.3g})")
    if p.current > BEYOND * space.seen.current:
        said.append(f"{p.current:.3g} A (the logs: {space.seen.current:.3g})")
    return said


def _next(space: Room, best: Trial, names: tuple[str, ...]) -> NextExperiment:
    words = [best.experiment.separates, _often(best.separation), *_heeds(space, best)]
    if _COLD in best.experiment.effects:
        words.append("Run it with the machine cold, then again.")
    return _made(best, names, words)


def _uncovered(session: Session, space: Room, floor: float) -> NextExperiment | None:
    """The experiment for what no run has shown, put to the nominal model only to see how hard it is."""
    found = coverage.advised(session, space)
    if found is None:
        return None
    one, lacking = found
    trial = _tried(
        _bench(session, space, prediction_distance.noise_of(session, floor), one), one, {"nominal": session.stage}
    )
    return _made(trial, (), [lacking, one.separates, *_heeds(space, trial)])


def _made(p: Trial, names: tuple[str, ...], words: Sequence[str]) -> NextExperiment:
    one = p.experiment
    return NextExperiment(
        one.name, f"{one.name}.yaml", names, p.separation, one.duration, "  ".join(words), yaml_of(one)
    )


def _heeds(space: Room, p: Trial) -> list[str]:
    """What whoever runs it must know."""
    beyond = " and ".join(exceeding(p, space))
    said = [f"It goes beyond what the logs have shown, to {beyond}: see that the machine may."] if beyond else []
    return [*space.heeds(), *said]


def _often(separation: float) -> str:
    if separation >= CLEAR:
        return "Three repeats show what varies by chance."
    repeats = min(math.ceil((CLEAR / separation) ** 2), 999)
    return f"One run is not clear: {repeats} repeats give {CLEAR:g} sigma."
