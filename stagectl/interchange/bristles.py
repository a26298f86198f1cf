"""Stop operators as a sum of bristles: what simulators with LuGre friction, and nothing else, can take.

A relaxed bundle resists a move x with ``F(x) = sum w_j min(x/s_j, 1)``; bristles of limits c_i and slips r_i do with
``sum c_i (1 - exp(-x/r_i))``.  The c_i >= 0 on a ladder of slips are fitted to F, with the same force at speed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stagectl.interchange.constants import CURVE_POINTS, CURVE_REACH, LADDER, LADDER_REACH
from stagectl.kernels.friction import StopOperators, Stribeck
from stagectl.kernels.friction_bristle import Bristle
from stagectl.kernels.plant import Friction

Array = NDArray[np.float64]
GAUSSIAN = 2.0  # the shape of the Stribeck curve that `lugre` has


def bristles(p: Friction) -> list[Bristle]:
    """The friction as bristles, the stiffest first: fitted to the stop operators, and its own bristle as it is."""
    own = [p.bristle] if p.bristle.coulomb > 0.0 else []
    if sum(p.operators.weight) <= 0.0:
        return own
    limits, slips = _fitted(p.operators)
    return [Bristle(c, c / r, stribeck=p.stribeck) for c, r in zip(limits, slips, strict=True) if c > 0.0] + own


def gaussian(p: Stribeck) -> Stribeck:
    """The Stribeck curve of shape 2 that is nearest to `p`, over a few of its speeds."""
    if p.rise == 0.0 or p.shape == GAUSSIAN:
        return p
    speeds = np.linspace(0.0, CURVE_REACH * p.velocity, CURVE_POINTS)
    wanted = np.exp(-((speeds / p.velocity) ** p.shape))
    tried = p.velocity * np.geomspace(1.0 / CURVE_REACH, CURVE_REACH, CURVE_POINTS)
    curves = np.exp(-((speeds / tried[:, None]) ** GAUSSIAN))
    sizes = curves @ wanted / np.sum(curves * curves, axis=1)
    best = int(np.argmin(np.sum((sizes[:, None] * curves - wanted) ** 2, axis=1)))
    return Stribeck(p.rise * float(sizes[best]), float(tried[best]), GAUSSIAN)


def _fitted(p: StopOperators) -> tuple[list[float], list[float]]:
    """Limits (N m | N) and slips (rad | m) of the ladder."""
    from scipy.optimize import nnls

    weight, slip = np.array(p.weight), np.array(p.slip)
    x = np.geomspace(slip.min() / 10.0, slip.max() * 10.0, CURVE_POINTS)
    slips = np.geomspace(slip.min() / LADDER_REACH, slip.max(), LADDER)
    wanted = np.minimum(x[:, None] / slip, 1.0) @ weight
    limits, _ = nnls(1.0 - np.exp(-x[:, None] / slips), wanted)
    limits *= weight.sum() / limits.sum()
    return limits.tolist(), slips.tolist()
