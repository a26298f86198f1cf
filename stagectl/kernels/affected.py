"""The plant with effects at work: the same kick, drift, kick as in `stage`, with all that section 4 of the design adds.

What changes slowly (temperature, the drive's heat) is taken once a drift, what the position and the velocity decide at
every step.  A stage without effects never comes here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.kernels import drive_effects, effects, friction_effects, transmission
from stagectl.kernels.jit import kernel
from stagectl.kernels.plant import Memory, Motor, Noise, Stage, State
from stagectl.kernels.transmission import Bodies


class Path(NamedTuple):
    """What remembers the way: the cable's element and the last turn."""

    cable: float  # in [-1, 1]
    turned: float  # rad | m, last reversal
    furthest: float  # rad | m, since then
    direction: float  # -1, 0 before any motion, 1


class Motoring(NamedTuple):
    """From current to effort at one position."""

    constant: float  # N m/A | N/A
    cogging: float  # N m | N


@kernel
def neutral(p: Stage) -> bool:
    """Whether no effect acts on the motion."""
    motor = p.motor.cogging.amplitude == 0.0 and p.motor.cogging_second.amplitude == 0.0
    ripple = p.motor.ripple.amplitude == 0.0 and p.motor.ripple_second.amplitude == 0.0
    blocks = transmission.neutral(p.mechanics) and friction_effects.neutral(p.friction)
    return drive_effects.neutral(p.drive) and motor and ripple and blocks and p.residual.coordinate == effects.NONE


@kernel
def motoring(p: Motor, angle: float) -> Motoring:
    """Force constant with its ripple, and cogging, at an angle in the pitch (rad)."""
    ripple = effects.wave(p.ripple, angle) + effects.wave(p.ripple_second, angle)
    return Motoring(
        p.force_constant * (1.0 + ripple), effects.wave(p.cogging, angle) + effects.wave(p.cogging_second, angle)
    )


@kernel
def coordinate(p: Stage, x: Bodies, path: Path, current: float, time: float) -> float:
    """Where the residual table is entered."""
    code = p.residual.coordinate
    if code == effects.VELOCITY:
        return x.velocity
    if code == effects.SINCE_REVERSAL:
        return x.position - path.turned
    if code == effects.POSITION:
        return x.position
    if code == effects.POSITION_MOD_PITCH:
        return x.position - p.mechanics.pitch * math.floor(x.position / p.mechanics.pitch)
    if code == effects.CURRENT:
        return current
    return time if code == effects.TIME else abs(x.velocity)


@kernel
def turning(path: Path, position: float, back: float) -> tuple[float, float, float]:
    """Last turn, furthest position since and direction; a turn counts once the way back exceeds `back` (rad | m)."""
    ahead = position - path.furthest
    if path.direction == 0.0:
        if abs(ahead) > back:
            return path.turned, position, math.copysign(1.0, ahead)
    elif ahead * path.direction >= 0.0:
        return path.turned, position, path.direction
    elif abs(ahead) > back:
        return path.furthest, position, -path.direction
    return path.turned, path.furthest, path.direction


@kernel
def followed(p: Stage, path: Path, x: Bodies, dx: float, back: float) -> Path:
    """The path after a move `dx` of the load."""
    cable = min(max(path.cable + dx / p.mechanics.cable.slip, -1.0), 1.0)
    if p.residual.coordinate != effects.SINCE_REVERSAL:
        return Path(cable, path.turned, path.furthest, path.direction)
    turned, furthest, direction = turning(path, x.position, back)
    return Path(cable, turned, furthest, direction)


@kernel
def opposing(p: Stage, x: Bodies, path: Path, current: float, time: float) -> float:
    """Effort of cable and residual table, against the motor."""
    found = transmission.pulled(p.mechanics.cable, x.load, path.cable)
    if p.residual.coordinate != effects.NONE:
        found += effects.looked_up(p.residual, coordinate(p, x, path, current, time))
    return found


@kernel
def drifted(p: Stage, x: State, noise: Noise, dt: float, substeps: int) -> State:
    """The plant `dt` (s) later, under the commands that act."""
    m = x.memory
    steps = substeps * transmission.finer(p.mechanics, dt / substeps)
    h = dt / steps
    c = transmission.coefficients(p.mechanics, m.time, h)
    holds = friction_effects.held(p.friction, m.time, h)
    decay, mean = _lag(p.drive.current_lag, 0.5 * h)
    limit = drive_effects.folded(p.drive, m.heat)
    delay = (p.drive.delay_samples, max(p.drive.dead_time + noise.delay, 0.0))
    turn = effects.TURN / p.mechanics.pitch
    bodies = Bodies(x.position, x.velocity, m.load, m.load_velocity, m.base, m.base_velocity)
    contact = friction_effects.Contact(x.force, x.bristle, m.lagged, m.rested)
    path = Path(m.cable, m.turned, m.furthest, m.direction)
    current, begun, time = x.current, m.acting, m.time
    motor = motoring(p.motor, turn * x.position)
    against = opposing(p, bodies, path, current, time)
    for k in range(steps):
        time = m.time + k * h
        target = drive_effects.meant(delay, x.commands, m.begun, (time, time + h), begun)
        _, begun = drive_effects.acting(delay, x.commands, m.begun, time + h, begun)
        target = drive_effects.limited(p.drive, target, limit, bodies.velocity)
        error = current - target
        driving = motor.constant * (target + error * mean + noise.current)
        pulling = p.mechanics.bias - against
        bodies = transmission.kicked(p.mechanics, c, bodies, (driving + motor.cogging, pulling, contact.force))
        before = bodies
        bodies = transmission.moved(c, bodies)
        angle = turn * bodies.position
        motor = motoring(p.motor, angle)
        error *= decay
        driving = motor.constant * (target + error * mean + noise.current)
        current = target + error * decay
        velocity = bodies.velocity + c.share * (bodies.load_velocity - bodies.velocity)
        factor = friction_effects.place_factor(p.friction, bodies.position, angle)
        contact = friction_effects.slid(
            p.friction, holds, x.stops, contact, (2.0 * c.half * velocity, velocity, factor, driving)
        )
        path = followed(p, path, bodies, bodies.load - before.load, 0.1 * holds.length)
        against = opposing(p, bodies, path, current, time + h)
        pulling = p.mechanics.bias - against
        bodies = transmission.kicked(p.mechanics, c, bodies, (driving + motor.cogging, pulling, contact.force))
    memory = Memory(
        m.time + dt,
        m.begun,
        begun,
        m.before,
        drive_effects.heated(p.drive, m.heat, current, dt),
        bodies.load,
        bodies.load_velocity,
        bodies.base,
        bodies.base_velocity,
        contact.lagged,
        contact.rested,
        path.cable,
        path.turned,
        path.furthest,
        path.direction,
    )
    return State(
        x.commands,
        x.latched,
        current,
        bodies.position,
        bodies.velocity,
        contact.force,
        x.stops,
        contact.bristle,
        memory,
    )


@kernel
def _lag(lag: float, half: float) -> tuple[float, float]:
    """Decay of the current error over `half` a step, and its mean."""
    if lag == 0.0:
        return 0.0, 0.0
    return math.exp(-half / lag), effects.relaxed(half / lag)


@kernel
def seen(p: Stage, position: float) -> float:
    """Position with the errors of the encoder's grating (rad | m)."""
    if p.encoder.eccentricity.amplitude == 0.0 and p.encoder.interpolation.amplitude == 0.0:
        return position
    angle = effects.TURN / p.mechanics.pitch * position
    return position + effects.wave(p.encoder.eccentricity, angle) + effects.wave(p.encoder.interpolation, angle)
