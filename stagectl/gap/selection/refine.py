"""Gauss-Newton over everything at once: all parameters of the effects, and the base model next to them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.effect import Shape, TimeVariation, Values
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import Direction, TrackedModel
from stagectl.gap.selection import baseline_fit, bristle_members, constants, priors, thresholds
from stagectl.gap.selection.baseline_fit import BaselineFit
from stagectl.gap.selection.candidates import EffectValues, direction, equipped, on_the_clock


class Evidence(NamedTuple):
    """The data of a diagnosis, and the baseline fit to them."""

    runs: Sequence[Run]
    base: BaselineFit
    deviations: list[list[Array]]  # whitened, of each repeat from the mean path


class Fitted(NamedTuple):
    """A base model with effects, fitted together."""

    model: TrackedModel  # base, without the effects
    effects: tuple[EffectValues, ...]
    residuals: list[list[Array]]  # whitened, of each run and repeat
    residual_sum_of_squares: float

    @property
    def equipped(self) -> TrackedModel:
        """The model with its effects in place."""
        return equipped(self.model, self.effects)


def evidence(runs: Sequence[Run], refitted: BaselineFit) -> Evidence:
    """Ready for many fits: the deviations of single repeats from their mean path do not change any more."""
    apart = sensitivities.deviations(refitted.model, runs, refitted.noise, refitted.after)
    return Evidence(runs, refitted, apart)


def repeated(e: Evidence) -> bool:
    """Whether any experiment was repeated: without repeats there is no noise floor."""
    return any(len(repeats) > 1 for repeats in e.deviations)


def residuals(e: Evidence, model: TrackedModel, effects: Sequence[EffectValues]) -> list[list[Array]]:
    """Whitened residual of each run and repeat under `model` with `effects`.

    What clips a current acts on the noise of each repeat, and what drifts on its time.
    """
    whole = equipped(model, effects)
    if any(valued.effect.time_variation or valued.effect.name in constants.CLIPPING for valued in effects):
        return sensitivities.residuals_of(whole, e.runs, e.base.noise)
    return sensitivities.residuals_about(whole, e.runs, e.base.noise, e.deviations)


def total(e: Evidence, residuals: list[list[Array]]) -> float:
    """Sum of squares over all samples that count; not finite where a simulation has diverged."""
    return baseline_fit.sum_of_squares(e.runs, residuals)


def floor(e: Evidence) -> float:
    """Sum of squares that repeats differ by."""
    return sum(
        float(np.sum((deviation * run.weight[:, None]) ** 2)) * len(repeats) / max(len(repeats) - 1, 1)
        for repeats, run in zip(e.deviations, e.runs, strict=True)
        for deviation in repeats
    )


def start(e: Evidence) -> Fitted:
    """The baseline fit, without any effect."""
    return Fitted(e.base.model, (), e.base.after, total(e, e.base.after))


def refine(
    e: Evidence,
    model: TrackedModel,
    effects: Sequence[EffectValues],
    steps: int = thresholds.REFINEMENT_STEPS,
    rival: float = math.inf,
) -> Fitted:
    """The best values of all parameters of `effects` and of the base, from their current values.

    It ends early where the sum of squares of a `rival` is out of reach: all steps that are left, each as good as the
    last one, would not come to it.
    """
    now = at_values(e, model, tuple(effects))
    if not np.isfinite(now.residual_sum_of_squares):  # it diverged: there is no step to take
        return now
    around = any(valued.effect.nonlinear for valued in effects)  # whether the base's columns are those with the effects
    e = _around(e, now) if around else e
    for remaining in reversed(range(steps)):
        before, (now, gain, promised) = now, _step(e, now)
        if gain >= thresholds.SETTLED:
            left = now.residual_sum_of_squares
            if left - remaining * (before.residual_sum_of_squares - left) > rival:
                break
            continue
        if around or promised < thresholds.BROKEN_PROMISE:
            break
        around, e = True, _around(e, now)
    return now


def first_step(e: Evidence, model: TrackedModel, effects: Sequence[EffectValues]) -> Fitted:
    """One step from these values, the base's columns taken without the effects: enough to tell initial values apart."""
    now = at_values(e, model, tuple(effects))
    return _step(e, now).after if np.isfinite(now.residual_sum_of_squares) else now


def at_values(e: Evidence, model: TrackedModel, effects: tuple[EffectValues, ...]) -> Fitted:
    """`model` with `effects` as they are, and what these leave."""
    left = residuals(e, model, effects)
    return Fitted(model, effects, left, total(e, left))


def _around(e: Evidence, now: Fitted) -> Evidence:
    """`e` with the base's columns while the effects are in the model: across a gap, friction acts differently."""

    def with_effects(p: Direction) -> Direction:
        return p._replace(change=lambda _: equipped(p.change(now.model), now.effects))

    own = [p for p in e.base.directions if not bristle_members.is_member(p.name)]
    moving = [with_effects(p) for p in (*own, *_bristle(e))]
    columns = sensitivities.all_columns(now.equipped, e.runs, moving, e.base.noise)
    return e._replace(base=e.base._replace(products=gram_matrices.products(e.runs, columns, baseline_fit.START)))


class _Step(NamedTuple):
    after: Fitted
    gain: float  # by which the cost is lower
    promised: float  # the same if all columns are right


def _step(e: Evidence, now: Fitted) -> _Step:
    """One Gauss-Newton step, or the share of it that lowers the cost; `now` where none does."""
    own, nuisance = parameters(now), nuisances(e)
    g = gram_matrices.fold_sums(tangent(e, now, own), now.residuals)
    names, prior = [*nuisance, *(p.name for p in own)], e.base.prior
    limits = np.concatenate([prior.limits(now.model, nuisance), np.array(_limits(now)).reshape(-1, 2)])
    informed = {**prior.informed(now.model, nuisance), **_informed(now)}
    weight = priors.temper(g, names, prior)
    step = priors.bounded_step(g, names, limits, informed, weight)

    def after(move: Mapping[str, float]) -> Fitted:
        return at_values(e, moved(e, now.model, move), tuple(_shifted(valued, move) for valued in now.effects))

    def cost(f: Fitted) -> float:
        sizes = sum((value / width) ** 2 for value, width in _informed(f).values())
        return weight * f.residual_sum_of_squares + prior.cost(f.model, nuisance) + sizes

    return _Step(*priors.shortened(step.move, after, cost, now), step.promised)


def nuisances(e: Evidence) -> list[str]:
    """Columns of the base that move next to every effect: its parameters, and the force of its bristle.

    A bristle that was chosen without an effect has taken on a part of it, and must give that back.
    """
    names = baseline_fit.parameter_names(e.base.directions)
    return names if e.base.bristle is None else [*names, e.base.bristle.name]


def _bristle(e: Evidence) -> list[Direction]:
    """The direction of the force of the bristle that is in the model, from the force that it has there."""
    member = e.base.bristle
    return [] if member is None else [member._replace(change=lambda m: moved(e, m, {member.name: member.size}))]


def moved(e: Evidence, model: TrackedModel, move: Mapping[str, float]) -> TrackedModel:
    """`model` with parameters of the base moved by these steps."""
    return baseline_fit.moved(model, move, e.base.bristle, e.base.prior.dt)


def moving(e: Evidence) -> list[str]:
    """Columns that move next to every effect: the base's parameters, and the bristles of the family."""
    return [direction.name for direction in e.base.directions if direction.name != baseline_fit.START]


def tangent(e: Evidence, now: Fitted, own: Sequence[Direction]) -> gram_matrices.Products:
    """The base's columns, and those of the effects' parameters at their current values."""
    columns = sensitivities.all_columns(now.equipped, e.runs, own, e.base.noise)
    return gram_matrices.with_columns(e.base.products, columns)


def parameters(now: Fitted) -> list[Direction]:
    """One direction for each parameter that may be refined, named ``effect.parameter``.

    Effects overwrite their fields, so a change is the same effect with another value on top of the whole model.
    """
    moving: list[Direction] = []
    for k, valued in enumerate(now.effects):
        if valued.effect.time_variation is not None:
            moving += _on_the_clock(valued, valued.effect.time_variation)
            continue
        narrow = _narrowness(valued)
        for amplitude in valued.effect.amplitudes:
            size = max(abs(valued.values[amplitude.name]), thresholds.LEAST_AMPLITUDE * abs(amplitude.typical[0]))
            moving.append(_replaced(now, k, amplitude.name, narrow * thresholds.AMPLITUDE_CHANGE * size))
        moving += [
            _replaced(now, k, shape.name, narrow * thresholds.SHAPE_CHANGE * valued.values[shape.name])
            for shape in _refined(valued)
        ]
    return moving


def _narrowness(valued: EffectValues) -> float:
    """Factor on the changes by which columns are taken: a resonance must stay within its own width.

    Both its frequency and the mass that takes part in it move it along the frequencies.
    """
    return min(valued.values["damping"] / thresholds.BROAD_DAMPING, 1.0) if valued.effect.resonant else 1.0


def _refined(valued: EffectValues) -> list[Shape]:
    return [shape for shape in valued.effect.shapes if shape.refined]


def _on_the_clock(valued: EffectValues, variation: TimeVariation) -> Iterator[Direction]:
    """The same for what runs on the session clock: factors of time on the columns of what it scales."""
    name, values = valued.effect.name, dict(valued.values)
    for amplitude in valued.effect.amplitudes:
        yield on_the_clock(f"{name}.{amplitude.name}", variation, amplitude.name, lambda t: variation.factor(values, t))
    first = valued.effect.amplitudes[0].name
    for shape in _refined(valued):  # an amplitude times the change of its factor
        more = {**values, shape.name: (1.0 + thresholds.SHAPE_CHANGE) * values[shape.name]}
        scale = values[first] / (thresholds.SHAPE_CHANGE * values[shape.name])

        def factor(t: Array, more: Values = more, scale: float = scale) -> Array:
            changed: Array = scale * (variation.factor(more, t) - variation.factor(values, t))
            return changed

        yield on_the_clock(f"{name}.{shape.name}", variation, first, factor)


def _replaced(now: Fitted, k: int, parameter: str, step: float) -> Direction:
    valued = now.effects[k]
    changed = EffectValues(valued.effect, {**valued.values, parameter: valued.values[parameter] + step})
    others = [*now.effects[:k], changed, *now.effects[k + 1 :]]
    plain = direction(valued, parameter, step, f"{valued.effect.name}.{parameter}")
    return plain._replace(change=lambda m: equipped(m._replace(stage=now.model.stage), others))


def _limits(now: Fitted) -> list[tuple[float, float]]:
    """How far each of the effects' parameters may move in one step, in the order of `parameters`."""
    limits: list[tuple[float, float]] = []
    for valued in now.effects:
        for amplitude in valued.effect.amplitudes:
            value = valued.values[amplitude.name]
            limits.append((amplitude.low - value, amplitude.high - value))
        for shape in _refined(valued):
            value = valued.values[shape.name]
            low, high = (
                max(value / thresholds.SHAPE_FACTOR, shape.low),
                min(value * thresholds.SHAPE_FACTOR, shape.high),
            )
            limits.append((low - value, high - value))
    return limits


def _informed(now: Fitted) -> dict[str, tuple[float, float]]:
    """How far each amplitude is from no effect, and how large it may be before any data."""
    return {
        f"{valued.effect.name}.{amplitude.name}": (
            valued.values[amplitude.name],
            thresholds.AMPLITUDE_WIDTH * max(map(abs, amplitude.typical)),
        )
        for valued in now.effects
        for amplitude in valued.effect.amplitudes
    }


def _shifted(valued: EffectValues, move: Mapping[str, float]) -> EffectValues:
    moves = {name: move.get(f"{valued.effect.name}.{name}", 0.0) for name in valued.values}
    return EffectValues(valued.effect, {name: value + moves[name] for name, value in valued.values.items()})
