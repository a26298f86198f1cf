"""What no refit can hide: the distance of two predictions after one model's nuisances have done their best.

The nuisances are what every diagnosis leaves open: inertia, viscous friction, bias, the time shift of the current and
the friction law, by its size and length or by all of its weights.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.effects import stage_changes
from stagectl.gap.experiment_design import prediction_distance
from stagectl.gap.experiment_design.prediction_distance import Bench, told
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import friction_family, least_squares
from stagectl.kernels import stage
from stagectl.kernels.stage import Stage

STEPS = 8  # of the refit
FARTHEST = 0.5  # that a nuisance may move in one step, in its own size (most: a log of the ratio)
GROUPS = 8  # of elements of the friction law
SHORT = 0.02  # of a distance: a refit that leaves less may have stopped short
SHORTER = 0.3  # of a step that led nowhere
SETTLED = 0.98  # of the distance: a step that leaves more of it is the last one


class Nuisance(NamedTuple):
    """A parameter that a refit moves."""

    name: str
    moved: Callable[[Stage, float], Stage]
    step: float  # for its sensitivity


class Tangent(NamedTuple):
    """A model's prediction and how it moves with the nuisances."""

    model: Stage
    value: Array  # (m,)
    slopes: Array  # (k, m), the time shift's last
    current: float  # A, largest


def nuisances(p: Stage, weights: bool) -> list[Nuisance]:
    """What may be refitted; with `weights` every element of the friction law of its own."""
    coulomb = stage.sliding(p.friction)
    unit = friction_family.size(p)
    found = [
        _scaled("inertia", "mechanics.inertia"),
        Nuisance("bias", lambda m, a: _added(m, "mechanics.bias", a * unit), 0.02),
    ]
    if p.mechanics.viscous > 0.0:
        found.append(_scaled("viscous", "mechanics.viscous"))
    if coulomb > 0.0:
        found += [
            Nuisance("coulomb", lambda m, a: stage_changes.coulomb(m, {"size": math.expm1(a)}), 0.02),
            Nuisance("length", lambda m, a: stage_changes.stretched(m, {"size": math.expm1(a)}), 0.05),
        ]
    return found + (_weights(p, coulomb) if weights and coulomb > 0.0 else [])


def _scaled(name: str, place: str) -> Nuisance:
    return Nuisance(name, lambda p, a: stage_changes.put(p, place, stage_changes.get(p, place) * math.exp(a)), 0.02)


def _added(p: Stage, place: str, amount: float) -> Stage:
    changed: Stage = stage_changes.put(p, place, stage_changes.get(p, place) + amount)
    return changed


def _weights(p: Stage, coulomb: float) -> list[Nuisance]:
    """Neighbouring elements together, so that there are no more than `GROUPS`."""
    parts = np.array_split(np.arange(len(p.friction.operators.weight)), GROUPS)
    return [Nuisance(f"weights_{k}", _weighted(part, coulomb), 0.02) for k, part in enumerate(parts) if len(part)]


def _weighted(part: NDArray[np.int64], coulomb: float) -> Callable[[Stage, float], Stage]:
    def moved(m: Stage, a: float) -> Stage:
        changed = m.friction.operators.weight.copy()
        changed[part] = np.maximum(changed[part] + a * coulomb / len(part), 0.0)
        return m._replace(friction=m.friction._replace(operators=m.friction.operators._replace(weight=changed)))

    return moved


def spread(p: Stage) -> Stage:
    """The same machine with elements of weight zero in its friction law, for the refit to use."""
    return p._replace(friction=friction_family.spread(p.friction))


def tangent(bench: Bench, model: Stage, free: Sequence[Nuisance]) -> Tangent:
    """The prediction of `model` and its sensitivities to `free`, by differences."""
    at = told(bench, model)
    slopes = [(told(bench, one.moved(model, one.step)).values - at.values) / one.step for one in free]
    return Tangent(model, at.values, np.array([*slopes, prediction_distance.late(bench, at.values)]), at.current)


def linear(p: Tangent, truth: Array) -> float:
    """Distance (sigma) of `truth` from all that `p` predicts, its nuisances taken as linear."""
    lacks = truth - p.value
    return float(np.linalg.norm(lacks - _step(p.slopes, lacks) @ p.slopes))


def refitted(bench: Bench, p: Tangent, free: Sequence[Nuisance], truth: Array) -> float:
    """Distance (sigma) of `truth` from the best refit of `p`: Gauss-Newton, its slopes updated by Broyden's rule.

    Zero where nearly all of it is hidden: around standstill a prediction is no smooth function of its nuisances, and
    a refit stops short of the last per cent.
    """
    place, value, slopes = np.zeros(len(p.slopes)), p.value, p.slopes.copy()
    whole = float(np.linalg.norm(truth - value))
    best, share = whole, 1.0
    for _ in range(STEPS):
        step = share * _step(slopes, truth - value)
        after = told(bench, _moved(p.model, free, place + step), (place + step)[-1] * bench.dt).values
        distance = float(np.linalg.norm(truth - after))
        if math.isfinite(distance):
            slopes += np.outer(step / max(float(step @ step), 1e-300), after - value - step @ slopes)
        if not distance < best:
            share *= SHORTER
            continue
        settled = distance > SETTLED * best
        place, value, best, share = place + step, after, distance, 1.0
        if settled:
            break
    return best if best > SHORT * whole else 0.0


def _step(slopes: Array, lacks: Array) -> Array:
    """Least squares (k,) with no nuisance farther than it may move at once."""
    columns = np.vstack([slopes, lacks])
    farthest = np.full(len(slopes), FARTHEST)
    return least_squares.bounded(columns @ columns.T, range(len(slopes)), -farthest, farthest)


def _moved(p: Stage, free: Sequence[Nuisance], place: Array) -> Stage:
    for one, amount in zip(free, place, strict=False):  # the last one is the time shift, no part of the stage
        p = one.moved(p, float(amount))
    return p
