"""The deployed controller: PID (Tustin), multirate perfect tracking feedforward, friction from the reference.

Designed on the nominal model.  e = y0 - position; PID with four closed-loop poles at -p, p = 2 pi bandwidth:
a = 4p - D/J, b2 = (6 p^2 J - D a)/Kt, b1 = 4 p^3 J/Kt, b0 = p^4 J/Kt, Ki = b0/a, Kp = (b1 - Ki)/a, Kd = (b2 - Kp)/a.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from stagectl_studies.machine.jit import compiled
from stagectl_studies.machine.machine import Floats
from stagectl_studies.machine.standstill import Rest


class Model(NamedTuple):
    """What the user believes of the stage."""

    inertia: float
    viscous: float
    force_constant: float
    weight: Floats  # (j,) N m
    slip: Floats  # (j,) rad


class Loop(NamedTuple):
    """Gains and timing of the deployed controller; positions in rad, current in A."""

    period: float = 0.0005
    bandwidth: float = 40.0
    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    pole: float = 1.0
    advance: float = 0.000659
    friction_advance: float = 0.000909
    rest: Rest = Rest()
    limit: float = 1e9  # A; the integrator waits where more is asked for


class Rows(NamedTuple):
    """What the controller knows before the motion starts, one value a row, all (n,)."""

    reference: Floats
    target: Floats  # y0
    feedforward: Floats  # A
    injection: Floats  # A
    speed: Floats  # rad/s, of the reference
    friction: Floats  # A, within `feedforward`


def designed(model: Model, bandwidth: float, lag: float = 0.000159, delay_samples: int = 1) -> Loop:
    """Gains by pole placement on the nominal model."""
    p = 2.0 * math.pi * bandwidth
    j, d, kt = model.inertia, model.viscous, model.force_constant
    a = 4.0 * p - d / j
    b2, b1, b0 = (6.0 * p * p * j - d * a) / kt, 4.0 * p**3 * j / kt, p**4 * j / kt
    ki = b0 / a
    kp = (b1 - ki) / a
    kd = (b2 - kp) / a
    advance = lag + delay_samples * 0.0005
    return Loop(0.0005, bandwidth, kp, ki, kd, a, advance, advance + 0.00025)


def held(spline: BSpline, rows: NDArray[np.floating[Any]], last: int, order: int) -> Floats:
    """Spline over the row number, constant outside its ends."""
    inside = np.clip(rows, 0.0, float(last))
    values = np.asarray(spline(inside, order), dtype=np.float64)
    return values if order == 0 else np.where(inside == rows, values, 0.0)


def frames(spline: BSpline, n: int, period: float, advance: float) -> Floats:
    """States (position, speed) at the frames' instants 2 i Ts + advance, (frames + 1, 2)."""
    rows = np.arange((n + 1) // 2 + 1) * 2.0 + advance / period
    return np.column_stack([held(spline, rows, n - 1, 0), held(spline, rows, n - 1, 1) / period])


def zero_order_hold(model: Model, period: float) -> tuple[Floats, Floats]:
    """Ad, Bd of Kt/(J s^2 + D s) under a held current."""
    r = model.viscous / model.inertia
    e = math.exp(-r * period)
    s = -math.expm1(-r * period) / r
    gain = model.force_constant / model.viscous
    return np.array([[1.0, s], [0.0, e]]), np.array([gain * (period - s), gain * (1.0 - e)])


def tracking(model: Model, states: Floats, period: float) -> Floats:
    """Currents [u1 u2] = B^-1 (x[i+1] - A x[i]) of each frame, (frames, 2) A."""
    ad, bd = zero_order_hold(model, period)
    b = np.column_stack([ad @ bd, bd])
    step = states[1:] - states[:-1] @ (ad @ ad).T
    return np.asarray(np.linalg.solve(b, step.T).T)


def targets(model: Model, states: Floats, reference: Floats, period: float) -> Floats:
    """y0: even rows the reference, odd rows C (Ad x + Bd v1), (n,) rad."""
    ad, bd = zero_order_hold(model, period)
    odd = states[:-1] @ ad[0] + bd[0] * tracking(model, states, period)[:, 0]
    out = reference.copy()
    out[1::2] = odd[: out[1::2].size]
    return out


@compiled
def run_stops(weight: Floats, slip: Floats, x: Floats, state: Floats, out: Floats) -> None:
    """Torque of stop operators over positions `x`; `state` and `out` are changed."""
    before = x[0]
    for k in range(x.size):
        total = 0.0
        for j in range(weight.size):
            state[j] = min(max(state[j] + (x[k] - before) / slip[j], -1.0), 1.0)
            total += weight[j] * state[j]
        out[k] = total
        before = x[k]


def stops(weight: Floats, slip: Floats, x: Floats) -> Floats:
    """Torque of stop operators over positions `x`, relaxed at the first of them, (n,) N m."""
    out = np.empty(x.size)
    run_stops(weight, slip, x, np.zeros(weight.size), out)
    return out


def prepared(model: Model, loop: Loop, reference: Floats, injection: Floats) -> Rows:
    """Everything of the command that does not depend on the measurement."""
    n, period = reference.size, loop.period
    spline = make_interp_spline(np.arange(n, dtype=np.float64), reference, k=5)
    ahead = frames(spline, n, period, loop.advance)
    current = tracking(model, ahead, period).ravel()[:n]
    target = targets(model, frames(spline, n, period, 0.0), reference, period)
    later = held(spline, np.arange(n) + loop.friction_advance / period, n - 1, 0)
    friction = stops(model.weight, model.slip, np.concatenate([reference[:1], later]))[1:] / model.force_constant
    speed = held(spline, np.arange(n, dtype=np.float64), n - 1, 1) / period
    return Rows(reference, target, current + friction, injection, speed, friction)


@compiled
def pid(loop: Loop, error: float, state: tuple[float, float, float]) -> tuple[float, tuple[float, float, float]]:
    """One row of the feedback; `state` is (integrator, derivative, previous error)."""
    integrator, derivative, before = state
    ts = loop.period
    integrator += loop.ki * ts / 2.0 * (error + before)
    at = loop.pole * ts
    derivative = (2.0 - at) / (2.0 + at) * derivative + 2.0 * loop.kd * loop.pole / (2.0 + at) * (error - before)
    return loop.kp * error + integrator + derivative, (integrator, derivative, error)


@compiled
def saturated(loop: Loop, command: float, error: float, integrator: float, before: float) -> tuple[float, float]:
    """The command (A) that leaves the controller, and its integrator: as `before`, where the error asks for more."""
    given = min(max(command, -loop.limit), loop.limit)
    return given, before if given != command and error * command > 0.0 else integrator
