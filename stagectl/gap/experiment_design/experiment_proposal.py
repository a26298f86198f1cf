"""The next experiment: the one that separates what the present data leave ambiguous, with the least machine time.

::

    models that explain the data alike --+
    experiments of the catalogue --------+--> predicted records --> distance that no refit hides --> the best a second
    range that the logs have shown ------+                                  |
                                                             none: what is to be done by hand

First all promising experiments with the nuisances taken as linear, then the best of them with the nuisances refitted.
"""

import functools
import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from stagectl.gap.effects.stage_changes import put
from stagectl.gap.experiment_design import catalogue, coverage, nuisance_refit, prediction_distance, thresholds
from stagectl.gap.experiment_design.experiment import Experiment, made, yaml_of
from stagectl.gap.experiment_design.nuisance_refit import Linearised
from stagectl.gap.experiment_design.operating_range import OperatingRange, operating_range, setpoints_for
from stagectl.gap.experiment_design.prediction_distance import PlannedRun, RepeatNoise
from stagectl.gap.inference import verdict
from stagectl.gap.logs.log_start import LogStart
from stagectl.gap.logs.session import Session
from stagectl.gap.residuals.half_strokes import kept, standstills
from stagectl.gap.result.diagnosis import DiagnosisResult, NextExperiment
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.refine import Evidence
from stagectl.gap.validation.rollouts import Rollout
from stagectl.kernels.stage import Stage
from stagectl.parallel import in_parallel

ROLLING = frozenset({"presliding", "backlash", "cable_hysteresis"})  # friction's own curve may imitate them
COLD = "thermal_viscous"  # experiments that bear on it are run with the machine cold

Models = Mapping[str, Stage]
T = TypeVar("T")


class SimulatedExperiment(NamedTuple):
    """An experiment with what the models predict of it."""

    experiment: Experiment
    run: PlannedRun
    separation: float  # sigma, of the two models that are closest
    current: float  # A, largest that any model predicts
    speed: float  # rad/s | m/s, largest

    @property
    def rate(self) -> float:
        """Information per second of machine time: separation squared grows with time."""
        return self.separation * self.separation / self.experiment.duration


def next_experiment(
    session: Session, result: DiagnosisResult, selected: Selection, e: Evidence
) -> NextExperiment | None:
    """The experiment that separates the first ambiguous effect from its alternatives.

    Where no effect is ambiguous it shows what no run has shown.  Raises GapError where no experiment can be made.
    """
    ambiguous = next((effect for effect in result.named if effect.alternatives and not effect.parameter), None)
    models = {"nominal": session.stage}
    if ambiguous is not None:
        models = {ambiguous.name: selected.fitted.equipped.stage, **verdict.rivals(e, selected, ambiguous)}
    return propose(session, models, result.gap.floor)


def propose(session: Session, models: Models, floor: float) -> NextExperiment | None:
    """The experiment that separates `models`, each of which explains the data of `session`.

    `floor` (rad | m rms) is what repeats differ by in position, for a session without repeats.  With fewer than two
    models it is the one for what no run has shown.  None where nothing is left to show, or neither a motion nor a
    change by hand separates them.  Raises GapError where no log moves.
    """
    within = operating_range(session)
    if len(models) < 2:
        return _uncovered(session, within, floor)
    best = _best(session, within, models, floor)
    if best is None or best.separation < thresholds.HIDDEN_SIGMA:
        return by_hand(tuple(models))
    return _separating(within, best, tuple(models))


def _best(session: Session, within: OperatingRange, models: Models, floor: float) -> SimulatedExperiment | None:
    noise, known = prediction_distance.noise_of(session, floor), {log.experiment for log in session.logs}
    smooth = _without_steps(models)
    recipes = {name: recipe for name, recipe in catalogue.RECIPES.items() if name not in known}
    chosen = promising(made(within.scale, recipes), tuple(models))
    simulated = in_parallel(
        lambda chosen: _simulated(planned_run(session, within, noise, chosen), chosen, smooth), chosen
    )
    refitted = _refitted(finalists(simulated, within), smooth)
    return max(refitted, key=lambda candidate: candidate.rate, default=None)


def _without_steps(models: Models) -> dict[str, Stage]:
    """Without the steps of command and encoder that all share: two simulations that round apart differ by chance.

    Those that are quick to simulate, without a resonance within the axis, come first: they are refitted.
    """
    names = sorted(models, key=lambda name: models[name].mechanics.transmission.load_share > 0.0)
    if len({(p.drive.current_quantum, p.encoder.step) for p in models.values()}) > 1:
        return {name: models[name] for name in names}
    changes = {"drive.current_quantum": 0.0, "encoder.step": 0.0}
    return {name: functools.reduce(lambda p, change: put(p, *change), changes.items(), models[name]) for name in names}


def promising(known: Sequence[Experiment], names: Collection[str]) -> list[Experiment]:
    """The experiments that bear on most of these effects, the shorter first where they bear on as many."""

    def bearing(experiment: Experiment) -> int:
        return len(set(experiment.effects) & set(names))

    short = [experiment for experiment in known if experiment.duration <= thresholds.LONGEST_EXPERIMENT]
    ranked = sorted(filter(bearing, short), key=lambda chosen: (-bearing(chosen), chosen.duration))
    ranked = ranked or sorted(short, key=lambda chosen: chosen.duration)
    return _within(ranked, [chosen.duration for chosen in ranked], thresholds.PROMISING, thresholds.SIMULATED_MOTION)


def _within(ranked: Sequence[T], durations: Sequence[float], most: int, seconds: float) -> list[T]:
    """The first of `ranked`, at least one, as many as take `seconds` of motion together."""
    totals = list(itertools.accumulate(durations))
    return [item for k, item in enumerate(ranked) if k < most and (k == 0 or totals[k] <= seconds)]


def planned_run(session: Session, within: OperatingRange, noise: RepeatNoise, experiment: Experiment) -> PlannedRun:
    """`experiment` as it would be run next, after the last log; with the machine cold where it bears on warming."""
    end = max(log.start + log.rows * session.dt for log in session.logs)
    rows = setpoints_for(session, within, experiment)
    start = LogStart(within.start, 0.0 if COLD in experiment.effects else end)
    rollout = Rollout(rows, within.law, start, session.dt)
    rests = kept(standstills(rows[:, 0], session.dt))
    return PlannedRun(rollout, noise, prediction_distance.measured(session), rests)


def _simulated(run: PlannedRun, experiment: Experiment, models: Models) -> SimulatedExperiment:
    """The separation with few nuisances, taken as linear at the first of the models."""
    first, *others = models.values()
    at = nuisance_refit.linearised(run, first, nuisance_refit.nuisances(first, False))
    predictions = [(at.value, at.current), *(prediction_distance.predict(run, model) for model in others)]
    pairs = itertools.combinations((values for values, _ in predictions), 2)
    distances = [nuisance_refit.linear_distance(value, at.slopes, truth) for value, truth in pairs]
    speed = float(np.abs(np.diff(run.rollout.setpoints[:, 0])).max()) / run.rollout.dt
    return SimulatedExperiment(experiment, run, _smallest(distances), max(current for _, current in predictions), speed)


def _smallest(distances: Sequence[float]) -> float:
    """Zero where a simulation has diverged: such an experiment gives no prediction."""
    return min(distances, default=0.0) if all(map(math.isfinite, distances)) else 0.0


def finalists(simulated: Sequence[SimulatedExperiment], within: OperatingRange) -> list[SimulatedExperiment]:
    """The best by their rate; those beyond what the logs have shown only where nothing else is clear."""
    safe = [item for item in simulated if item.separation > thresholds.CLEAR_SIGMA and not exceeding(item, within)]
    ranked = sorted(safe or simulated, key=lambda item: -item.rate)
    return _within(
        ranked, [item.experiment.duration for item in ranked], thresholds.FINALISTS, thresholds.REFITTED_MOTION
    )


def _refitted(chosen: Sequence[SimulatedExperiment], models: Models) -> list[SimulatedExperiment]:
    """`chosen` with each model refitted to the predictions of those after it."""
    weights = bool(ROLLING & set(models))
    ready = {name: nuisance_refit.spread(model) if weights else model for name, model in models.items()}
    free = {name: nuisance_refit.nuisances(model, weights) for name, model in ready.items()}
    last = list(ready)[-1]  # only its prediction is needed
    tasks = list(itertools.product(range(len(chosen)), ready))

    def at(task: tuple[int, str]) -> Linearised:
        number, name = task
        return nuisance_refit.linearised(chosen[number].run, ready[name], [] if name == last else free[name])

    known = dict(zip(tasks, in_parallel(at, tasks), strict=True))

    def apart(pair: tuple[int, str, str]) -> float:
        number, name, truth = pair
        target = known[number, truth].value
        return nuisance_refit.refitted_distance(chosen[number].run, known[number, name], free[name], target)

    pairs = [(k, name, truth) for k in range(len(chosen)) for name, truth in itertools.combinations(ready, 2)]
    distances = dict(zip(pairs, in_parallel(apart, pairs), strict=True))
    return [
        item._replace(separation=_smallest([distance for pair, distance in distances.items() if pair[0] == k]))
        for k, item in enumerate(chosen)
    ]


def by_hand(names: tuple[str, ...]) -> NextExperiment | None:
    """What is to be done by hand where every motion looks alike under all of the models; None where nothing helps."""

    def rank(manual: catalogue.ManualExperiment) -> tuple[int, float]:
        return len(set(manual.effects) & set(names)), -manual.duration

    best = max(catalogue.MANUAL, key=rank)
    if rank(best)[0] == 0:
        return None
    words = f"No motion separates them, so something has to be done by hand.  {best.words}"
    return NextExperiment(best.name, "", names, 0.0, best.duration, words)


def exceeding(p: SimulatedExperiment, within: OperatingRange) -> list[str]:
    """What goes beyond all that the logs have shown, in words."""
    unit, per_unit = within.scale.unit, within.per_unit
    lines = []
    if p.speed > thresholds.MENTIONED * within.seen.speed:
        lines.append(f"{p.speed * per_unit:.3g} {unit}/s (the logs: {within.seen.speed * per_unit:.3g})")
    if p.current > thresholds.MENTIONED * within.seen.current:
        lines.append(f"{p.current:.3g} A (the logs: {within.seen.current:.3g})")
    return lines


def _separating(within: OperatingRange, best: SimulatedExperiment, names: tuple[str, ...]) -> NextExperiment:
    words = [best.experiment.separates, repeats_needed(best.separation), *_cautions(within, best)]
    if COLD in best.experiment.effects:
        words.append("Run it with the machine cold, then again.")
    return _next(best, names, words)


def _uncovered(session: Session, within: OperatingRange, floor: float) -> NextExperiment | None:
    """The experiment for what no run has shown, simulated with the nominal model only to see how hard it is."""
    advice = coverage.advised(session, within)
    if advice is None:
        return None
    experiment, missing = advice
    run = planned_run(session, within, prediction_distance.noise_of(session, floor), experiment)
    simulated = _simulated(run, experiment, {"nominal": session.stage})
    return _next(simulated, (), [missing, experiment.separates, *_cautions(within, simulated)])


def _next(p: SimulatedExperiment, names: tuple[str, ...], words: Sequence[str]) -> NextExperiment:
    made = p.experiment
    return NextExperiment(
        made.name, f"{made.name}.yaml", names, p.separation, made.duration, "  ".join(words), yaml_of(made)
    )


def _cautions(within: OperatingRange, p: SimulatedExperiment) -> list[str]:
    """What whoever runs it must know."""
    beyond = " and ".join(exceeding(p, within))
    lines = [f"It goes beyond what the logs have shown, to {beyond}: check that the machine allows it."]
    return [*within.cautions(), *(lines if beyond else [])]


def repeats_needed(separation: float) -> str:
    """How often the experiment is to be run, in words, by its `separation` (sigma)."""
    if separation >= thresholds.CLEAR_SIGMA:
        return "Three repeats show what varies by chance."
    repeats = min(math.ceil((thresholds.CLEAR_SIGMA / separation) ** 2), thresholds.MOST_REPEATS)
    return f"One run is not clear: {repeats} repeats give {thresholds.CLEAR_SIGMA:g} sigma."
