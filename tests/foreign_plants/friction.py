"""Six laws of friction, each from its paper, advanced through a displacement at constant velocity.

Friction opposes the motion: it is positive at positive velocity.  A law has a state `z`, whose meaning is the law's
own, and two functions: `advance` changes the state in place while the axis moves `v * h`, `torque` reads it.

================  ======================================================================================
maxwell           Iwan 1966: elements in parallel, each a spring that slips at its own displacement
dahl              Dahl 1968: dF/dx = s0 (1 - F sgn(v)/Tc)^n
lugre             Canudas de Wit et al. 1995: dz/dt = v - s0 |v|/g(v) z, F = s0 z + s1(v) dz/dt
elastoplastic     Dupont et al. 2002: as lugre, purely elastic below the breakaway displacement
gms               Lampaert, Al-Bender and Swevers 2003: elements that stick, or slip towards their share of g(v)
stribeck          static: g(v) tanh(v/v0), Coulomb and Stribeck friction made continuous
================  ======================================================================================

g(v) = Tc + (Ts - Tc) exp(-(v/vs)^2) is the steady curve of the last four.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.foreign_plants.compiled import compiled

Array = NDArray[np.float64]

LAWS = ("maxwell", "dahl", "lugre", "elastoplastic", "gms", "stribeck")
MAXWELL, DAHL, LUGRE, ELASTOPLASTIC, GMS, STRIBECK = range(6)


class Friction(NamedTuple):
    """A law and its parameters; those that it does not have are ignored."""

    law: int
    coulomb: float  # N m, Tc
    static: float  # N m, Ts >= Tc
    stribeck_speed: float  # rad/s, vs
    stiffness: float  # N m/rad, s0 of dahl, lugre and elastoplastic
    damping: float  # N m s/rad, s1 at rest of lugre and elastoplastic
    damping_speed: float  # rad/s; s1 falls with exp(-(v/damping_speed)^2), so that the law stays passive (Olsson 1996)
    exponent: float  # n of dahl
    elastic_share: float  # breakaway displacement of elastoplastic over that of steady sliding
    attraction: float  # N m/s, C of gms
    smoothing: float  # rad/s, v0 of stribeck
    asymmetry: float  # friction is 1 + asymmetry times as large in the positive direction, 1 - asymmetry in the other
    slips: Array  # (n,) rad, displacement at which each element of maxwell and gms slips at Tc
    shares: Array  # (n,) of the friction, sum 1


def states(f: Friction) -> Array:
    """The relaxed state, (2, n): element forces or bristle deflection, and whether an element of gms slips."""
    return np.zeros((2, len(f.slips) if f.law in (MAXWELL, GMS) else 1))


@compiled
def steady(f: Any, v: float) -> float:
    """Torque g of steady sliding at speed v (N m), unsigned."""
    return float(f.coulomb + (f.static - f.coulomb) * math.exp(-((v / f.stribeck_speed) ** 2)))


@compiled
def _maxwell(f: Any, z: Any, v: float, h: float) -> None:
    for j in range(len(f.slips)):
        limit = f.coulomb * f.shares[j]
        z[0, j] = min(max(z[0, j] + limit / f.slips[j] * v * h, -limit), limit)


@compiled
def _dahl(f: Any, z: Any, v: float, h: float) -> None:
    """Exact for any exponent: u = 1 - F sgn(v)/Tc follows du/dx = -s0/Tc u^n."""
    sign = 1.0 if v >= 0.0 else -1.0
    way = f.stiffness / f.coulomb * abs(v) * h
    u = max(1.0 - sign * z[0, 0] / f.coulomb, 0.0)
    if abs(f.exponent - 1.0) < 1e-9:
        u *= math.exp(-way)
    elif u > 0.0:
        power = u ** (1.0 - f.exponent) - (1.0 - f.exponent) * way
        u = power ** (1.0 / (1.0 - f.exponent)) if power > 0.0 else 0.0
    z[0, 0] = sign * f.coulomb * (1.0 - u)


@compiled
def _plastic_share(f: Any, z: float, v: float) -> float:
    """Which share of the motion is slip: 1 for lugre; alpha(z, v) of Dupont for elastoplastic."""
    if f.law == LUGRE:
        return 1.0
    top = steady(f, v) / f.stiffness
    elastic = f.elastic_share * f.coulomb / f.stiffness
    if z * v <= 0.0 or abs(z) <= elastic:
        return 0.0
    if abs(z) >= top:
        return 1.0
    return float(0.5 + 0.5 * math.sin(math.pi * (abs(z) - 0.5 * (top + elastic)) / (top - elastic)))


@compiled
def _bristle_over(f: Any, z: float, v: float, way: float, share: float) -> float:
    """Deflection after the displacement `way` with the share of slip held: exact."""
    if share == 0.0:
        return z + way
    end = steady(f, v) / f.stiffness / share * (1.0 if way >= 0.0 else -1.0)
    return float(end + (z - end) * math.exp(-abs(way / end)))


@compiled
def _bristle(f: Any, z: Any, v: float, h: float) -> None:
    """Exact for lugre; the exponential midpoint rule for elastoplastic, whose share of slip changes on the way."""
    share = _plastic_share(f, z[0, 0], v)
    if f.law == ELASTOPLASTIC:
        share = _plastic_share(f, _bristle_over(f, z[0, 0], v, 0.5 * v * h, share), v)
    z[0, 0] = _bristle_over(f, z[0, 0], v, v * h, share)


@compiled
def _gms(f: Any, z: Any, v: float, h: float) -> None:
    """`z[1]` is the direction in which an element slips, 0 where it sticks.  A reversal makes it stick.

    An element that reaches its limit within the step sticks until then and slips for the rest.
    """
    sign, level = (1.0 if v >= 0.0 else -1.0), steady(f, v)
    for j in range(len(f.slips)):
        limit, left = f.shares[j] * level, h
        if z[1, j] != sign:
            rise = f.coulomb * f.shares[j] / f.slips[j] * abs(v)
            until = max((limit - sign * z[0, j]) / rise, 0.0) if rise > 0.0 else h
            z[0, j] += sign * rise * min(until, h)
            z[1, j], left = (sign, h - until) if until < h else (0.0, 0.0)
        aim = sign * limit
        z[0, j] = aim + (z[0, j] - aim) * math.exp(-f.attraction / level * left) if left > 0.0 else z[0, j]


@compiled
def advance(f: Any, z: Any, v: float, h: float) -> None:
    """The state after h seconds at velocity v (rad/s)."""
    if f.law == MAXWELL:
        _maxwell(f, z, v, h)
    elif f.law == DAHL:
        _dahl(f, z, v, h)
    elif f.law == GMS:
        _gms(f, z, v, h)
    elif f.law != STRIBECK:
        _bristle(f, z, v, h)


@compiled
def _symmetric(f: Any, z: Any, v: float) -> float:
    if f.law == STRIBECK:
        return float(steady(f, v) * math.tanh(v / f.smoothing))
    if f.law == LUGRE or f.law == ELASTOPLASTIC:
        share = _plastic_share(f, z[0, 0], v)
        rate = v - share * abs(v) * f.stiffness / steady(f, v) * z[0, 0]
        return float(f.stiffness * z[0, 0] + f.damping * math.exp(-((v / f.damping_speed) ** 2)) * rate)
    return float(np.sum(z[0]))


@compiled
def torque(f: Any, z: Any, v: float) -> float:
    """Friction (N m) in state z at velocity v, positive where it acts against a positive velocity."""
    friction = _symmetric(f, z, v)
    return float(friction * (1.0 + f.asymmetry if friction > 0.0 else 1.0 - f.asymmetry))


@compiled
def along(f: Any, z: Any, velocities: Any, h: float) -> Any:
    """Friction (n,) N m after each step of a path, which is moved at `velocities` (n,) rad/s; changes z."""
    torques = np.empty(len(velocities))
    for n in range(len(velocities)):
        advance(f, z, velocities[n], h)
        torques[n] = torque(f, z, velocities[n])
    return torques
