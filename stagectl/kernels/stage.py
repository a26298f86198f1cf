"""The plant: one fixed pipeline in physical order.

::

    command --> drive -------> motor ------> mechanics <------ friction        encoder --> measured
                quantise       i -> effort   v, x: inertia     stop operators  delay nm Ts
                delay nd Ts                  viscous, bias     Stribeck        noise
                limit                                          bristle         steps
                current loop

Every effect has its place in one of these five blocks, is always there, and vanishes bit for bit at its
neutral parameters.  Adding one: a field in the block's parameters, a function, a line in the block.

Axis units are rad and N m (rotary) or m and N (linear); the code does not know which.  Positive current
gives positive effort and moves towards positive positions; friction opposes the velocity.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.kernels import friction, friction_bristle
from stagectl.kernels.jit import kernel
from stagectl.kernels.plant import NO_COMMANDS as NO_COMMANDS
from stagectl.kernels.plant import SILENT as SILENT
from stagectl.kernels.plant import Drive as Drive
from stagectl.kernels.plant import Encoder as Encoder
from stagectl.kernels.plant import Friction as Friction
from stagectl.kernels.plant import Line as Line
from stagectl.kernels.plant import Mechanics as Mechanics
from stagectl.kernels.plant import Memory as Memory
from stagectl.kernels.plant import Motor as Motor
from stagectl.kernels.plant import Noise as Noise
from stagectl.kernels.plant import Stage as Stage
from stagectl.kernels.plant import State as State


class _Coefficients(NamedTuple):
    """Exact solution of the linear parts over half an integration step."""

    h: float  # s, whole step
    lag: float  # decay of the current error in half a step
    lag_mean: float  # its mean over that half step
    damping: float  # decay of the velocity
    gain: float  # velocity per effort


def at_rest(p: Stage, position: float = 0.0, time: float = 0.0) -> State:
    """The plant standing at `position` without current; its friction carries the bias, and nothing else."""
    place = float(position)
    here: Line = (place, place, place, place, place, place, place, place)
    stops = friction.relaxed(p.friction.operators)
    factor = friction.stribeck(p.friction.stribeck, 0.0)
    held = friction_bristle.settled(p.friction.bristle, p.mechanics.bias)
    load = p.mechanics.bias - p.friction.bristle.stiffness * held
    force = friction.settled(p.friction.operators, stops, load, factor)
    force += p.friction.bristle.stiffness * held
    memory = Memory(time, NO_COMMANDS, time, 0.0, 0.0, place, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, place, place, 0.0)
    return State(NO_COMMANDS, here, 0.0, place, 0.0, force, stops, held, memory)


def sliding(p: Friction) -> float:
    """Friction at speed (N m | N), without its viscous part."""
    return float(sum(p.operators.weight)) + p.bristle.coulomb


def stiffness(p: Friction) -> float:
    """Stiffness at rest (N m/rad | N/m), before anything slips."""
    pairs = zip(p.operators.weight, p.operators.rate, strict=True)
    return float(sum(a * r for a, r in pairs)) + (p.bristle.stiffness if p.bristle.coulomb > 0.0 else 0.0)


@kernel
def pushed(line: Line, value: float) -> Line:
    """`line` with `value` in front; the oldest one falls out."""
    a, b, c, d, e, f, g, _ = line
    return (value, a, b, c, d, e, f, g)


@kernel
def delivered(p: Drive, commands: Line) -> float:
    """Current the drive aims at in this period: the command of `delay_samples` periods ago, limited."""
    return min(max(commands[p.delay_samples], -p.current_limit), p.current_limit)


@kernel
def rounded(p: Drive, command: float) -> float:
    """Command in whole steps of the drive's object, halves upwards."""
    if p.current_quantum == 0.0:
        return command
    return math.floor(command / p.current_quantum + 0.5) * p.current_quantum


@kernel
def _coefficients(p: Stage, h: float) -> _Coefficients:
    half = 0.5 * h
    lag, lag_mean = 0.0, 0.0
    if p.drive.current_lag > 0.0:
        ratio = half / p.drive.current_lag
        lag = math.exp(-ratio)
        lag_mean = -math.expm1(-ratio) / ratio
    damped = p.mechanics.viscous * half / p.mechanics.inertia
    gain = half / p.mechanics.inertia
    if damped > 0.0:
        gain = -math.expm1(-damped) / p.mechanics.viscous
    return _Coefficients(h, lag, lag_mean, math.exp(-damped), gain)


@kernel
def _substep(p: Stage, c: _Coefficients, x: State, target: float, extra: float, bristled: bool) -> State:
    """Kick, drift, kick (velocity Verlet), exact in current loop and viscous part.

    Second order while Stribeck is neutral; with it first, as its factor takes the velocity of half a step before.
    """
    error = x.current - target
    effort = p.motor.force_constant * (target + error * c.lag_mean + extra) + p.mechanics.bias
    half_way = c.damping * x.velocity + c.gain * (effort - x.force)
    dx = c.h * half_way
    force = friction.stops(p.friction.operators, x.stops, dx, friction.stribeck(p.friction.stribeck, half_way))
    bristle = x.bristle
    if bristled:
        carried, bristle = friction_bristle.bent(p.friction.bristle, bristle, half_way, dx, c.h)
        force += carried
    error *= c.lag
    effort = p.motor.force_constant * (target + error * c.lag_mean + extra) + p.mechanics.bias
    velocity = c.damping * half_way + c.gain * (effort - force)
    current = target + error * c.lag
    return State(x.commands, x.latched, current, x.position + dx, velocity, force, x.stops, bristle, x.memory)


@kernel
def commanded(p: Drive, x: State, command: float) -> State:
    """Drive, once a period: `command` (A) enters the delay line; the one that leaves it acts from now on."""
    commands = pushed(x.commands, rounded(p, command))
    return State(commands, x.latched, x.current, x.position, x.velocity, x.force, x.stops, x.bristle, x.memory)


@kernel
def drifted(p: Stage, x: State, noise: Noise, dt: float, substeps: int) -> State:
    """The plant `dt` (s) later, under the command that acts."""
    target = delivered(p.drive, x.commands)
    c = _coefficients(p, dt / substeps)
    if p.friction.bristle.coulomb == 0.0:  # asked once a period, not at every step: neutral costs nothing
        for _ in range(substeps):
            x = _substep(p, c, x, target, noise.current, False)
    else:
        for _ in range(substeps):
            x = _substep(p, c, x, target, noise.current, True)
    return x


@kernel
def latched(x: State) -> State:
    """Encoder, once a period: the position now enters the measurement's delay line."""
    line = pushed(x.latched, x.position)
    return State(x.commands, line, x.current, x.position, x.velocity, x.force, x.stops, x.bristle, x.memory)


@kernel
def period(p: Stage, x: State, command: float, noise: Noise, dt: float, substeps: int) -> State:
    """Advance the plant by one control period `dt` (s) under a held `command` (A)."""
    return latched(drifted(p, commanded(p.drive, x, command), noise, dt, substeps))


@kernel
def counts(p: Encoder, position: float) -> float:
    """Encoder counts of a position: rounded to the nearest, halves upwards."""
    return math.floor(position / p.step + 0.5)


@kernel
def measured(p: Encoder, x: State, noise: Noise) -> float:
    """Position as the encoder reports it (rad | m)."""
    position = x.latched[p.delay_samples] + noise.position
    if p.step == 0.0:
        return position
    return counts(p, position) * p.step
