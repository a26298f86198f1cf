"""A family of friction laws wide enough for any machine, which replaces the nominal law in the fits.

Rolling friction is known only by its curve, so its law is a nuisance.  The family is a bundle of stop operators over
three decades of slip, each with a free weight that is not negative, and one bristle (Dahl, LuGre) of some length and
exponent.  Along a measured path each of them is a column.  A law in between is a mixture of these.
"""

import math

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import thresholds
from stagectl.kernels import friction, friction_bristle, stage


def size(p: stage.Stage) -> float:
    """Force (N m | N) that is the unit of friction: the model's own, or that of 10 mA where it has none."""
    return stage.sliding(p.friction) or thresholds.UNLOADED_CURRENT * p.motor.force_constant


def length(p: stage.Friction) -> float:
    """Length of the rolling zone (rad | m): displacement at which 95 % of the friction has reversed."""
    grid = np.geomspace(1e-3, 1e2, 400) * stage.longest_slip(p)
    curve = reversal(p, grid)
    return (
        float(grid[np.searchsorted(curve, thresholds.REVERSED * curve[-1])])
        if curve[-1] > 0.0
        else float(stage.longest_slip(p))
    )


def zone(p: friction_bristle.Bristle) -> float:
    """The same (rad | m) of a bristle alone."""
    left = 2.0 * (1.0 - thresholds.REVERSED)
    return p.coulomb / p.stiffness * friction_bristle.way(2.0, left, p.exponent)


def reversal(p: stage.Friction, displacement: Array) -> Array:
    """Change of the friction (n,) N m | N at `displacement` (n,) after a reversal, without Stribeck's effect."""
    slip, weight = (np.asarray(values, dtype=np.float64) for values in (p.operators.slip, p.operators.weight))
    force: Array = np.minimum(displacement[:, None] / (2.0 * slip), 1.0) @ (2.0 * weight)
    if p.bristle.coulomb > 0.0:
        force = force + _bristle_reversal(p.bristle, displacement)
    return force


def _bristle_reversal(p: friction_bristle.Bristle, displacement: Array) -> Array:
    place = np.concatenate([[0.0], np.sort(displacement)])
    deflection, change = -p.coulomb / p.stiffness, []
    plain = p._replace(stribeck=friction.Stribeck(), damping=0.0)
    for step in np.diff(place):
        deflection = friction_bristle.bent(plain, deflection, 1.0, float(step), 1.0)[1]
        change.append(p.stiffness * deflection + p.coulomb)
    curve: Array = np.interp(displacement, place[1:], np.array(change))
    return curve


def spread(nominal: stage.Friction) -> stage.Friction:
    """The nominal friction, unchanged, with elements of weight zero between and around its own for a fit to use."""
    zone = length(nominal)
    operators = zip(nominal.operators.slip, nominal.operators.weight, strict=True)
    own = [(float(slip), float(weight)) for slip, weight in operators if weight > 0.0]
    slips = [slip for slip, _ in own] or [0.05 * zone, zone]
    grid = np.geomspace(
        thresholds.SHORTEST_SLIP * min(slips), thresholds.LONGEST_SLIP * max(slips), thresholds.ELEMENTS
    )
    added = [
        float(slip) for slip in grid if all(abs(math.log(slip / other)) > thresholds.DISTINCT_SLIPS for other, _ in own)
    ]
    elements = sorted([*own, *((slip, 0.0) for slip in added)])
    bundle = friction.bundle([weight for _, weight in elements], [slip for slip, _ in elements])
    return nominal._replace(operators=bundle)


def bristles(nominal: stage.Stage) -> list[friction_bristle.Bristle]:
    """The bristles of the family, as large as the nominal friction: of Dahl, and damped ones of LuGre."""
    coulomb, zone = size(nominal), length(nominal.friction)
    shapes = [(exponent, 0.0) for exponent in thresholds.BRISTLE_EXPONENTS] + [(1.0, thresholds.BRISTLE_DAMPING)]
    bristles = [
        (friction_bristle.Bristle(coulomb, coulomb / (share * zone), exponent, 0.0, nominal.friction.stribeck), damping)
        for exponent, damping in shapes
        for share in thresholds.BRISTLE_LENGTHS
    ]
    return [p._replace(damping=damping * critical(p, nominal.mechanics.inertia)) for p, damping in bristles]


def critical(p: friction_bristle.Bristle, inertia: float) -> float:
    """Damping (N m s/rad | N s/m) of a bristle at rest with which an `inertia` no longer swings on it."""
    return 2.0 * math.sqrt(p.stiffness * inertia)
