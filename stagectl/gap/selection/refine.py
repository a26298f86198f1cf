"""Gauss-Newton over everything at once: all parameters of the effects, and the base model next to them."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.residuals.half_strokes import Run, noise_of_all
from stagectl.gap.residuals.sensitivities import Direction, TrackedModel
from stagectl.gap.selection import (
    baseline_fit,
    bristle_members,
    candidates,
    constants,
    effect_parameters,
    priors,
    thresholds,
)
from stagectl.gap.selection.baseline_fit import BaselineFit
from stagectl.gap.selection.candidates import EffectValues, equipped
from stagectl.gap.selection.free_function import FreeFunction


class Evidence(NamedTuple):
    """The data of a diagnosis, and the baseline fit to them."""

    runs: Sequence[Run]
    base: BaselineFit
    deviations: list[list[Array]]  # whitened, of each repeat from the mean path
    beside: FreeFunction | None = None  # what is missing beside all effects


class Fitted(NamedTuple):
    """A base model with effects, fitted together."""

    model: TrackedModel  # base, without the effects
    effects: tuple[EffectValues, ...]
    residuals: list[list[Array]]  # whitened, of each run and repeat
    residual_sum_of_squares: float  # less what the function beside takes

    @property
    def equipped(self) -> TrackedModel:
        """The model with its effects in place."""
        return equipped(self.model, self.effects)


class Shape(NamedTuple):
    """What of the base's model may move besides its parameters."""

    directions: Sequence[Direction] = ()  # also of parameters whose columns are not those of the baseline fit any more
    limits: Mapping[str, tuple[float, float]] = {}  # how far each may move that is no parameter
    moved: Callable[[TrackedModel, Mapping[str, float]], TrackedModel] = lambda model, _: model


AS_IT_IS = Shape()


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
    """Sum of squares over all samples that count, less what the function beside takes; not finite after divergence."""
    whole = baseline_fit.sum_of_squares(e.runs, residuals)
    return whole if e.beside is None or not np.isfinite(whole) else whole - e.beside.explained(residuals)


def floor(e: Evidence) -> float:
    """Sum of squares that repeats differ by, with as much for what was recorded once."""
    return noise_of_all(e.runs) * sum(
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
    e = around_effects(e, now) if around else e
    for remaining in reversed(range(steps)):
        before, (now, gain, promised) = now, step(e, now)
        if gain >= thresholds.SETTLED:
            left = now.residual_sum_of_squares
            if left - remaining * (before.residual_sum_of_squares - left) > rival:
                break
            continue
        if around or promised < thresholds.BROKEN_PROMISE:
            break
        around, e = True, around_effects(e, now)
    return now


def at_values(e: Evidence, model: TrackedModel, effects: tuple[EffectValues, ...]) -> Fitted:
    """`model` with `effects` as they are, and what these leave."""
    left = residuals(e, model, effects)
    return Fitted(model, effects, left, total(e, left))


def around_effects(e: Evidence, now: Fitted) -> Evidence:
    """`e` with the base's columns while the effects are in the model: across a gap, friction acts differently."""
    own = [p for p in e.base.directions if not bristle_members.is_member(p.name)]
    moving = [candidates.beside(p, now.model, now.effects) for p in (*own, *bristle(e))]
    columns = sensitivities.all_columns(now.equipped, e.runs, moving, e.base.noise)
    return with_products(e, gram_matrices.products(e.runs, columns, baseline_fit.START), e.beside)


def with_products(e: Evidence, products: gram_matrices.Products, beside: FreeFunction | None) -> Evidence:
    """`e` with these `products` of the base's columns, and with those of the function `beside` next to them."""
    joined = products if beside is None else gram_matrices.with_columns(products, beside.columns)
    return e._replace(base=e.base._replace(products=joined), beside=beside)


class Step(NamedTuple):
    """A Gauss-Newton step."""

    after: Fitted
    gain: float  # by which the cost is lower
    promised: float  # the same if all columns are right


def step(e: Evidence, now: Fitted, shape: Shape = AS_IT_IS) -> Step:
    """One Gauss-Newton step, or the share of it that lowers the cost; `now` where none does."""
    own, nuisance = parameters(now), nuisances(e)
    further = [candidates.beside(p, now.model, now.effects) for p in shape.directions]
    g = gram_matrices.fold_sums(tangent(e, now, [*own, *further]), now.residuals)
    free = free_names(e)
    names, prior = [*nuisance, *(p.name for p in own), *shape.limits, *free], e.base.prior
    anywhere = [(-np.inf, np.inf)] * len(free)
    of_effects = effect_parameters.limits(now.effects)
    limits = [*prior.limits(now.model, nuisance), *of_effects, *shape.limits.values(), *anywhere]
    informed = {**prior.informed(now.model, nuisance), **effect_parameters.informed(now.effects)}
    informed |= {} if e.beside is None else dict.fromkeys(free, (0.0, e.beside.deviation))
    weight = priors.temper(g, names, prior)
    best = priors.bounded_step(g, names, np.array(limits).reshape(-1, 2), informed, weight)

    def after(move: Mapping[str, float]) -> Fitted:
        shifted = tuple(effect_parameters.shifted(valued, move) for valued in now.effects)
        return at_values(e, shape.moved(moved(e, now.model, move), move), shifted)

    def cost(f: Fitted) -> float:
        sizes = sum((value / width) ** 2 for value, width in effect_parameters.informed(f.effects).values())
        return weight * f.residual_sum_of_squares + prior.cost(f.model, nuisance) + sizes

    return Step(*priors.shortened(best.move, after, cost, now), best.promised)


def nuisances(e: Evidence) -> list[str]:
    """Columns of the base that move next to every effect: its parameters, and the force of its bristle.

    A bristle that was chosen without an effect has taken on a part of it, and must give that back.
    """
    names = baseline_fit.parameter_names(e.base.directions)
    return names if e.base.bristle is None else [*names, e.base.bristle.name]


def free_names(e: Evidence) -> tuple[str, ...]:
    """Columns of the function beside, which move next to everything."""
    return () if e.beside is None else e.beside.names


def bristle(e: Evidence) -> list[Direction]:
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
    """One direction for each parameter of the effects that may be refined, named ``effect.parameter``."""
    return effect_parameters.directions(now.model, now.effects)
