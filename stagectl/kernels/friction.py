"""Friction laws; every law opposes the motion: a positive force acts against positive velocity.

Rolling friction is a bundle of stop operators in parallel (the generalised Maxwell-slip model)::

        F                       one element          alpha |        ______ slips
        ^    ___----            s in [-1, 1]               |   ____/
        | _--                   F = alpha s                |  /  slope alpha / delta
        |/  bends as the elements      -------------------+--/------------> x
        +--------> x               start to slip           | /

Source: Z. Jamaludin, H. Van Brussel, J. Swevers, AMC 2008; T. Takemura, H. Fujimoto, IECON 2010 (the same
characteristic as a table of displacement since reversal).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, NamedTuple

from stagectl.kernels.jit import kernel, states, table
from stagectl.units import Quantity


class StopOperators(NamedTuple):
    """Elements in parallel: ``F = sum alpha_j s_j``, each ``s_j`` follows ``x / delta_j`` within [-1, 1]."""

    weight: Annotated[Any, Quantity("N m | N", "[0, 1e6]", "force at which each element slips, alpha_j")]
    slip: Annotated[Any, Quantity("rad | m", "(0, 1e3]", "displacement at which each element slips, delta_j")]
    rate: Any  # 1/delta_j: a multiplication is cheaper than a division, twelve times a step


class Stribeck(NamedTuple):
    """Rise of the friction towards zero speed: a factor ``1 + rise exp(-(|v| / velocity)^shape)``."""

    rise: Annotated[float, Quantity("", "[0, 10]", "(T_s - T_c) / T_c; 0 is neutral")] = 0.0
    velocity: Annotated[float, Quantity("rad/s | m/s", "(0, 1e4]", "speed at which the rise has decayed")] = 1.0
    shape: Annotated[float, Quantity("", "[0.1, 4]", "exponent of the decay; 1 in the paper, 2 Gaussian")] = 1.0


class Gms(NamedTuple):
    """The generalised Maxwell-slip law: stop operators that slip at a force on Stribeck's curve."""

    operators: StopOperators
    stribeck: Stribeck = Stribeck()


def bundle(weight: Iterable[float], slip: Iterable[float]) -> StopOperators:
    """Elements of these weights (N m | N) and slips (rad | m), ready to run."""
    slips = [float(x) for x in slip]
    return StopOperators(table(weight), table(slips), table(1.0 / x for x in slips))


def relaxed(p: StopOperators) -> Any:
    """State of `p` without load, as after assembly: all zero."""
    return states(len(p.weight))


@kernel
def relax(s: Any) -> None:
    """Take the load off operators `s` (n,), in place."""
    for j in range(len(s)):
        s[j] = 0.0


@kernel
def settled(p: StopOperators, s: Any, load: float, limit: float = 1.0) -> float:
    """Let relaxed operators `s` give way until they carry `load` (N m | N); the force they then give.

    A load beyond their sum lets all of them slip: the axis does not stay at rest.
    """
    return stops(p, s, math.copysign(_given_way(p, abs(load), float(limit)), load), limit) if load != 0.0 else 0.0


@kernel
def _given_way(p: StopOperators, load: float, limit: float) -> float:
    """Displacement (rad | m) after which relaxed operators carry `load` (N m | N), by bisection."""
    longest = 0.0
    for j in range(len(p.slip)):
        longest = max(longest, p.slip[j])
    low, high = 0.0, 2.0 * limit * longest
    for _ in range(100):
        middle = 0.5 * (low + high)
        carried = 0.0
        for j in range(len(p.weight)):
            carried += p.weight[j] * min(limit, middle * p.rate[j])
        if carried < load:
            low = middle
        else:
            high = middle
    return high


@kernel
def stops(p: StopOperators, s: Any, dx: float, limit: float = 1.0) -> float:
    """Force of the operators after a move of `dx`; the states `s` (n,) change **in place**, within +-`limit`.

    The limit holds what slips, not what sticks: a stuck element is a spring, at whatever speed it is stretched.
    """
    return stops_between(p, s, dx, -limit, limit)


@kernel
def stops_between(p: StopOperators, s: Any, dx: float, low: float, high: float) -> float:
    """Force of the operators after a move of `dx`; the states `s` (n,) change **in place**, within `low` and `high`.

    The one exception to purity in the kernels: an array costs a third of a tuple here, with the same bits.
    """
    force = 0.0
    for j in range(len(p.weight)):
        stretched = s[j] + dx * p.rate[j]
        # Two selections and no branch: compiled a third faster than with `elif`, interpreted as fast.
        stretched = high if stretched > high else stretched
        stretched = low if stretched < low else stretched
        s[j] = stretched
        force += p.weight[j] * stretched
    return force


@kernel
def stribeck(p: Stribeck, v: float) -> float:
    """Factor on the friction at velocity `v`; exactly 1 when neutral."""
    if p.rise == 0.0:
        return 1.0
    return 1.0 + p.rise * math.exp(-((abs(v) / p.velocity) ** p.shape))
