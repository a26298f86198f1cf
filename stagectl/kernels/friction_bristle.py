"""Bristle friction: Dahl with its exponent, LuGre with its Stribeck curve and micro-damping, one equation for both.

With ``g(v) = T_c stribeck(v)``, the deflection z of the mean bristle and ``w = 1 - sgn(v) sigma_0 z / g(v)``::

    dz/dx = |w|^n sgn(w)            F = sigma_0 z + sigma_1 dz/dt

    Dahl:   stribeck neutral, sigma_1 = 0            LuGre:  n = 1

The viscous part sigma_2 v is the mechanics' own.  A step is exact in z, however stiff: over a move dx with v held,
w obeys ``dw/d|dx| = -(sigma_0 / g) |w|^n sgn(w)``, whose solution is an exponential (n = 1) or a power.

With ``u = sigma_0 |z| / g`` the step takes ``|v| (g u^2 + sigma_1 |v| (1 - u))`` next to what the bristle stores: never
less than nothing while u <= 1, so without a Stribeck rise.  With one u comes to 1 + rise, and fast after slow motion
gives out energy, above a speed of ``T_c u^2 / ((u - 1) sigma_1)``, the least over u up to 1 + rise.

Source: P. R. Dahl, A solid friction model, Aerospace Corporation TOR-158, 1968; C. Canudas de Wit, H. Olsson,
K. J. Åström, P. Lischinsky, A new model for control of systems with friction, IEEE Trans. Automatic Control 40(3),
1995.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from stagectl.kernels import friction
from stagectl.kernels.constants import SERIES_BELOW
from stagectl.kernels.jit import kernel
from stagectl.units import Quantity


class Bristle(NamedTuple):
    """One mean bristle; a `coulomb` of 0 is neutral."""

    coulomb: Annotated[float, Quantity("N m | N", "[0, 1e6]", "friction at speed, T_c; 0 is neutral")] = 0.0
    stiffness: Annotated[float, Quantity("N m/rad | N/m", "(0, 1e15]", "of the bristle at rest, sigma_0")] = 1.0
    exponent: Annotated[float, Quantity("", "[0.2, 4]", "Dahl's exponent n; 1 in LuGre")] = 1.0
    damping: Annotated[float, Quantity("N m s/rad | N s/m", "[0, 1e9]", "of the bristle, sigma_1; 0: Dahl")] = 0.0
    stribeck: friction.Stribeck = friction.Stribeck()


NEUTRAL = Bristle()


def scaled(p: Bristle, size: float, length: float = 1.0) -> Bristle:
    """`p` with its force times `size` and the length of its rolling zone times `length`."""
    stronger = p._replace(coulomb=p.coulomb * size, damping=p.damping * size)
    return stronger._replace(stiffness=p.stiffness * size / length)


@kernel
def bent(p: Bristle, z: float, v: float, dx: float, dt: float) -> tuple[float, float]:
    """Force and deflection after a move of `dx` at velocity `v` during `dt`, from the deflection `z`."""
    if dx == 0.0:
        return p.stiffness * z, z
    return within(p, z, p.coulomb * friction.stribeck(p.stribeck, v), dx, dt)


@kernel
def within(p: Bristle, z: float, limit: float, dx: float, dt: float) -> tuple[float, float]:
    """Force and deflection after a move of `dx`, not 0, where the bristle holds up to `limit` (N m | N)."""
    side = 1.0 if dx > 0.0 else -1.0
    left = 1.0 - side * p.stiffness * z / limit
    deflection = side * (1.0 - left_after(left, p.exponent, p.stiffness * abs(dx) / limit)) * limit / p.stiffness
    return p.stiffness * deflection + p.damping * (deflection - z) / dt, deflection


@kernel
def left_after(w: float, exponent: float, move: float) -> float:
    """Solution of ``dw/ds = -|w|^exponent sgn(w)`` after s = `move`; below an exponent of 1 it ends at zero."""
    if exponent == 1.0:
        return w * math.exp(-move)
    size = abs(w)
    if exponent == 2.0:  # as below, without its two powers
        return w / (1.0 + size * move)
    if size == 0.0:
        return 0.0
    share = move * math.exp((exponent - 1.0) * math.log(size))
    if max(exponent, 1.0) * share < SERIES_BELOW:
        return w * _less(exponent, share)
    grown = (exponent - 1.0) * share
    return w * math.exp(math.log1p(grown) / (1.0 - exponent)) if grown > -1.0 else 0.0


@kernel
def _less(n: float, y: float) -> float:
    """``(1 - (1 - n) y)^(1/(1 - n))`` as a series in a small share y of what is left: as exact, without two powers."""
    third = n * (2.0 * n - 1.0) / 6.0
    fourth = third * (3.0 * n - 2.0) * 0.25
    fifth = fourth * (4.0 * n - 3.0) * 0.2
    sixth = fifth * (5.0 * n - 4.0) / 6.0
    square = y * y
    return 1.0 - y + square * (0.5 * n - third * y + square * (fourth - fifth * y + square * sixth))


def way(w: float, left: float, exponent: float) -> float:
    """Move s after which ``dw/ds = -w^exponent`` has come from `w` to `left`, both above 0."""
    if exponent == 1.0:
        return math.log(w / left)
    less = 1.0 - exponent
    return math.pow(left, less) * math.expm1(less * math.log(w / left)) / less


@kernel
def settled(p: Bristle, load: float, share: float = 1.0) -> float:
    """Deflection (rad | m) with which the bristle carries `load` (N m | N) at rest, up to `share` of what holds it."""
    holds = holding(p, share)
    return min(max(load, -holds), holds) / p.stiffness


@kernel
def holding(p: Bristle, share: float = 1.0) -> float:
    """What it carries at rest (N m | N), at most."""
    return share * p.coulomb * friction.stribeck(p.stribeck, 0.0)


def slipping(p: Bristle, velocity: float) -> float:
    """Deflection (rad | m), without its sign, of the bristle that slips at `velocity` (rad/s | m/s)."""
    return p.coulomb * friction.stribeck(p.stribeck, velocity) / p.stiffness
