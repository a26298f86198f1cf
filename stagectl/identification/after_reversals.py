"""Whether what a model with sgn(v) leaves is concentrated after reversals, where friction builds up over a distance.

Source: Simultaneous Identification of Linear Parameters and Nonlinear Rolling Friction for Ball Screw Driven Stage,
section II: the friction of a rolling element follows the displacement since the reversal, not the sign of the velocity.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from stagectl.identification.capture import Array

FIRST = 0.1  # of the way from one reversal to the next
LONG = 0.1  # of the longest way: shorter ones are noise around standstill
CONCENTRATED = 1.5  # rms there over rms elsewhere; 1.0 where sgn(v) is the friction, up to 1.3 with a soft transition
VISIBLE = 0.005  # of the Coulomb friction: a smaller residual is of no account
LEAST_ROWS = 20  # there and elsewhere


def travelled(position: Array, velocity: Array) -> Array:
    """Share (n,) of the way to the next reversal that is behind each row; NaN before the first and after the last."""
    edges = np.flatnonzero(np.diff(np.sign(velocity))) + 1
    share = np.full(len(position), math.nan)
    ways = [(first, last, float(abs(position[last] - position[first]))) for first, last in itertools.pairwise(edges)]
    longest = max((way for *_, way in ways), default=0.0)
    for first, last, way in ways:
        if way > LONG * longest:
            share[first:last] = np.abs(position[first:last] - position[first]) / way
    return share


def doubt(residual: Array, share: Array, coulomb: float) -> str:
    """What to say of a force `residual` (m,) N | N m at rows (m,) of this `share` of the way; empty if nothing."""
    early, late = residual[share < FIRST], residual[share >= FIRST]
    if min(len(early), len(late)) < LEAST_ROWS:
        return ""
    there, elsewhere = math.sqrt(float(np.mean(early * early))), math.sqrt(float(np.mean(late * late)))
    if there <= max(CONCENTRATED * elsewhere, VISIBLE * abs(coulomb)):
        return ""
    times = f"{there / max(elsewhere, 1e-12 * there):.2g} times"
    return (
        f"in the first tenth of the way after each reversal the residual's rms is {times} that of the rest: friction "
        "builds up over a distance there, which sgn(v) cannot describe; inertia, viscous and Coulomb friction are "
        "biased by it by more than the intervals say, which do not cover it: identify with `simultaneous` instead"
    )
