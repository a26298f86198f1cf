"""Gauss-Newton over everything at once: effects with all their parameters, and the base model beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.effect import TimeVariation, Values
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, least_squares, sensitivities
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import Direction, Model
from stagectl.gap.selection import baseline_fit
from stagectl.gap.selection.baseline_fit import Base
from stagectl.gap.selection.candidates import SCALED, STEP, Named, direction, equipped

STEPS = 3
WIDEST = 1.6  # factor by which a shape may change in one step
SETTLED = 1e-3  # of the misfit: a step that gains less is the last one


class Evidence(NamedTuple):
    """The data of a diagnosis as the base refit left them."""

    runs: Sequence[Run]
    base: Base
    deviations: list[list[Array]]  # whitened, of each repeat from the mean path


class Fitted(NamedTuple):
    """A base model with effects, fitted together."""

    model: Model  # base, without the effects
    effects: tuple[Named, ...]
    left: list[list[Array]]  # whitened residual of each run and repeat
    misfit: float

    @property
    def equipped(self) -> Model:
        """The model with its effects in place."""
        return equipped(self.model, self.effects)


def evidence(runs: Sequence[Run], refitted: Base) -> Evidence:
    """Ready for many fits: what single repeats differ by from their mean path does not change any more."""
    means = sensitivities.mean_residuals(refitted.model, runs, refitted.noise)
    deviations = [[one - mean for one in repeats] for repeats, mean in zip(refitted.after, means, strict=True)]
    return Evidence(runs, refitted, deviations)


def repeated(e: Evidence) -> bool:
    """Whether anything was done twice: without that there is no floor."""
    return any(len(one) > 1 for one in e.deviations)


def left(e: Evidence, model: Model, effects: Sequence[Named]) -> list[list[Array]]:
    """Whitened residual of each run and repeat under `model` with `effects`."""
    whole = equipped(model, effects)
    if any(one.effect.time_variation is not None for one in effects):
        return sensitivities.residuals_of(whole, e.runs, e.base.noise)
    means = sensitivities.mean_residuals(whole, e.runs, e.base.noise)
    return [[mean + one for one in repeats] for mean, repeats in zip(means, e.deviations, strict=True)]


def total(e: Evidence, residuals: list[list[Array]]) -> float:
    """Sum of squares over all that counts; not finite where a simulation has diverged."""
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
    repeats = [len(one) for one in e.deviations]
    pairs = zip(e.deviations, e.runs, repeats, strict=True)
    return sum(
        float(np.sum((one * run.weight[:, None]) ** 2)) * count / max(count - 1, 1)
        for each, run, count in pairs
        for one in each
    )


def start(e: Evidence) -> Fitted:
    """The refitted base without any effect."""
    return Fitted(e.base.model, (), e.base.after, total(e, e.base.after))


def refine(e: Evidence, model: Model, effects: Sequence[Named], steps: int = STEPS) -> Fitted:
    """The best values of all parameters of `effects` and of the base beside them, from where they stand."""
    residuals = left(e, model, effects)
    now = Fitted(model, tuple(effects), residuals, total(e, residuals))
    if any(one.effect.nonlinear for one in effects) and np.isfinite(now.misfit):
        e = e._replace(base=e.base._replace(products=_products_beside(e, now)))
    for _ in range(steps if np.isfinite(now.misfit) else 0):  # it diverged: no step can be told
        after = _step(e, now)
        if after.misfit > now.misfit * (1.0 - SETTLED):
            return after if after.misfit < now.misfit else now
        now = after
    return now


def _products_beside(e: Evidence, now: Fitted) -> gram_matrices.Products:
    """The base's columns where the effects are in the model: across a gap, friction is not what it was."""
    moving = [one for one in e.base.directions if not baseline_fit.is_member(one.name)]

    def beside(one: Direction) -> Direction:
        return one._replace(change=lambda _: equipped(one.change(now.model), now.effects))

    found = sensitivities.all_columns(now.equipped, e.runs, [beside(one) for one in moving], e.base.noise)
    return gram_matrices.products(e.runs, found, baseline_fit.START)


def _step(e: Evidence, now: Fitted) -> Fitted:
    own = parameters(now)
    g = gram_matrices.dealt(tangent(e, now, own), now.left)
    nuisance = nuisances(e)
    places = [*g.of(nuisance), *g.of([one.name for one in own])]
    low, high = np.array([(baseline_fit.lowest(now.model, name), np.inf) for name in nuisance] + _limits(now)).T
    amplitude = least_squares.bounded(g.both.sum(axis=0), places, low, high)
    move = dict(zip([*nuisance, *(one.name for one in own)], amplitude.tolist(), strict=True))
    best = now
    for share in (1.0, 0.4, 0.1):
        model, effects = _moved(now, move, share)
        residuals = left(e, model, effects)
        misfit = total(e, residuals)
        if misfit < best.misfit:
            return Fitted(model, effects, residuals, misfit)
    return best


def nuisances(e: Evidence) -> list[str]:
    """Columns of the base that move beside every effect."""
    return [
        one.name for one in e.base.directions if one.name != baseline_fit.START and not baseline_fit.is_member(one.name)
    ]


def tangent(e: Evidence, now: Fitted, own: Sequence[Direction]) -> gram_matrices.Products:
    """The base's columns, and those of the effects' parameters where they stand."""
    return gram_matrices.beside(e.base.products, sensitivities.all_columns(now.equipped, e.runs, own, e.base.noise))


def parameters(now: Fitted) -> list[Direction]:
    """One direction for each parameter that may be refined, named ``effect.parameter``.

    Effects overwrite their fields, so a change is the same effect with another value on top of the whole model.
    """
    found = []
    for k, one in enumerate(now.effects):
        if one.effect.time_variation is not None:
            found += _drifting(one, one.effect.time_variation)
            continue
        for amplitude in one.effect.amplitudes:
            step = 0.1 * max(abs(one.values[amplitude.name]), 0.3 * abs(amplitude.typical[0]))
            found.append(_replaced(now, k, amplitude.name, step))
        for shape in one.effect.shapes:
            if shape.refined:
                found.append(_replaced(now, k, shape.name, 0.05 * one.values[shape.name]))
    return found


def _drifting(one: Named, time_variation: TimeVariation) -> list[Direction]:
    """The same for what runs on the session clock: factors of time on the columns of what it scales."""
    name, values = one.effect.name, dict(one.values)
    found = [
        Direction(
            f"{name}.{x.name}",
            SCALED[time_variation.of[x.name]],
            STEP,
            factor=lambda t: time_variation.factor(values, t),
        )
        for x in one.effect.amplitudes
    ]
    for shape in one.effect.shapes:
        if shape.refined:  # an amplitude times the change of its factor
            first, more = one.effect.amplitudes[0].name, {**values, shape.name: 1.05 * values[shape.name]}
            scale = values[first] / (0.05 * values[shape.name])

            def factor(t: Array, more: Values = more, scale: float = scale) -> Array:
                changed: Array = scale * (time_variation.factor(more, t) - time_variation.factor(values, t))
                return changed

            found.append(Direction(f"{name}.{shape.name}", SCALED[time_variation.of[first]], STEP, factor=factor))
    return found


def _replaced(now: Fitted, k: int, parameter: str, step: float) -> Direction:
    one = now.effects[k]
    changed = Named(one.effect, {**one.values, parameter: one.values[parameter] + step})
    others = [*now.effects[:k], changed, *now.effects[k + 1 :]]
    plain = direction(one, parameter, step, f"{one.effect.name}.{parameter}")
    return plain._replace(change=lambda m: equipped(m._replace(stage=now.model.stage), others))


def _moved(now: Fitted, move: Mapping[str, float], share: float) -> tuple[Model, tuple[Named, ...]]:
    part = {name: share * value for name, value in move.items()}
    model = baseline_fit.moved(now.model, part, None)
    return model, tuple(_shifted(one, part) for one in now.effects)


def _limits(now: Fitted) -> list[tuple[float, float]]:
    """How far each of the effects' parameters may move in one step, in the order of `parameters`."""
    found = []
    for one in now.effects:
        for amplitude in one.effect.amplitudes:
            value = one.values[amplitude.name]
            found.append((amplitude.low - value, amplitude.high - value))
        for shape in one.effect.shapes:
            if shape.refined:
                value = one.values[shape.name]
                low, high = max(value / WIDEST, shape.low), min(value * WIDEST, shape.high)
                found.append((low - value, high - value))
    return found


def _shifted(one: Named, move: Mapping[str, float]) -> Named:
    moves = {name: move.get(f"{one.effect.name}.{name}", 0.0) for name in one.values}
    return Named(one.effect, {name: value + moves[name] for name, value in one.values.items()})
