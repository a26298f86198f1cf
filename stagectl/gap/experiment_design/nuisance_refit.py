"""What no refit can hide: the distance of two predictions after one model's nuisances have been refitted.

The nuisances are what every diagnosis leaves open: inertia, viscous friction, bias, the time shift of the current and
the friction law, by its size and length or by all of its weights.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.effects import stage_changes
from stagectl.gap.experiment_design import thresholds
from stagectl.gap.experiment_design.prediction_distance import PlannedRun, predict, shift_slope
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import friction_family, least_squares
from stagectl.kernels import stage
from stagectl.kernels.stage import Stage


class Nuisance(NamedTuple):
    """A parameter that a refit moves."""

    name: str
    moved: Callable[[Stage, float], Stage]
    step: float = thresholds.DIFFERENCE_STEP  # for its sensitivity


class Linearised(NamedTuple):
    """A model's prediction, and how it moves with the nuisances."""

    model: Stage
    value: Array  # (m,)
    slopes: Array  # (k, m), the time shift's last
    current: float  # A, largest


def nuisances(p: Stage, weights: bool) -> list[Nuisance]:
    """What may be refitted; with `weights` also the elements of the friction law."""
    coulomb = stage.sliding(p.friction)
    unit = friction_family.size(p)
    free = [
        _scaled("inertia", "mechanics.inertia"),
        Nuisance("bias", lambda m, a: stage_changes.added(bias="mechanics.bias")(m, {"bias": a * unit})),
    ]
    if p.mechanics.viscous > 0.0:
        free.append(_scaled("viscous", "mechanics.viscous"))
    if coulomb > 0.0:
        free += [
            Nuisance("coulomb", lambda m, a: stage_changes.coulomb(m, {"size": math.expm1(a)})),
            Nuisance(
                "length", lambda m, a: stage_changes.stretched(m, {"size": math.expm1(a)}), thresholds.LENGTH_STEP
            ),
        ]
    return free + (_weights(p, coulomb) if weights and coulomb > 0.0 else [])


def _scaled(name: str, place: str) -> Nuisance:
    return Nuisance(name, lambda p, a: stage_changes.put(p, place, stage_changes.get(p, place) * math.exp(a)))


def _weights(p: Stage, coulomb: float) -> list[Nuisance]:
    """Neighbouring elements together, so that there are no more than `thresholds.WEIGHT_GROUPS`."""
    groups = np.array_split(np.arange(len(p.friction.operators.weight)), thresholds.WEIGHT_GROUPS)
    return [Nuisance(f"weights_{k}", _weighted(group, coulomb)) for k, group in enumerate(groups) if len(group)]


def _weighted(group: NDArray[np.int64], coulomb: float) -> Callable[[Stage, float], Stage]:
    def moved(m: Stage, a: float) -> Stage:
        changed = m.friction.operators.weight.copy()
        changed[group] = np.maximum(changed[group] + a * coulomb / len(group), 0.0)
        return stage_changes.put(m, "friction.operators.weight", changed)

    return moved


def spread(p: Stage) -> Stage:
    """The same machine with elements of weight zero in its friction law, for the refit to use."""
    return p._replace(friction=friction_family.spread(p.friction))


def linearised(run: PlannedRun, model: Stage, free: Sequence[Nuisance]) -> Linearised:
    """The prediction of `model` and its sensitivities to `free`, by differences, and to the time shift."""
    at = predict(run, model)
    moved = [predict(run, nuisance.moved(model, nuisance.step)).values for nuisance in free]
    slopes = [(values - at.values) / nuisance.step for nuisance, values in zip(free, moved, strict=True)]
    return Linearised(model, at.values, np.array([*slopes, shift_slope(run, at.values)]), at.current)


def linear_distance(value: Array, slopes: Array, truth: Array) -> float:
    """Distance (sigma) of `truth` (m,) from ``value + a slopes``, for the best bounded `a`."""
    missing = truth - value
    return float(np.linalg.norm(missing - _step(slopes, missing) @ slopes))


def refitted_distance(run: PlannedRun, p: Linearised, free: Sequence[Nuisance], truth: Array) -> float:
    """Distance (sigma) of `truth` from the best refit of `p`: Gauss-Newton, its slopes updated by Broyden's rule.

    Zero where nearly all of it is hidden: around standstill a prediction is no smooth function of its nuisances, and
    a refit stops short of the last per cent.  A step that takes the axis from its loop tells nothing, and is shortened.
    """
    place, value, slopes = np.zeros(len(p.slopes)), p.value, p.slopes.copy()
    whole = float(np.linalg.norm(truth - value))
    best, share = whole, 1.0
    for _ in range(thresholds.REFIT_STEPS):
        step = share * _step(slopes, truth - value)
        if not np.isfinite(step).all():
            break
        after = predict(run, _moved(p.model, free, place + step), (place + step)[-1] * run.rollout.dt).values
        with np.errstate(over="ignore"):  # an axis that has left its loop
            distance = float(np.linalg.norm(truth - after))
        if distance < thresholds.OUT_OF_LOOP * whole:
            slopes += np.outer(step / max(float(step @ step), 1e-300), after - value - step @ slopes)
        if not distance < best:
            share *= thresholds.SHORTENED
            continue
        settled = distance > thresholds.SETTLED * best
        place, value, best, share = place + step, after, distance, 1.0
        if settled:
            break
    return best if best > thresholds.HIDDEN_SHARE * whole else 0.0


def _step(slopes: Array, missing: Array) -> Array:
    """Least squares (k,) with no nuisance farther than it may move at once."""
    columns = np.vstack([slopes, missing])
    farthest = np.full(len(slopes), thresholds.FARTHEST_STEP)
    return least_squares.bounded(columns @ columns.T, range(len(slopes)), -farthest, farthest)


def _moved(p: Stage, free: Sequence[Nuisance], place: Array) -> Stage:
    for nuisance, amount in zip(free, place, strict=False):  # the last amount is the time shift, no part of the stage
        p = nuisance.moved(p, float(amount))
    return p
