"""Gauss-Newton over everything at once: all parameters of the effects, and the base model next to them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.library import Shape, TimeVariation, Values
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.linear_fit import bounded_step
from stagectl.gap.residuals.sensitivities import Direction, TrackedModel
from stagectl.gap.selection import baseline_fit
from stagectl.gap.selection.baseline_fit import BaselineFit
from stagectl.gap.selection.candidates import EffectValues, direction, equipped, on_the_clock
from stagectl.gap.selection.thresholds import (
    AMPLITUDE_CHANGE,
    LEAST_AMPLITUDE,
    REFINEMENT_STEPS,
    SETTLED,
    SHAPE_CHANGE,
    SHAPE_FACTOR,
    STEP_SHARES,
)


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
    means = sensitivities.mean_residuals(refitted.model, runs, refitted.noise)
    deviations = [[one - mean for one in repeats] for repeats, mean in zip(refitted.after, means, strict=True)]
    return Evidence(runs, refitted, deviations)


def repeated(e: Evidence) -> bool:
    """Whether any experiment was repeated: without repeats there is no noise floor."""
    return any(len(repeats) > 1 for repeats in e.deviations)


def residuals(e: Evidence, model: TrackedModel, effects: Sequence[EffectValues]) -> list[list[Array]]:
    """Whitened residual of each run and repeat under `model` with `effects`."""
    whole = equipped(model, effects)
    if any(one.effect.time_variation is not None for one in effects):
        return sensitivities.residuals_of(whole, e.runs, e.base.noise)
    means = sensitivities.mean_residuals(whole, e.runs, e.base.noise)
    return [[mean + one for one in repeats] for mean, repeats in zip(means, e.deviations, strict=True)]


def total(e: Evidence, residuals: list[list[Array]]) -> float:
    """Sum of squares over all samples that count; not finite where a simulation has diverged."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(
            sum(
                np.sum((one * run.weight[:, None]) ** 2)
                for run, repeats in zip(e.runs, residuals, strict=True)
                for one in repeats
            )
        )


def floor(e: Evidence) -> float:
    """Sum of squares that repeats differ by."""
    return sum(
        float(np.sum((one * run.weight[:, None]) ** 2)) * len(repeats) / max(len(repeats) - 1, 1)
        for repeats, run in zip(e.deviations, e.runs, strict=True)
        for one in repeats
    )


def start(e: Evidence) -> Fitted:
    """The baseline fit, without any effect."""
    return Fitted(e.base.model, (), e.base.after, total(e, e.base.after))


def refine(e: Evidence, model: TrackedModel, effects: Sequence[EffectValues], steps: int = REFINEMENT_STEPS) -> Fitted:
    """The best values of all parameters of `effects` and of the base, from their current values."""
    now = _fitted(e, model, tuple(effects))
    if not np.isfinite(now.residual_sum_of_squares):  # it diverged: there is no step to take
        return now
    if any(one.effect.nonlinear for one in effects):
        e = e._replace(base=e.base._replace(products=_base_products(e, now)))
    for _ in range(steps):
        after = _step(e, now)
        if after.residual_sum_of_squares > now.residual_sum_of_squares * (1.0 - SETTLED):
            return after if after.residual_sum_of_squares < now.residual_sum_of_squares else now
        now = after
    return now


def _fitted(e: Evidence, model: TrackedModel, effects: tuple[EffectValues, ...]) -> Fitted:
    left = residuals(e, model, effects)
    return Fitted(model, effects, left, total(e, left))


def _base_products(e: Evidence, now: Fitted) -> gram_matrices.Products:
    """The base's columns with the effects in the model: across a gap, friction acts differently."""
    moving = [one for one in e.base.directions if not baseline_fit.is_member(one.name)]

    def with_effects(one: Direction) -> Direction:
        return one._replace(change=lambda _: equipped(one.change(now.model), now.effects))

    columns = sensitivities.all_columns(now.equipped, e.runs, [with_effects(one) for one in moving], e.base.noise)
    return gram_matrices.products(e.runs, columns, baseline_fit.START)


def _step(e: Evidence, now: Fitted) -> Fitted:
    """One Gauss-Newton step, or the share of it that improves the fit; `now` where none does."""
    own, nuisance = parameters(now), nuisances(e)
    g = gram_matrices.fold_sums(tangent(e, now, own), now.residuals)
    low, high = np.array([(baseline_fit.lowest(now.model, name), np.inf) for name in nuisance] + _limits(now)).T
    step = bounded_step(g, [*nuisance, *(one.name for one in own)], low, high)
    for share in STEP_SHARES:
        after = _fitted(e, *_moved(now, {name: share * value for name, value in step.items()}))
        if after.residual_sum_of_squares < now.residual_sum_of_squares:
            return after
    return now


def nuisances(e: Evidence) -> list[str]:
    """Columns of the base that move next to every effect."""
    return baseline_fit.parameter_names(e.base.directions)


def tangent(e: Evidence, now: Fitted, own: Sequence[Direction]) -> gram_matrices.Products:
    """The base's columns, and those of the effects' parameters at their current values."""
    columns = sensitivities.all_columns(now.equipped, e.runs, own, e.base.noise)
    return gram_matrices.with_columns(e.base.products, columns)


def parameters(now: Fitted) -> list[Direction]:
    """One direction for each parameter that may be refined, named ``effect.parameter``.

    Effects overwrite their fields, so a change is the same effect with another value on top of the whole model.
    """
    moving: list[Direction] = []
    for k, one in enumerate(now.effects):
        if one.effect.time_variation is not None:
            moving += _on_the_clock(one, one.effect.time_variation)
            continue
        for amplitude in one.effect.amplitudes:
            size = max(abs(one.values[amplitude.name]), LEAST_AMPLITUDE * abs(amplitude.typical[0]))
            moving.append(_replaced(now, k, amplitude.name, AMPLITUDE_CHANGE * size))
        moving += [_replaced(now, k, shape.name, SHAPE_CHANGE * one.values[shape.name]) for shape in _refined(one)]
    return moving


def _refined(one: EffectValues) -> list[Shape]:
    return [shape for shape in one.effect.shapes if shape.refined]


def _on_the_clock(one: EffectValues, variation: TimeVariation) -> Iterator[Direction]:
    """The same for what runs on the session clock: factors of time on the columns of what it scales."""
    name, values = one.effect.name, dict(one.values)
    for amplitude in one.effect.amplitudes:
        yield on_the_clock(f"{name}.{amplitude.name}", variation, amplitude.name, lambda t: variation.factor(values, t))
    first = one.effect.amplitudes[0].name
    for shape in _refined(one):  # an amplitude times the change of its factor
        more = {**values, shape.name: (1.0 + SHAPE_CHANGE) * values[shape.name]}
        scale = values[first] / (SHAPE_CHANGE * values[shape.name])

        def factor(t: Array, more: Values = more, scale: float = scale) -> Array:
            changed: Array = scale * (variation.factor(more, t) - variation.factor(values, t))
            return changed

        yield on_the_clock(f"{name}.{shape.name}", variation, first, factor)


def _replaced(now: Fitted, k: int, parameter: str, step: float) -> Direction:
    one = now.effects[k]
    changed = EffectValues(one.effect, {**one.values, parameter: one.values[parameter] + step})
    others = [*now.effects[:k], changed, *now.effects[k + 1 :]]
    plain = direction(one, parameter, step, f"{one.effect.name}.{parameter}")
    return plain._replace(change=lambda m: equipped(m._replace(stage=now.model.stage), others))


def _moved(now: Fitted, move: Mapping[str, float]) -> tuple[TrackedModel, tuple[EffectValues, ...]]:
    return baseline_fit.moved(now.model, move, None), tuple(_shifted(one, move) for one in now.effects)


def _limits(now: Fitted) -> list[tuple[float, float]]:
    """How far each of the effects' parameters may move in one step, in the order of `parameters`."""
    limits: list[tuple[float, float]] = []
    for one in now.effects:
        for amplitude in one.effect.amplitudes:
            value = one.values[amplitude.name]
            limits.append((amplitude.low - value, amplitude.high - value))
        for shape in _refined(one):
            value = one.values[shape.name]
            low, high = max(value / SHAPE_FACTOR, shape.low), min(value * SHAPE_FACTOR, shape.high)
            limits.append((low - value, high - value))
    return limits


def _shifted(one: EffectValues, move: Mapping[str, float]) -> EffectValues:
    moves = {name: move.get(f"{one.effect.name}.{name}", 0.0) for name in one.values}
    return EffectValues(one.effect, {name: value + moves[name] for name, value in one.values.items()})
