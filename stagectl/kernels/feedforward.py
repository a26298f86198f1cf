"""Multirate perfect tracking control (PTC) of second order.

Over one reference frame ``Tr = 2 Ts`` the held plant maps two commands onto two states, so the commands that
reach a desired state exactly are

    [u1; u2] = B^-1 (xd[i+1] - A xd[i])        A = Ad^2     B = [Ad Bd, Bd]

and the position the plant passes half-way, ``C (Ad xd[i] + Bd u1)``, is the feedback's target there.

    t_i             t_i + Ts        t_i+1 = t_i + 2 Ts
     | u1 held ------| u2 held -------|          even samples: solve;  odd samples: hand out the second half
    xd[i]          passed           xd[i+1]

Two chains run side by side: one ahead of time by the command path's delay L, which gives the current, and one
late by the measurement's delay, which gives the target that the measured position is compared with.

Source: H. Fujimoto, Y. Hori, A. Kawamura, IEEE Trans. Ind. Electronics 48(3), 2001.
"""

from __future__ import annotations

import math
from typing import NamedTuple

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


class State(NamedTuple):
    """Memory between the two halves of a frame, and from frame to frame."""

    ahead: Desired  # start of the coming frame, early by L
    late: Desired  # start of the coming frame, late by the measurement's delay
    current: float  # A, u2 of the running frame
    passed: float  # rad | m, target in its middle
    second_half: bool
    joined: bool  # False after a gap in the rows: where the coming frame starts is not known


class Output(NamedTuple):
    """What the feedforward contributes in this period."""

    current: float  # A
    target: float  # rad | m, y0: where the plant passes now


def held(mechanics: Mechanics, force_constant: float, dt: float) -> Held:
    """The plant sampled at `dt` (s) under zero-order hold; without loss of digits at small D."""
    z = mechanics.viscous * dt / mechanics.inertia
    a12 = dt * (-math.expm1(-z) / z if z > 0.0 else 1.0)
    gain = force_constant / mechanics.inertia
    return Held(a12, math.exp(-z), gain * dt * dt * _phi2(z), gain * a12)


def _phi2(z: float) -> float:
    """``(z - 1 + exp(-z)) / z^2``, by its series where the difference would cancel."""
    if z > 0.5:
        return (z + math.expm1(-z)) / (z * z)
    term, total = 0.5, 0.5
    for n in range(3, 20):
        term *= -z / n
        total += term
    return total


def at_rest(position: float) -> State:
    """A reference that has been standing at `position` (rad | m)."""
    here = Desired(float(position), 0.0)
    return State(here, here, 0.0, float(position), False, True)


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
def after_gap(x: State) -> State:
    """Rows were left out: the coming frame holds the last current, the one after it is exact again."""
    return State(x.ahead, x.late, x.current, x.passed, False, False)


@kernel
def step(p: Held, x: State, ahead: Desired, late: Desired, now: float) -> tuple[Output, State]:
    """One period; `ahead` and `late` are the desired states at the end of the frame that begins now.

    `now` (rad | m) is the commanded position at the instant of the measurement: the target after a gap.
    """
    if x.second_half:
        passed = x.passed if x.joined else now
        return Output(x.current, passed), State(x.ahead, x.late, x.current, passed, False, True)
    if not x.joined:
        return Output(x.current, now), State(ahead, late, x.current, now, True, False)
    u1, u2 = commands(p, x.ahead, ahead)
    v1, _ = commands(p, x.late, late)
    passed = x.late.position + p.a12 * x.late.velocity + p.b1 * v1
    return Output(u1, x.late.position), State(ahead, late, u2, passed, True, True)
