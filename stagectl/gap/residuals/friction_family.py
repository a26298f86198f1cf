"""The friction that a base model may have: the nominal law replaced by a family wide enough for any of them.

Rolling friction is known by its curve only, so its law is a nuisance: a bundle of stop operators over three decades
of slip, each weight free and not negative, and beside it one bristle (Dahl, LuGre) of some length and exponent.
Along a measured path each of them is a column.  A law that lies in between is a mixture of these.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import nnls

from stagectl.gap.logs.session import Array
from stagectl.kernels import friction, friction_bristle, stage

ELEMENTS = 9
BELOW, ABOVE = 0.4, 3.0  # of the nominal law's shortest and longest slip: how far the family reaches
CLOSE = 0.4  # log of the ratio below which two slips are one
EXPONENTS = (0.5, 1.0, 2.0)
_UNLOADED = 0.01  # A
LENGTHS = (0.04, 0.12, 0.35)  # of the rolling zone: range of a bristle, T_c over its stiffness


def size(p: stage.Stage) -> float:
    """Force (N m | N) that friction is measured by: the model's own, or that of 10 mA where it has none."""
    return stage.sliding(p.friction) or _UNLOADED * p.motor.force_constant


def length(p: stage.Friction) -> float:
    """Displacement after a reversal at which 95 % of the nominal friction has turned round (rad | m)."""
    grid = np.geomspace(1e-3, 1e2, 400) * _longest(p)
    curve = reversal(p, grid)
    return float(grid[np.searchsorted(curve, 0.95 * curve[-1])]) if curve[-1] > 0.0 else float(_longest(p))


def _longest(p: stage.Friction) -> float:
    bristle = p.bristle.coulomb / p.bristle.stiffness if p.bristle.coulomb else 0.0
    pairs = [(float(slip), weight > 0.0) for slip, weight in zip(p.operators.slip, p.operators.weight, strict=True)]
    slips = [slip for slip, carries in pairs if carries]
    return max([*slips, bristle]) or max((slip for slip, _ in pairs), default=1.0)  # without friction: as it would be


def reversal(p: stage.Friction, displacement: Array) -> Array:
    """Change of the friction (n,) N m | N `displacement` (n,) after a reversal, Stribeck left out."""
    slip, weight = (np.asarray(values, dtype=np.float64) for values in (p.operators.slip, p.operators.weight))
    force: Array = np.minimum(displacement[:, None] / (2.0 * slip), 1.0) @ (2.0 * weight)
    if p.bristle.coulomb > 0.0:
        force = force + _bristle(p.bristle, displacement)
    return force


def _bristle(p: friction_bristle.Bristle, displacement: Array) -> Array:
    place = np.concatenate([[0.0], np.sort(displacement)])
    z, found = -p.coulomb / p.stiffness, []
    for step in np.diff(place):
        z = friction_bristle.bent(p._replace(stribeck=friction.Stribeck(), damping=0.0), z, 1.0, float(step), 1.0)[1]
        found.append(p.stiffness * z + p.coulomb)
    curve: Array = np.interp(displacement, place[1:], np.array(found))
    return curve


def spread(nominal: stage.Friction) -> stage.Friction:
    """The nominal friction, exactly, with elements of weight zero between and around its own: directions to move in."""
    zone = length(nominal)
    own = [
        (float(d), float(w)) for d, w in zip(nominal.operators.slip, nominal.operators.weight, strict=True) if w > 0.0
    ]
    slips = [slip for slip, _ in own] or [0.05 * zone, zone]
    grid = np.geomspace(BELOW * min(slips), ABOVE * max(slips), ELEMENTS)
    apart = [float(slip) for slip in grid if all(abs(math.log(slip / other)) > CLOSE for other, _ in own)]
    elements = sorted([*own, *((slip, 0.0) for slip in apart)])
    operators = friction.bundle([weight for _, weight in elements], [slip for slip, _ in elements])
    return nominal._replace(operators=operators)


def as_operators(p: stage.Friction) -> stage.Friction:
    """`p` as stop operators alone, by their reversal curve: what a stage file can hold."""
    zone = length(p)
    slips = np.geomspace(0.01 * zone, 2.0 * zone, 2 * ELEMENTS)
    place = np.geomspace(1e-3 * zone, 4.0 * zone, 300)
    weights = nnls(2.0 * np.minimum(place[:, None] / (2.0 * slips), 1.0), reversal(p, place))[0]
    kept = weights > 0.0
    return p._replace(operators=friction.bundle(weights[kept], slips[kept]), bristle=friction_bristle.NEUTRAL)


def bristles(nominal: stage.Stage) -> list[friction_bristle.Bristle]:
    """Members of the family beside the stop operators, as large as the nominal friction."""
    coulomb, zone = size(nominal), length(nominal.friction)
    return [
        friction_bristle.Bristle(coulomb, coulomb / (share * zone), exponent, 0.0, nominal.friction.stribeck)
        for exponent in EXPONENTS
        for share in LENGTHS
    ]
