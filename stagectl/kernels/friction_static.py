"""Friction as a function of velocity alone: Coulomb, viscous, Stribeck.

::

    F = sgn(v) T_c (1 + rise exp(-(|v| / v_s)^shape)) + D v

Source: Simultaneous Identification ..., section III, with ``rise = (T_s - T_c) / T_c``.  What the paper leaves open at
standstill, ``F = u``, is here the side of the last motion: a restart in the same direction changes nothing.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from stagectl.kernels import friction
from stagectl.kernels.jit import kernel
from stagectl.units import Quantity


class Static(NamedTuple):
    """Steady friction over velocity; a neutral `stribeck` leaves Coulomb and viscous friction."""

    coulomb: Annotated[float, Quantity("N m | N", "[0, 1e6]", "friction at speed, without its viscous part, T_c")]
    viscous: Annotated[float, Quantity("N m s/rad | N s/m", "[0, 1e6]", "viscous friction D")] = 0.0
    stribeck: friction.Stribeck = friction.Stribeck()


class State(NamedTuple):
    """Memory: none but the side of the last motion."""

    direction: float  # -1, 0 before any motion, or 1


@kernel
def step(p: Static, x: State, v: float, dx: float, dt: float) -> tuple[float, State]:
    """Force after a move of `dx` at velocity `v` during `dt`; the move gives the direction."""
    direction = x.direction
    if dx > 0.0:
        direction = 1.0
    elif dx < 0.0:
        direction = -1.0
    return direction * p.coulomb * friction.stribeck(p.stribeck, v) + p.viscous * v, State(direction)
