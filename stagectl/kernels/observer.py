"""Disturbance observer: what the machine does beyond its linear model, as a current that would do the same.

::

    current --> delay n + share --> model x+ = Ad x + Bd (i + d) --> position -(-)--> innovation e
                                      ^        ^                                ^          |
                                      +-- k1, k2, k3 (d+ = d + k3 e) -----------|----------+
                                                                           measured

The state ``[position, velocity, d]`` of the held plant is observed with all three poles at ``q = exp(-2 pi f_o Ts)``;
the law subtracts the estimate of d, friction and load included, from its command.  With the delay line the model is
as late as the measurement: nd periods of the command, its dead time and the current loop's lag as a share of two
neighbouring commands, and nm periods of the encoder.  From a disturbance to its estimate, by the model:

    T(z) = k3 z (a12 b2 + b1 (z - a22)) / (z - q)^3        T(1) = 1

Neutral: off (`ABSENT`), the estimate is exactly 0.
Source: K. Ohnishi, M. Shibata, T. Murakami, IEEE/ASME Trans. Mechatronics 1(1), 1996 (disturbance observer); K. J.
Astrom, B. Wittenmark, Computer-Controlled Systems, 1997, sections 4.4 and 9.2 (observer with a disturbance state).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from stagectl.kernels import stage
from stagectl.kernels.feedforward import held
from stagectl.kernels.jit import kernel
from stagectl.units import StageError

LONGEST = len(stage.NO_COMMANDS) - 2  # whole periods of delay that the line holds, apart from the share


class DelayError(StageError):
    """More delay than the observer's line of commands holds."""


class Observer(NamedTuple):
    """Model and gains at the control period, ready to run."""

    a12: float  # s, of the held plant, see `feedforward.Held`
    a22: float
    b1: float  # rad/A | m/A
    b2: float  # rad/(s A) | m/(s A)
    position: float  # k1, of the innovation
    velocity: float  # k2, 1/s
    disturbance: float  # k3, A/rad | A/m
    delay: int  # n, whole periods from the command to what is measured of it
    share: float  # of the command n periods old; the rest is one period older
    pole: float  # q
    active: bool


class State(NamedTuple):
    """The model at the next measurement; a position of NaN has not been measured yet."""

    position: float  # rad | m
    velocity: float  # rad/s | m/s
    disturbance: float  # A
    commands: stage.Line  # A, newest first


AT_REST = State(math.nan, 0.0, 0.0, stage.NO_COMMANDS)
ABSENT = Observer(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 1.0, 0.0, False)


def designed(p: stage.Stage, dt: float, bandwidth: float) -> Observer:
    """Observer of the stage at the period `dt` (s) with three poles at ``-2 pi bandwidth`` (`bandwidth` in Hz).

    Raises DelayError where the delay is longer than the line of commands.
    """
    plant = held(p.mechanics, p.motor.force_constant, dt)
    delay, share = _lateness(p, dt)
    pole = math.exp(-2.0 * math.pi * bandwidth * dt)
    # det(w I - (Ad - I) + K C) = (w + 1 - q)^3 with w = z - 1, coefficient by coefficient.
    s, m = -math.expm1(-2.0 * math.pi * bandwidth * dt), 1.0 - plant.a22
    disturbance = s * s * s / (plant.a12 * plant.b2 + plant.b1 * m)
    position = 3.0 * s - m
    velocity = (3.0 * s * s - position * m - plant.b1 * disturbance) / plant.a12
    return Observer(*plant, position, velocity, disturbance, delay, share, pole, True)


def _lateness(p: stage.Stage, dt: float) -> tuple[int, float]:
    """Whole periods of delay, and the share of the newer of the two commands that act in one period."""
    lag = (p.drive.current_lag + p.drive.dead_time) / dt
    whole = p.drive.delay_samples + p.encoder.delay_samples + math.floor(lag)
    if whole > LONGEST:
        raise DelayError(
            f"{whole} periods of delay (of the drive its delay_samples, dead_time and current_lag, and "
            f"encoder.delay_samples together); must be at most {LONGEST}: switch the layer observer off"
        )
    return whole, 1.0 - (lag - math.floor(lag))


@kernel
def estimate(p: Observer, x: State, measured: float) -> float:
    """The disturbance (A) as this `measured` position (rad | m) shows it; 0 before anything is known of it."""
    if not p.active or math.isnan(x.position):
        return 0.0
    return x.disturbance + p.disturbance * (measured - x.position)


@kernel
def updated(p: Observer, x: State, measured: float, current: float) -> State:
    """The period's end: `measured` (rad | m) corrects the model, and the `current` (A) moves it on.

    A current that compensates a modelled disturbance (friction) is left out of `current`, as the disturbance is left
    out of the plant: then only the rest of the disturbance is observed.
    """
    if not p.active:
        return x
    a12, a22, b1, b2, k1, k2, k3, n, share, _, _ = p
    position, velocity, disturbance, line = x
    if math.isnan(position):
        position = measured
    commands = stage.pushed(line, current)
    older = commands[n + 1]
    acting = older + share * (commands[n] - older) + disturbance
    e = measured - position
    return State(
        position + a12 * velocity + b1 * acting + k1 * e,
        a22 * velocity + b2 * acting + k2 * e,
        disturbance + k3 * e,
        commands,
    )


def transfer(p: Observer, z: Any) -> tuple[Any, Any]:
    """``d = M(z) measured + U(z) current`` at complex `z` (n,): (M in A/rad | A/m, U).

    With a feedback C the loop that is cut at the plant's input is ``P (C + M) / (1 + U)``.
    """
    if not p.active:
        return 0.0 * z, 0.0 * z
    common = p.disturbance * z / ((z - p.pole) * (z - p.pole) * (z - p.pole))
    numerator = p.a12 * p.b2 + p.b1 * (z - p.a22)
    late = (p.share + (1.0 - p.share) / z) * z**-p.delay
    return common * (z - 1.0) * (z - p.a22), -common * numerator * late
