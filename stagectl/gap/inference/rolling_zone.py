"""How long the rolling zone is, next to another law of friction.

Laws differ in form, and any fit bends the form.  A zone that is twice as long turns each tenth of the friction round
after twice the displacement: by how much these ratios differ is the length's error.  And a length explains what no law
explains that is as long as before.
"""

from __future__ import annotations

import math

import numpy as np

from stagectl.gap.inference.estimates import Estimate
from stagectl.gap.inference.value_errors import Errors
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import friction_family, gram_matrices, least_squares
from stagectl.gap.residuals.thresholds import BRISTLE_EXPONENTS
from stagectl.gap.selection import baseline_fit, constants, refine
from stagectl.gap.selection.priors import WEIGHT
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels import friction, stage
from stagectl.kernels.friction_bristle import Bristle

SIZE, LENGTH = "bristle_size", "bristle_length"  # columns of a nominal bristle


def length(nominal: stage.Friction, now: Fitted, known: Errors) -> Estimate:
    """Length (rad | m) of the fitted friction's rolling zone, against that of the `nominal` one."""
    ratio = np.log(turning_points(now.model.stage.friction) / turning_points(nominal))
    before = _mean(nominal)
    after = before * float(np.exp(ratio.mean()))
    error = math.hypot(_of_elements(now, known), after * float(ratio.std()))
    return Estimate(after, before, error, before, constants.LENGTH * before)


def turning_points(p: stage.Friction) -> Array:
    """(9,) rad | m, displacements after a reversal at which each tenth of the friction has turned round."""
    grid = np.geomspace(1e-4, 3.0, 400) * friction_family.length(p)
    curve: Array = friction_family.reversal(p, grid)
    points: Array = np.interp(np.linspace(0.1, 0.9, 9) * curve[-1], curve, grid)
    return points


def _mean(p: stage.Friction) -> float:
    """Geometric mean of the turning points (rad | m)."""
    return float(np.exp(np.log(turning_points(p)).mean()))


def _of_elements(now: Fitted, known: Errors) -> float:
    """Standard error of the length (rad | m): what it moves by where each element moves by its own error."""
    places = [k for k, name in enumerate(known.names) if name.startswith(WEIGHT) or name == LENGTH]
    matrix = known.matrix[np.ix_(places, places)]
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    still = {baseline_fit.weight_name(k): 0.0 for k in range(len(now.model.stage.friction.operators.weight))}
    moves = [{**still, known.names[place]: float(by)} for place, by in zip(places, size, strict=True)]
    moved = [_mean(baseline_fit.moved(now.model, move, None, 1.0).stage.friction) for move in moves]
    step = (np.array(moved) - _mean(now.model.stage.friction)) / size
    return math.sqrt(max(float(step @ matrix @ step), 0.0))


def misfit(nominal: stage.Friction, e: Evidence, now: Fitted, ratio: float) -> float:
    """Sum of squares that comes back where the best law, stretched by `ratio`, gives way to the best that is not."""
    factor = stage.sliding(now.model.stage.friction) / stage.sliding(nominal)
    known = [stage.scaled_friction(law, factor) for law in laws(nominal)]
    products = refine.tangent(e, now, refine.parameters(now))
    stretched = [stage.stretched_friction(law, ratio) for law in known]
    before, after = (min(_left(e, now, products, law) for law in group) for group in (known, stretched))
    return max(before - after, 0.0) if math.isfinite(after) else 0.0


def laws(nominal: stage.Friction) -> list[stage.Friction]:
    """The `nominal` law, and Dahl's with its size and length: as far apart as laws of friction are."""
    size, length = stage.sliding(nominal), _mean(nominal)
    bristles = (Bristle(size, size / length, n, 0.0, nominal.stribeck) for n in BRISTLE_EXPONENTS)
    others = [nominal._replace(operators=friction.bundle([0.0], [1.0]), bristle=bristle) for bristle in bristles]
    return [nominal, *(stage.stretched_friction(law, length / _mean(law)) for law in others)]


def _left(e: Evidence, now: Fitted, products: gram_matrices.Products, law: stage.Friction) -> float:
    """What `now` leaves with another `law`, its size and all parameters but the law's form fitted again."""
    model = now.model._replace(stage=now.model.stage._replace(friction=law))
    g = gram_matrices.fold_sums(products, refine.residuals(e, model, now.effects))
    elements = [name for name in g.names if name.startswith(WEIGHT)]
    size = np.zeros(len(g.names) + 1)
    size[g.places(elements)] = now.model.stage.friction.operators.weight
    form = {LENGTH, SIZE, *elements, *(name for name in g.names if baseline_fit.is_member(name))}
    size[g.places([name for name in g.names if name == SIZE])] = 1.0
    others = np.eye(len(g.names) + 1)[:, [k for k, name in enumerate((*g.names, "")) if name not in form]]
    columns = np.column_stack([size, others])
    summed = columns.T @ g.both.sum(axis=0) @ columns
    if not np.isfinite(summed).all():  # its simulation has diverged
        return math.inf
    return least_squares.fit(summed, range(len(summed) - 1)).residual_sum_of_squares
