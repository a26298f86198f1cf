"""Friction laws along a whole path: the loops that fits and compensation run, one a law.

Each fills ``out`` in place from positions (n,) that are `dt` (s) apart; the velocity of a step is its mean, dx / dt.
Row 0 is the state the law begins with.
"""

from __future__ import annotations

from typing import Any

from stagectl.kernels import friction, friction_bristle, friction_memory
from stagectl.kernels.jit import kernel


@kernel
def bristle(p: friction_bristle.Bristle, position: Any, dt: float, out: Any) -> None:
    """Columns (n, 2) of Dahl or LuGre: the force without `damping`, and the rate of the deflection (rad/s | m/s)."""
    z = 0.0
    out[0, 0], out[0, 1] = 0.0, 0.0
    for k in range(1, len(position)):
        dx = position[k] - position[k - 1]
        before = z
        _, z = friction_bristle.bent(p, z, dx / dt, dx, dt)
        out[k, 0] = p.stiffness * z
        out[k, 1] = (z - before) / dt


@kernel
def operators(p: friction.Gms, position: Any, dt: float, out: Any) -> None:
    """Columns (n, j) of a bundle: each element within +- the Stribeck factor; the weights stay out."""
    count = len(p.operators.rate)
    for j in range(count):
        out[0, j] = 0.0
    for k in range(1, len(position)):
        dx = position[k] - position[k - 1]
        limit = friction.stribeck(p.stribeck, dx / dt)
        for j in range(count):
            out[k, j] = min(max(out[k - 1, j] + dx * p.operators.rate[j], -limit), limit)


@kernel
def gms(p: friction.Gms, s: Any, position: Any, dt: float, out: Any) -> None:
    """Forces (n,) of a bundle whose elements slip on Stribeck's curve, from the states `s` (j,), changed in place.

    An element that slips follows Stribeck's curve at once: the rate constant C of the original, with which it is drawn
    towards the curve, is taken as infinite (F. Al-Bender, V. Lampaert, J. Swevers, IEEE Trans. Automatic Control
    50(11), 2005).  It acts in the milliseconds after break-away, where no capture of ours resolves it.
    """
    out[0] = 0.0
    for k in range(1, len(position)):
        dx = position[k] - position[k - 1]
        out[k] = friction.stops(p.operators, s, dx, friction.stribeck(p.stribeck, dx / dt))


@kernel
def branches(position: Any, out: Any) -> None:
    """Columns (n, 3) of the laws of displacement since reversal: what is travelled, direction, 1 while virgin."""
    x = friction_memory.BRANCH
    for k in range(len(position)):
        dx = position[k] - position[max(k - 1, 0)]
        x = friction_memory.moved(x, dx)
        out[k, 0], out[k, 1], out[k, 2] = x.travelled, x.direction, x.virgin


@kernel
def table(p: friction_memory.Table, position: Any, out: Any) -> None:
    """Forces (n,) of the data-based table."""
    x = friction_memory.BRANCH
    out[0] = 0.0
    for k in range(1, len(position)):
        out[k], x = friction_memory.table(p, x, position[k] - position[k - 1])


@kernel
def rheology(p: friction_memory.Rheology, position: Any, dt: float, out: Any) -> None:
    """Columns (n, 2) of the rheology model: the spring's force, and the creeping one's."""
    x = friction_memory.CREEP
    out[0, 0], out[0, 1] = 0.0, 0.0
    for k in range(1, len(position)):
        dx = position[k] - position[k - 1]
        _, x = friction_memory.rheology(p, x, dx / dt, dx, dt)
        out[k, 0], out[k, 1] = x.branch.force, x.relaxing
