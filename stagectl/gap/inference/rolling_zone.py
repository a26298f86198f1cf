"""How long the rolling zone is, next to another law of friction.

A zone that is twice as long turns each tenth of the friction round after twice the displacement.  Another law moves
each tenth by another ratio: by how much these differ is the length's error.
"""

import math

import numpy as np

from stagectl.gap.inference.estimates import Estimate
from stagectl.gap.inference.value_errors import Errors
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.sensitivities import Direction
from stagectl.gap.selection import baseline_fit, constants
from stagectl.gap.selection.priors import WEIGHT
from stagectl.gap.selection.refine import Fitted
from stagectl.kernels import friction, stage


def lengths(
    nominal: stage.Friction, now: Fitted, known: Errors, bristle: Direction | None
) -> tuple[Estimate, Estimate]:
    """Length (rad | m) of the fitted friction's rolling zone against the `nominal` one, without a rise and with it.

    Friction that rises towards rest holds over a longer way where its springs stay as they are, as in the stage model,
    and over the same way where they stiffen with it.  No log tells which of the two a law does.  `bristle` is that of
    the baseline fit.
    """
    ratio = np.log(turning_points(now.model.stage.friction) / turning_points(nominal))
    before = _mean(nominal)
    after = before * float(np.exp(ratio.mean()))
    error = math.hypot(_of_elements(now, known, bristle), after * float(ratio.std()))
    plain = Estimate(after, before, error, before, constants.LENGTH * before)
    rise = _at_rest(now.equipped.stage.friction) / _at_rest(nominal)
    return plain, plain._replace(value=rise * after, deviation=rise * error)


def _at_rest(p: stage.Friction) -> float:
    """Factor on the friction at rest."""
    curve = p.bristle.stribeck if p.bristle.coulomb > 0.0 else p.stribeck
    return float(friction.stribeck(curve, 0.0))


def turning_points(p: stage.Friction) -> Array:
    """(9,) rad | m, displacements after a reversal at which each tenth of the friction has turned round."""
    grid = np.geomspace(1e-4, 3.0, 400) * friction_family.length(p)
    curve: Array = friction_family.reversal(p, grid)
    points: Array = np.interp(np.linspace(0.1, 0.9, 9) * curve[-1], curve, grid)
    return points


def _mean(p: stage.Friction) -> float:
    """Geometric mean of the turning points (rad | m)."""
    return float(np.exp(np.log(turning_points(p)).mean()))


def _of_elements(now: Fitted, known: Errors, bristle: Direction | None) -> float:
    """Standard error of the length (rad | m): what it moves by where each element moves by its own error."""
    own = "bristle_length" if bristle is None else bristle.name
    places = [k for k, name in enumerate(known.names) if name.startswith(WEIGHT) or name == own]
    matrix = known.matrix[np.ix_(places, places)]
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    moves = [{known.names[place]: float(by)} for place, by in zip(places, size, strict=True)]
    moved = [_mean(baseline_fit.moved(now.model, move, bristle, 1.0).stage.friction) for move in moves]
    step = (np.array(moved) - _mean(now.model.stage.friction)) / size
    return math.sqrt(max(float(step @ matrix @ step), 0.0))
