"""One axis behind a servo drive, in short steps: a current loop that is solved exactly, and mechanics split in two.

In each step the torque changes the velocity for half of it, the axis drifts at that velocity while the friction's
state follows, and the torque acts for the other half (Strang's splitting: second order, reversible without friction).
The current is exact: the command is a staircase, the lag is of first order, and the mean over each step is an
integral, so that a command may take effect at any instant, between two steps as well.

::

    reference - position -> PD(I) -> command -> delay -> lag -> + noise -> current -> torque -> axis -> encoder
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.foreign_plants import friction
from tests.foreign_plants.compiled import compiled
from tests.foreign_plants.friction import Friction, advance, torque

Array = NDArray[np.float64]


class Mechanics(NamedTuple):
    """The rotor and what is rigidly tied to it."""

    inertia: float  # kg m^2
    viscous: float  # N m s/rad
    offset: float  # N m, opposes positive motion
    ripple: float  # share of the force constant, over the angle
    ripple_order: float  # periods a revolution
    ripple_phase: float  # rad
    cogging: float  # N m
    cogging_order: float  # periods a revolution


class Drive(NamedTuple):
    """From the command to the current."""

    force_constant: float  # N m/A
    delay: float  # s, from the sample to the instant at which the command computed from it begins to act
    lag: float  # s, time constant of the current loop
    quantum: float  # A, one per mille of the rated current: resolution of the command
    limit: float  # A


class Encoder(NamedTuple):
    """What is read at a sample."""

    step: float  # rad, one count
    phase: float  # counts, where the first edge lies
    age: float  # s; the position at the sample is that of `age` earlier


class Controller(NamedTuple):
    """PD or PID over the error, with a filtered derivative."""

    period: float  # s
    proportional: float  # N m/rad
    derivative: float  # N m s/rad
    integral: float  # N m/(rad s)
    cutoff: float  # rad/s, of the derivative


class Plant(NamedTuple):
    """All of it."""

    mechanics: Mechanics
    drive: Drive
    encoder: Encoder
    controller: Controller
    friction: Friction
    step: float  # s, of the integration; a whole number of them is one period of controller and noise


class Trace(NamedTuple):
    """What happened, after each step and at each sample of the controller."""

    position: Array  # (n + 1,) rad, at the ends of the steps
    velocity: Array  # (n + 1,) rad/s
    current: Array  # (n + 1,) A
    friction: Array  # (n,) N m, mean over the step
    drift: Array  # (n,) rad/s, the velocity at which each step was moved
    command: Array  # (k,) A
    measured: Array  # (k,) rad


NOISE_PERIOD = 50e-6  # s: the drive's own cycle, for which one value of the current's noise is held


@compiled
def _settled(current: float, wanted: float, lag: float, time: float) -> tuple[float, float]:
    """The current after `time` towards a constant command, and its integral (A, A s)."""
    gap = current - wanted
    fall = gap * math.exp(-time / lag)
    return wanted + fall, wanted * time + lag * (gap - fall)


@compiled
def _active(commands: Any, latest: int, time: float, drive: Any, period: float) -> float:
    """The command (A) that the drive applies at `time`."""
    index = min(math.floor((time - drive.delay) / period + 1e-9), latest)
    return float(commands[index]) if index >= 0 else 0.0


@compiled
def _current_over(current: float, plant: Any, trace: Any, n: int, disturbance: float) -> tuple[float, float]:
    """The current at the end of step n, and its mean over the step; one command may begin within it."""
    drive, h, period = plant.drive, plant.step, plant.controller.period
    begin = n * h
    index = math.floor((begin - drive.delay) / period + 1e-9)
    split = min(max((index + 1) * period + drive.delay - begin, 0.0), h)
    latest = math.floor(begin / period + 1e-9)
    first = _active(trace.command, latest, begin, drive, period) + disturbance
    second = _active(trace.command, latest, begin + h, drive, period) + disturbance
    middle, area = _settled(current, first, drive.lag, split)
    end, rest = _settled(middle, second, drive.lag, h - split)
    return end, (area + rest) / h


@compiled
def _acceleration(plant: Any, z: Any, x: float, v: float, current: float) -> float:
    m = plant.mechanics
    effort = plant.drive.force_constant * current * (1.0 + m.ripple * math.cos(m.ripple_order * x + m.ripple_phase))
    cogging = m.cogging * math.cos(m.cogging_order * x)
    return float((effort - cogging - m.offset - m.viscous * v - torque(plant.friction, z, v)) / m.inertia)


@compiled
def _kick(plant: Any, z: Any, x: float, v: float, current: float) -> float:
    """The velocity after half a step of torque: the midpoint rule."""
    half = 0.5 * plant.step
    middle = v + 0.5 * half * _acceleration(plant, z, x, v, current)
    return float(v + half * _acceleration(plant, z, x, middle, current))


@compiled
def between(trace: Any, k: int, s: float, h: float) -> float:
    """The position (rad) a share s after the end of step k - 1: the cubic through both ends and their velocities."""
    x, v, rest = trace.position, trace.velocity, 1.0 - s
    ends = x[k] * (1.0 + 2.0 * s) * rest * rest + x[k + 1] * s * s * (3.0 - 2.0 * s)
    return float(ends + h * s * rest * (v[k] * rest - v[k + 1] * s))


@compiled
def _read(plant: Any, trace: Any, n: int) -> float:
    """The encoder's position at the end of step n - 1 (rad): whole counts of the position `age` earlier."""
    e, h = plant.encoder, plant.step
    place = max(n - e.age / h, 0.0)
    k = max(min(math.floor(place), n - 1), 0)
    position = between(trace, k, place - k, h)
    return float((math.floor(position / e.step + e.phase) - e.phase + 0.5) * e.step)


@compiled
def _commanded(plant: Any, memory: Any, error: float) -> float:
    """The command (A), in whole per mille of the rated current; `memory` holds integral, filtered and last error."""
    c, drive = plant.controller, plant.drive
    fade = math.exp(-c.cutoff * c.period)
    memory[1] = fade * memory[1] + (1.0 - fade) * (error - memory[2]) / c.period
    memory[2] = error
    wanted = c.proportional * error + c.derivative * memory[1] + c.integral * (memory[0] + error * c.period)
    current = min(max(wanted / drive.force_constant, -drive.limit), drive.limit)
    if current == wanted / drive.force_constant:  # the integral stops where the current is at its limit
        memory[0] += error * c.period
    return float(round(current / drive.quantum) * drive.quantum)


@compiled
def _moved(plant: Any, trace: Any, z: Any, n: int, current: float) -> None:
    """One step of the mechanics under a mean current."""
    h, x, v = plant.step, trace.position[n], trace.velocity[n]
    drift = _kick(plant, z, x, v, current)
    before = torque(plant.friction, z, v)
    advance(plant.friction, z, drift, h)
    x += drift * h
    v = _kick(plant, z, x, drift, current)
    trace.position[n + 1], trace.velocity[n + 1], trace.drift[n] = x, v, drift
    trace.friction[n] = 0.5 * (before + torque(plant.friction, z, v))


@compiled
def _run(plant: Any, trace: Any, z: Any, inputs: Any) -> None:
    """The whole motion; inputs = (reference (k,) rad, or commands (k,) A; noise (j,) A; whether the loop is closed)."""
    wanted, noise, closed = inputs
    ticks = round(plant.controller.period / plant.step)
    held = round(NOISE_PERIOD / plant.step)
    memory = np.zeros(3)
    for n in range(len(trace.drift)):
        if n % ticks == 0:
            k = n // ticks
            trace.measured[k] = _read(plant, trace, n)
            if k == 0:
                memory[2] = wanted[0] - trace.measured[0]
            trace.command[k] = _commanded(plant, memory, wanted[k] - trace.measured[k]) if closed else wanted[k]
        end, mean = _current_over(trace.current[n], plant, trace, n, noise[n // held])
        trace.current[n + 1] = end
        _moved(plant, trace, z, n, mean)


def run(plant: Plant, wanted: Array, noise: Array, closed: bool = True) -> Trace:
    """The motion from rest at zero.

    `wanted` has one row a period of the controller: the reference (rad) or, in open loop, the command (A).  `noise`
    is the disturbance of the current loop's input (A), one value a `NOISE_PERIOD`.
    """
    ticks = round(plant.controller.period / plant.step)
    n, k = len(wanted) * ticks, len(wanted)
    sizes = (n + 1, n + 1, n + 1, n, n, k, k)
    trace = Trace(*[np.zeros(size) for size in sizes])
    _run(plant, trace, friction.states(plant.friction), (wanted, noise, closed))
    return trace
