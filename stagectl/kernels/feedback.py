"""PID feedback by pole placement, on the position error.

For the plant ``Kt / (J s^2 + D s)`` and ``C(s) = Kp + Ki/s + Kd s a/(s + a)`` the closed loop has four poles;
all are put at ``-p = -2 pi f_b`` ("position band frequency becomes 40 Hz using pole placement", Simultaneous
Identification ..., section V):

    a  = 4 p - D/J
    b2 = (6 p^2 J - D a)/Kt     b1 = 4 p^3 J/Kt     b0 = p^4 J/Kt
    Ki = b0/a     Kp = (b1 - Ki)/a     Kd = (b2 - Kp)/a

discretised by Tustin's rule.  Units: A per rad | m of error.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.kernels.jit import kernel
from stagectl.kernels.stage import Mechanics


class Gains(NamedTuple):
    """Continuous controller: what a tuning sheet shows."""

    proportional: float  # Kp, A/rad | A/m
    integral: float  # Ki, A/(rad s) | A/(m s)
    derivative: float  # Kd, A s/rad | A s/m
    pole: float  # a, rad/s, of the derivative's filter


class Pid(NamedTuple):
    """The same controller at the control period, ready to run."""

    proportional: float  # A/rad | A/m
    integral: float  # Ki Ts/2
    derivative: float  # 2 Kd a/(2 + a Ts)
    decay: float  # (2 - a Ts)/(2 + a Ts)


class State(NamedTuple):
    """Memory of the controller."""

    error: float  # rad | m, of the last period
    integral: float  # A
    derivative: float  # A


class Output(NamedTuple):
    """The three terms of the command (A)."""

    proportional: float
    integral: float
    derivative: float


AT_REST = State(0.0, 0.0, 0.0)
ABSENT = Pid(0.0, 0.0, 0.0, 0.0)


def place_poles(mechanics: Mechanics, force_constant: float, bandwidth: float) -> Gains:
    """Gains that put all four closed-loop poles at ``-2 pi bandwidth`` (`bandwidth` in Hz)."""
    p = 2.0 * math.pi * bandwidth
    inertia, viscous = mechanics.inertia, mechanics.viscous
    a = 4.0 * p - viscous / inertia
    b2 = (6.0 * p * p * inertia - viscous * a) / force_constant
    b1 = 4.0 * p * p * p * inertia / force_constant
    b0 = p * p * p * p * inertia / force_constant
    integral = b0 / a
    proportional = (b1 - integral) / a
    return Gains(proportional, integral, (b2 - proportional) / a, a)


def discretised(gains: Gains, dt: float) -> Pid:
    """`gains` by Tustin's rule at the period `dt` (s)."""
    damped = gains.pole * dt
    derivative = 2.0 * gains.derivative * gains.pole / (2.0 + damped)
    return Pid(gains.proportional, 0.5 * gains.integral * dt, derivative, (2.0 - damped) / (2.0 + damped))


def scaled(p: Pid, factor: float) -> Pid:
    """`p` with all its gains times `factor`: the same loop around an inertia that is so many times as large."""
    return p._replace(
        proportional=factor * p.proportional, integral=factor * p.integral, derivative=factor * p.derivative
    )


@kernel
def step(p: Pid, x: State, error: float) -> tuple[Output, State]:
    """One period: the terms for this `error` (rad | m), and the memory for the next."""
    integral = x.integral + p.integral * (error + x.error)
    derivative = p.decay * x.derivative + p.derivative * (error - x.error)
    return Output(p.proportional * error, integral, derivative), State(error, integral, derivative)
