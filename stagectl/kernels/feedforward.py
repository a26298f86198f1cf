"""What is known before the motion: perfect tracking feedforward (PTC) of second order, and friction.

Over one reference frame ``Tr = 2 Ts`` the held plant maps two commands onto two states, so the commands that
reach a desired state exactly are

    [u1; u2] = B^-1 (xd[i+1] - A xd[i])        A = Ad^2     B = [Ad Bd, Bd]

and the position the plant passes half-way, ``C (Ad xd[i] + Bd u1)``, is the feedback's target there.

    t_i             t_i + Ts        t_i+1 = t_i + 2 Ts
     | u1 held ------| u2 held -------|
    xd[i]          passed           xd[i+1]

Two chains run side by side: one ahead of time by the command path's delay L, which gives the current, and one
late by the measurement's delay, which gives the target that the measured position is compared with.  Friction is
compensated from the *reference*, half a period further ahead: from the measured position it would chatter at
standstill.

Source: H. Fujimoto, Y. Hori, A. Kawamura, IEEE Trans. Ind. Electronics 48(3), 2001; the papers named in
`kernels.friction`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from stagectl.kernels import friction
from stagectl.kernels.constants import PHI2_SERIES_BELOW
from stagectl.kernels.jit import kernel
from stagectl.kernels.stage import Mechanics


class Held(NamedTuple):
    """``Kt / (J s^2 + D s)`` under a held current: ``Ad = [[1, a12], [0, a22]]``, ``Bd = [b1, b2]``."""

    a12: float  # s
    a22: float
    b1: float  # rad/A | m/A
    b2: float  # rad/(s A) | m/(s A)


class Desired(NamedTuple):
    """A state of the reference."""

    position: float  # rad | m
    velocity: float  # rad/s | m/s


class Feedforward(NamedTuple):
    """Model that the feedforward inverts, and which of its layers are switched on."""

    plant: Held
    friction: friction.StopOperators
    force_constant: float  # N m/A | N/A
    with_ptc: bool
    with_friction: bool
    friction_scale: float = 1.0  # factor on the friction that is compensated, of any law
    with_effects: bool = False  # what else the stage model holds: `compensation.model_effects`


class Foreseen(NamedTuple):
    """The trajectory at the instants that matter, for each period k = 0 ... n - 1 (axis units).

    The frames' ends reach two periods further: ``ahead`` and ``late`` have n + 2 rows.
    """

    reference: Any  # (n,) position at t
    ahead: Any  # (n + 2, 2) position and velocity at t + L
    late: Any  # (n + 2, 2) position and velocity at t - nm Ts
    friction: Any  # (n,) position at t + L + Ts/2


def held(mechanics: Mechanics, force_constant: float, dt: float) -> Held:
    """The plant sampled at `dt` (s) under zero-order hold; without loss of digits at small D."""
    z = mechanics.viscous * dt / mechanics.inertia
    a12 = dt * (-math.expm1(-z) / z if z > 0.0 else 1.0)
    gain = force_constant / mechanics.inertia
    return Held(a12, math.exp(-z), gain * dt * dt * _phi2(z), gain * a12)


def _phi2(z: float) -> float:
    """``(z - 1 + exp(-z)) / z^2``, by its series where the difference would cancel."""
    if z > PHI2_SERIES_BELOW:
        return (z + math.expm1(-z)) / (z * z)
    term, total = 0.5, 0.5
    for n in range(3, 20):
        term *= -z / n
        total += term
    return total


@kernel
def commands(p: Held, start: Desired, end: Desired) -> tuple[float, float]:
    """``[u1, u2]`` (A) that take the plant from `start` to `end` in two periods."""
    # Right-hand side xd[i+1] - Ad^2 xd[i]: the positions are subtracted first, as they are close.
    move = (end.position - start.position) - p.a12 * (1.0 + p.a22) * start.velocity
    speed = end.velocity - p.a22 * p.a22 * start.velocity
    first = p.b1 + p.a12 * p.b2  # Ad Bd
    second = p.a22 * p.b2
    determinant = first * p.b2 - p.b1 * second
    return (p.b2 * move - p.b1 * speed) / determinant, (first * speed - second * move) / determinant


@kernel
def setpoints(p: Feedforward, foreseen: Foreseen, stops: Any, rows: Any) -> None:
    """Fill `rows` (n, 8), the fields of `law.Setpoint`; n is even, `stops` the relaxed friction operators."""
    for k in range(len(rows)):
        rows[k, 0], rows[k, 4], rows[k, 7] = foreseen.reference[k], foreseen.late[k, 1], 1.0
    for k in range(0, len(rows), 2):
        _frame(p, foreseen, k, rows)
    if p.with_friction:
        place = foreseen.reference[0]
        for k in range(len(rows)):
            force = friction.stops(p.friction, stops, foreseen.friction[k] - place, 1.0)
            rows[k, 3] = force / p.force_constant
            place = foreseen.friction[k]


@kernel
def _frame(p: Feedforward, foreseen: Foreseen, k: int, rows: Any) -> None:
    """Current and target of the periods k and k + 1."""
    late = Desired(foreseen.late[k, 0], foreseen.late[k, 1])
    rows[k, 1], rows[k + 1, 1] = late.position, foreseen.late[k + 1, 0]
    if p.with_ptc:
        ahead = Desired(foreseen.ahead[k, 0], foreseen.ahead[k, 1])
        end = Desired(foreseen.ahead[k + 2, 0], foreseen.ahead[k + 2, 1])
        rows[k, 2], rows[k + 1, 2] = commands(p.plant, ahead, end)
        v1, _ = commands(p.plant, late, Desired(foreseen.late[k + 2, 0], foreseen.late[k + 2, 1]))
        rows[k + 1, 1] = late.position + p.plant.a12 * late.velocity + p.plant.b1 * v1
