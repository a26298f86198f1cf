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

from stagectl.kernels import (
    drive_effects,
    effects,
    equilibrium,
    friction,
    friction_bristle,
    friction_effects,
    plant_with_effects,
    transmission,
)
from stagectl.kernels.constants import MOST_STEPS, STICKING_ANGLE
from stagectl.kernels.equilibrium import copied as copied
from stagectl.kernels.jit import kernel
from stagectl.kernels.plant import NO_COMMANDS as NO_COMMANDS
from stagectl.kernels.plant import SILENT as SILENT
from stagectl.kernels.plant import Contact as Contact
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
    """Exact solution of the linear parts of a plant without effects over half an integration step."""

    h: float  # s, whole step
    lag: float  # decay of the current error in half a step
    lag_mean: float  # its mean over that half step
    damping: float  # decay of the velocity
    gain: float  # velocity per effort


class Steps(NamedTuple):
    """How the plant is integrated over `dt`, and what holds at all its steps: the same in every period."""

    dt: float  # s
    number: int
    plain: bool  # whether no effect is at work
    without_effects: _Coefficients
    with_effects: plant_with_effects.Steps


def at_rest(p: Stage, position: float = 0.0, time: float = 0.0, held: float = 0.0) -> State:
    """The plant standing at `position` under the command `held` (A), at the session clock `time` (s).

    Its friction carries what else acts on the axis: bias, cogging, cable; behind a transmission the load is where
    spring and gap balance.
    """
    stops, at_load = friction.relaxed(p.friction.operators), friction.relaxed(p.friction.operators)
    return equilibrium.standing(p, stops, at_load, float(position), float(time), float(held))


def at_reading(p: Stage, measured: float, time: float = 0.0, held: float = 0.0) -> State:
    """`at_rest` where the encoder, with the errors of its grating, reads `measured` (rad | m)."""
    return at_rest(p, equilibrium.read(p, float(measured)), time, held)


def released(p: Stage, measured: float) -> float:
    """Command (A), in the drive's steps, that carries all of the load where the encoder reads `measured` (rad | m)."""
    return rounded(p.drive, equilibrium.carrying(p, equilibrium.read(p, float(measured))))


def as_read(p: Stage, measured: float, time: float, going_on: tuple[float, float], dt: float) -> State:
    """`at_reading` under a current, but `going_on` at a velocity: (rad/s | m/s, A); at rest where the velocity is 0."""
    velocity, current = going_on
    if velocity == 0.0:
        return at_reading(p, measured, time, current)
    return equilibrium.in_motion(p, at_reading(p, measured, time), velocity, current, dt)


def sliding(p: Friction) -> float:
    """Friction at speed (N m | N), without its viscous part."""
    return float(sum(p.operators.weight)) + p.bristle.coulomb


def scaled_friction(p: Friction, factor: float) -> Friction:
    """All friction but the viscous part times `factor`."""
    operators = friction.bundle((float(weight) * factor for weight in p.operators.weight), p.operators.slip)
    return p._replace(operators=operators, bristle=friction_bristle.scaled(p.bristle, factor))


def stretched_friction(p: Friction, factor: float) -> Friction:
    """The same friction with a rolling zone longer by `factor`."""
    operators = friction.bundle(p.operators.weight, (float(slip) * factor for slip in p.operators.slip))
    return p._replace(operators=operators, bristle=friction_bristle.scaled(p.bristle, 1.0, factor))


def stiffness(p: Friction) -> float:
    """Stiffness at rest (N m/rad | N/m), before anything slips."""
    pairs = zip(p.operators.weight, p.operators.rate, strict=True)
    return float(sum(a * r for a, r in pairs)) + (p.bristle.stiffness if p.bristle.coulomb > 0.0 else 0.0)


def longest_slip(p: Friction) -> float:
    """Displacement (rad | m) over which the last element that carries slips; of any where there is no friction."""
    bristle = p.bristle.coulomb / p.bristle.stiffness if p.bristle.coulomb else 0.0
    elements = [(float(slip), weight > 0.0) for slip, weight in zip(p.operators.slip, p.operators.weight, strict=True)]
    loaded = [slip for slip, carries in elements if carries]
    return max([*loaded, bristle]) or max((slip for slip, _ in elements), default=1.0)


def steps_that_hold(p: Stage, dt: float, least: int) -> int:
    """Integration steps of a period `dt` (s): `least`, or as many as the friction's stiffness needs."""
    turn = math.sqrt(stiffness(p.friction) / transmission.rubbed_inertia(p.mechanics)) * dt
    return min(max(least, math.ceil(turn / STICKING_ANGLE)), MOST_STEPS)


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
def _coefficients(p: Mechanics, current_lag: float, h: float) -> _Coefficients:
    half = 0.5 * h
    lag, lag_mean = 0.0, 0.0
    if current_lag > 0.0:
        lag, lag_mean = effects.decayed(half / current_lag)
    damped, mean = effects.decayed(p.viscous * half / p.inertia)
    return _Coefficients(h, lag, lag_mean, damped, half / p.inertia * mean)


@kernel
def steps(p: Stage, dt: float, substeps: int) -> Steps:
    """`substeps` of `dt` (s)."""
    plain = drive_effects.neutral(p.drive) and plant_with_effects.smooth(p.motor) and transmission.neutral(p.mechanics)
    return Steps(
        dt,
        substeps,
        plain and friction_effects.neutral(p.friction) and p.residual.coordinate == effects.NONE,
        _coefficients(p.mechanics, p.drive.current_lag, dt / substeps),
        plant_with_effects.steps(p, dt, substeps),
    )


@kernel
def _plain(p: Stage, x: State, target: float, extra: float, c: _Coefficients, substeps: int) -> State:
    """Kick, drift, kick (velocity Verlet), exact in current loop and viscous part.

    Second order while Stribeck is neutral; with it first, as its factor takes the velocity of half a step before.  The
    loop keeps its few numbers apart: a whole State handed on at every step costs more than the step.
    """
    current, position, velocity, force, bristle = x.current, x.position, x.velocity, x.force, x.bristle
    constant, bias, stops = p.motor.force_constant, p.mechanics.bias, x.stops
    bristled = p.friction.bristle.coulomb != 0.0
    for _ in range(substeps):
        error = current - target
        effort = constant * (target + error * c.lag_mean + extra) + bias
        half_way = c.damping * velocity + c.gain * (effort - force)
        dx = c.h * half_way
        force = friction.stops(p.friction.operators, stops, dx, friction.stribeck(p.friction.stribeck, half_way))
        if bristled:
            carried, bristle = friction_bristle.bent(p.friction.bristle, bristle, half_way, dx, c.h)
            force += carried
        error *= c.lag
        effort = constant * (target + error * c.lag_mean + extra) + bias
        velocity = c.damping * half_way + c.gain * (effort - force)
        current = target + error * c.lag
        position += dx
    return State(x.commands, x.latched, current, position, velocity, force, stops, bristle, x.memory)


@kernel
def commanded(p: Drive, x: State, command: float) -> State:
    """Drive, once a period: `command` (A) enters the delay line; the one that leaves it acts from now on."""
    commands = pushed(x.commands, rounded(p, command))
    memory = x.memory
    if p.dead_time > 0.0 or p.jitter > 0.0 or p.telemetry.late > 0.0:
        memory = _noted(memory, x.current)
    return State(commands, x.latched, x.current, x.position, x.velocity, x.force, x.stops, x.bristle, memory)


@kernel
def _noted(m: Memory, current: float) -> Memory:
    """When the command came, and the motor current (A) at that time."""
    return Memory(
        m.time, pushed(m.begun, m.time), m.acting, current, m.heat, m.load, m.load_velocity, m.base, m.base_velocity,
        m.lagged, m.rested, m.cable, m.turned, m.furthest, m.direction, m.rate, m.behind, m.stops,
    )  # fmt: skip


@kernel
def drifted(p: Stage, x: State, noise: Noise, dt: float, substeps: int) -> State:
    """The plant `dt` (s) later, under the command that acts."""
    return stepped(p, x, noise, steps(p, dt, substeps))


@kernel
def stepped(p: Stage, x: State, noise: Noise, c: Steps) -> State:
    """`drifted`, with what holds at all steps known beforehand."""
    if not c.plain:  # asked once a period, not at every step: neutral costs nothing
        return plant_with_effects.drifted(p, x, noise, c.dt, c.with_effects)
    return _plain(p, x, delivered(p.drive, x.commands), noise.current, c.without_effects, c.number)


@kernel
def seen(p: Stage, x: State) -> float:
    """Position (rad | m) that the encoder sees at this instant."""
    return plant_with_effects.seen(p.encoder, p.mechanics.pitch, x.position)


@kernel
def latched(p: Stage, x: State) -> State:
    """Encoder, once a period: the position it sees now enters the measurement's delay line."""
    line = pushed(x.latched, seen(p, x))
    return State(x.commands, line, x.current, x.position, x.velocity, x.force, x.stops, x.bristle, x.memory)


@kernel
def period(p: Stage, x: State, command: float, noise: Noise, dt: float, substeps: int) -> State:
    """Advance the plant by one control period `dt` (s) under a held `command` (A)."""
    return period_of(p, x, command, noise, steps(p, dt, substeps))


@kernel
def period_of(p: Stage, x: State, command: float, noise: Noise, c: Steps) -> State:
    """`period`, with what holds at all steps known beforehand: in a loop over many."""
    return latched(p, stepped(p, commanded(p.drive, x, command), noise, c))


@kernel
def reported(p: Drive, x: State, dt: float) -> float:
    """Motor current as the drive reports it (A), in control periods of `dt` (s)."""
    ends = (x.memory.before, x.current)
    if p.telemetry.late == 0.0 or p.dead_time == 0.0:
        return drive_effects.reported(p, ends, (0.0, 0.0), dt)
    command, at = drive_effects.replaced(p, x.commands, dt)
    old = drive_effects.limited(p, command, drive_effects.folded(p, x.memory.heat), x.velocity)
    return drive_effects.reported(p, ends, (old, at), dt)


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
