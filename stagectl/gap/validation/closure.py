"""How far the gap closes, and which share of it each part of the diagnosis takes."""

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence, Set
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from stagectl.gap.effects.effect import DRIVE
from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.residuals import sensitivities
from stagectl.gap.residuals.half_strokes import Run, by_experiment, runs
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.residuals.thresholds import BAND
from stagectl.gap.residuals.whitening import Whitener
from stagectl.gap.result.diagnosis import FORM, PARAMETERS, UNEXPLAINED, Gap, Trace
from stagectl.gap.selection.candidates import EffectValues, equipped, parts
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.validation import held_out_gap, rollouts
from stagectl.gap.validation.cross_validation import optimism
from stagectl.gap.validation.held_out_gap import JudgedLog, StrokeSums
from stagectl.gap.validation.shapley import scaled, shapley
from stagectl.gap.validation.thresholds import OPEN_ABOVE_FLOOR, OPEN_CLOSURE
from stagectl.kernels.fields import put
from stagectl.kernels.stage import Friction, Stage, scaled_friction, sliding
from stagectl.units import unit_on


class Closure(NamedTuple):
    """The gap before and after, and the share of it that each part takes."""

    gap: Gap
    gaps: dict[str, Gap]  # of further channels
    shares: dict[str, float]  # of the squared gap before; with the floor they sum to one
    traces: list[Trace]
    refuted: str = ""  # the effect without which the gap is smaller, surely and by the most
    open: bool = False  # whether the closed loop shows that something is missing


def closure(
    session: Session, e: Evidence, selected: Selection, improved: Stage, judged: Fitted | None = None
) -> Closure:
    """Of the held-out runs, or of all where none is: in closed loop where it is known, else along the path.

    Where none is held out, what is left is judged on blocks that did not choose the values, one after the other.  The
    nominal model, which stays where nothing comes closer, has no values that were fitted.  `judged`: the fit with the
    parameters that the loop is judged with, where these are not those that were selected.
    """
    found = _closure_of(session, e, selected._replace(fitted=judged or selected.fitted), improved)
    if improved is session.stage or any(log.held_out for log in session.logs):
        return found
    return found._replace(gap=held_out_gap.worse(found.gap, optimism(e, selected.fitted)))


def _closure_of(session: Session, e: Evidence, selected: Selection, improved: Stage) -> Closure:
    judged = [log for log in session.logs if log.held_out] or list(session.logs)
    if session.law is None or any(log.setpoints is None for log in judged):
        return along_the_path(session, e, selected, improved)
    return in_closed_loop(session, selected, improved, judged)


def in_closed_loop(session: Session, selected: Selection, improved: Stage, logs: Sequence[Log]) -> Closure:
    """The gap of the position of `logs` in closed loop; further channels where they were measured."""
    judged = held_out_gap.judged_logs(session, logs)
    before, after = (rollouts.simulated_logs(session, p, logs) for p in (session.stage, improved))
    gaps = _gaps(session, judged, (before, after), _expected(session, improved))
    position = gaps.pop("position")

    def remaining(model: TrackedModel) -> Array:
        return held_out_gap.remaining(judged, rollouts.simulated_logs(session, model.stage, logs))

    shares, refuted = _worth(session, selected, improved, remaining, position)
    traces = held_out_gap.traces(judged, before, after, position.floor, session.dt)
    measured = gaps if session.logs[0].current is not None else {}
    return Closure(position, measured, shares, traces, refuted, stays_open(position, logs))


def _expected(session: Session, improved: Stage) -> Mapping[str, Gap]:
    """The gap of each channel on the runs that chose the effects."""
    logs = [log for log in session.logs if not log.held_out]
    judged = held_out_gap.judged_logs(session, logs)
    before, after = (rollouts.simulated_logs(session, p, logs) for p in (session.stage, improved))
    return _gaps(session, judged, (before, after), {})


def _gaps(
    session: Session, judged: Sequence[JudgedLog], rows: tuple[list[Array], list[Array]], expected: Mapping[str, Gap]
) -> dict[str, Gap]:
    """The gap of each channel of the simulated `rows` before and after, with the closure that was `expected`."""
    gaps = {}
    for channel, unit in (("position", unit_on(session.kind, "rad | m")), ("current", "A")):
        before, after = (held_out_gap.squares(judged, simulated, channel) for simulated in rows)
        least = held_out_gap.floor(judged, rows[1], channel)
        closing = expected[channel].closure if channel in expected else None
        gaps[channel] = held_out_gap.gap(before, after, least, unit, closing)
    return gaps


def stays_open(gap: Gap, judged: Sequence[Log]) -> bool:
    """Whether the loop shows that something is missing: a gap far above the floor, and surely a part only closes.

    The residual along the measured path may lie within the form of friction, and no coordinate may order it.  False
    where one of the `judged` runs was not repeated, or copied: the floor is not known then, and noise is no gap.
    """
    repeated = gap.floor > 0.0 and all(len(repeats) > 1 for repeats in by_experiment(judged).values())
    return repeated and gap.after > OPEN_ABOVE_FLOOR * gap.floor and gap.high < OPEN_CLOSURE


def along_the_path(session: Session, e: Evidence, selected: Selection, improved: Stage) -> Closure:
    """The gap of the effort along the measured path, where no loop can be simulated."""
    now, dt, noise = selected.fitted.model, session.dt, e.base.noise
    paths = runs(session, any(log.held_out for log in session.logs))
    nominal, better = sensitivities.model_of(session.stage, session.dt), now._replace(stage=improved)
    before, after = (effort(model, paths, noise, dt) for model in (nominal, better))
    least = effort_floor(now, paths, noise, dt)
    gap = held_out_gap.gap(before, after, least, unit_on(session.kind, "N m | N"))
    gap = gap._replace(effort=_whole_effort(paths, session.stage.motor.force_constant))

    def remaining(model: TrackedModel) -> Array:
        return np.array([effort(model, paths, noise, dt).squares.sum()])

    shares, _ = _worth(session, selected, improved, remaining, gap)  # one sum refutes nothing
    return Closure(gap, {}, shares, [])


def _worth(
    session: Session, selected: Selection, improved: Stage, remaining: Callable[[TrackedModel], Array], gap: Gap
) -> tuple[dict[str, float], str]:
    """Shares of the squared gap before: parameters, the form of the friction, effects, the unexplained, noise.

    Also the effect that is refuted.  `remaining` gives the sums of squares (k,) that a model leaves of each experiment.
    What only the table of `improved` takes is unexplained.
    """
    now, nominal = selected.fitted, sensitivities.model_of(session.stage, session.dt)
    tables = [UNEXPLAINED] if improved.residual is not session.stage.residual else []
    names = [name for valued in now.effects for name in parts(valued)]
    rubs = slides(now.model.stage, nominal.stage)
    form = [FORM] if rubs and not keeps_form(improved, session.stage) else []

    @functools.cache
    def of(members: frozenset[str]) -> Array:
        model = now.model if PARAMETERS in members else nominal
        if rubs:
            law = (now.model if FORM in members else nominal).stage.friction
            model = put(model, "stage.friction", rubbing(model.stage.friction, law))
        if UNEXPLAINED in members:
            model = put(model, "stage.residual", improved.residual)
        return remaining(equipped(model, _among(now.effects, members)))

    players = [PARAMETERS, *form, *names, *tables]
    shares = scaled(shapley(players, lambda members: float(of(members).sum())), gap)
    whole = frozenset(players)
    spared = unjudged(session, selected)
    judged = [valued for valued in now.effects if valued.effect.name not in spared]
    without = {valued.effect.name: whole - set(parts(valued)) for valued in judged}
    return shares, most_harmful({name: _log(of(whole)) - _log(of(rest)) for name, rest in without.items()})


def _among(effects: Sequence[EffectValues], members: Set[str]) -> list[EffectValues]:
    """Those of the `effects` that are among `members`, as far as they are: a part needs all parts before it."""
    present = (itertools.takewhile(lambda part: part[0] in members, parts(valued).items()) for valued in effects)
    return [last for each in present for _, last in list(each)[-1:]]


def unjudged(session: Session, selected: Selection) -> frozenset[str]:
    """Effects of which the gap of the position says little.

    No loop has the function that some stand next to.  Of the drive, a current that was measured tells far more: the
    feedback hides from the position what a current lacks, and the friction's error of form decides what is left of it.
    """
    drive = {valued.effect.name for valued in selected.fitted.effects if valued.effect.block == DRIVE}
    return selected.beside | (drive if session.logs[0].current is not None else set())


def slides(p: Stage, nominal: Stage) -> bool:
    """Whether both have friction, so that one law can be scaled to the other's size."""
    return sliding(p.friction) > 0.0 and sliding(nominal.friction) > 0.0


def rubbing(size: Friction, law: Friction) -> Friction:
    """The friction `size`, with the curve of the `law` scaled to it."""
    law = scaled_friction(law, sliding(size) / sliding(law))
    return size._replace(operators=law.operators, bristle=law.bristle)


def keeps_form(p: Stage, nominal: Stage) -> bool:
    """Whether the friction of `p` has the curve of the nominal one, whatever its size."""
    if not slides(p, nominal):
        return False
    own, law = (_curve(friction) for friction in (p.friction, rubbing(p.friction, nominal.friction)))
    return len(own) == len(law) and np.allclose(own, law, rtol=1e-9, atol=0.0)


def _curve(p: Friction) -> Array:
    bristle = p.bristle
    return np.array([*p.operators.weight, *p.operators.slip, *bristle[:-1], *bristle.stribeck])


def most_harmful(wider: Mapping[str, Array]) -> str:
    """The effect that surely widens the gap, and by the most; empty where none does.

    `wider` holds the logarithm (k,) by which each widens the squared gap of each experiment.  Sure is 97.5 % of
    Student's t over the experiments: what is wrong with a model is wrong in all half strokes of one motion, and a
    motion that never repeats, such as one that sticks at rest, counts no more than another.
    """
    means = {name: float(np.mean(each)) for name, each in wider.items() if _surely_positive(each)}
    return max(means, key=means.__getitem__, default="")


def _log(squares: Array) -> Array:
    return np.log(np.maximum(squares, 1e-300))  # a simulated log may be met to the bit


def _surely_positive(values: Array) -> bool:
    count = len(values)
    return count > 1 and np.mean(values) > stdtrit(count - 1, 0.975) * np.std(values, ddof=1) / math.sqrt(count)


def effort(p: TrackedModel, runs: Sequence[Run], noise: Whitener, dt: float) -> StrokeSums:
    """Missing effort of the model along the runs, in the band of the cuts, over half strokes (N m | N)."""
    scale = math.sqrt(BAND / dt)  # back from unit density to the signal's own size
    residuals = _residuals(p, runs, noise)
    return _by_stroke(runs, [[scale * residual for residual in repeats] for repeats in residuals])


def _whole_effort(runs: Sequence[Run], force_constant: float) -> float:
    """Root mean square (N m | N) of the effort of the runs: of the measured current, or of the commanded one."""
    rows = np.concatenate([run.mean.rows for run in runs])
    current = rows[:, 2] if np.isfinite(rows[:, 2]).all() else rows[:, 0]
    return force_constant * float(np.sqrt(np.mean(current**2)))


def effort_floor(p: TrackedModel, runs: Sequence[Run], noise: Whitener, dt: float) -> StrokeSums:
    """What repeats differ by in that effort; zeros where nothing was repeated."""
    deviations = []
    for repeats in _residuals(p, runs, noise):
        mean, count = np.mean(repeats, axis=0), len(repeats)
        scale = math.sqrt(BAND / dt * count / max(count - 1, 1))
        deviations.append([scale * (residual - mean) for residual in repeats])
    return _by_stroke(runs, deviations)


def _residuals(p: TrackedModel, runs: Sequence[Run], noise: Whitener) -> list[list[Array]]:
    """Effort (m,) of each run and repeat, not weighted by frequency."""
    flat = Whitener(noise.frequency, np.ones_like(noise.effort), np.zeros_like(noise.current))
    return [[residual[:, 0] for residual in repeats] for repeats in sensitivities.residuals_of(p, runs, flat)]


def _by_stroke(runs: Sequence[Run], signals: Sequence[Sequence[Array]]) -> StrokeSums:
    squares, samples = [], []
    for run, repeats in zip(runs, signals, strict=True):
        strokes = [run.cluster == number for number in np.unique(run.cluster)]
        square = np.sum([(signal * run.weight) ** 2 for signal in repeats], axis=0)
        squares += [float(square[stroke].sum()) for stroke in strokes]
        samples += [len(repeats) * float(run.weight[stroke].sum()) for stroke in strokes]
    return StrokeSums(np.array(squares), np.array(samples))
