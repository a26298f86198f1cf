"""The plant with effects at work: the same kick, drift, kick as in `stage`, with all that section 4 of the design adds.

What changes slowly (temperature, the drive's heat) is taken once a drift, what the position and the velocity decide at
every step.  A stage without effects never comes here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.kernels import drive_effects, effects, friction_bristle, friction_effects, transmission
from stagectl.kernels.constants import TURN_SHARE
from stagectl.kernels.jit import kernel
from stagectl.kernels.plant import Cable, Contact, Drive, Encoder, Line, Mechanics, Memory, Motor, Noise, Stage, State
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
def smooth(p: Motor) -> bool:
    """Whether the motor neither cogs nor ripples."""
    cogs = p.cogging.amplitude != 0.0 or p.cogging_second.amplitude != 0.0
    cogs = cogs or p.cogging_third.amplitude != 0.0 or p.cogging_fourth.amplitude != 0.0
    ripples = p.ripple.amplitude != 0.0 or p.ripple_second.amplitude != 0.0 or p.ripple_third.amplitude != 0.0
    return not (cogs or ripples)


@kernel
def motoring(p: Motor, angle: float) -> Motoring:
    """Force constant with its ripple, and cogging, at an angle in the pitch (rad)."""
    ripple = effects.wave(p.ripple, angle) + effects.wave(p.ripple_second, angle) + effects.wave(p.ripple_third, angle)
    cogging = effects.wave(p.cogging, angle) + effects.wave(p.cogging_second, angle)
    cogging += effects.wave(p.cogging_third, angle) + effects.wave(p.cogging_fourth, angle)
    return Motoring(p.force_constant * (1.0 + ripple), cogging)


@kernel
def coordinate(code: int, pitch: float, x: Bodies, path: Path, now: tuple[float, float]) -> float:
    """Where a residual table of this coordinate is entered; `now` is (motor current in A, session clock in s)."""
    if code == effects.VELOCITY:
        return x.velocity
    if code == effects.SINCE_REVERSAL:
        return x.position - path.turned
    if code == effects.POSITION:
        return x.position
    if code == effects.POSITION_MOD_PITCH:
        return x.position - pitch * math.floor(x.position / pitch)
    if code == effects.CURRENT:
        return now[0]
    return now[1] if code == effects.TIME else abs(x.velocity)


@kernel
def turning(path: Path, position: float, back: float) -> Path:
    """Last turn, furthest position since and direction; a turn counts once the way back exceeds `back` (rad | m)."""
    ahead = position - path.furthest
    if path.direction == 0.0:
        if abs(ahead) > back:
            return Path(path.cable, path.turned, position, math.copysign(1.0, ahead))
    elif ahead * path.direction >= 0.0:
        return Path(path.cable, path.turned, position, path.direction)
    elif abs(ahead) > back:
        return Path(path.cable, path.furthest, position, -path.direction)
    return path


@kernel
def rubbing(m: Memory, behind: Contact) -> Memory:
    """With another friction at the load."""
    return Memory(
        m.time, m.begun, m.acting, m.before, m.heat, m.load, m.load_velocity, m.base, m.base_velocity,
        m.lagged, m.rested, m.cable, m.turned, m.furthest, m.direction, m.rate, behind, m.stops,
    )  # fmt: skip


@kernel
def pulled_along(path: Path, p: Cable, dx: float) -> Path:
    """The cable after a move `dx` of the load; exact."""
    element = path.cable + dx / p.slip
    if p.exponent > 0.0:
        side = math.copysign(1.0, dx)
        left = 1.0 - side * path.cable
        element = side * (1.0 - friction_bristle.left_after(left, p.exponent, abs(dx) / p.slip))
    return Path(min(max(element, -1.0), 1.0), path.turned, path.furthest, path.direction)


@kernel
def driven(
    p: Drive, lines: tuple[Line, Line], delay: tuple[int, float], span: tuple[float, float], since: float
) -> tuple[float, float]:
    """Mean command (A) over a `span` (s), and when the one that acts at its end began."""
    if delay[1] == 0.0:
        return lines[0][delay[0]], since
    commands, begun = lines
    return drive_effects.meant(delay, commands, begun, span, since)


class Steps(NamedTuple):
    """What holds at all steps of one length."""

    number: int  # in a drift
    loop: drive_effects.Loop  # over half a step
    contact: friction_effects.Held


class _Kept(NamedTuple):
    """What holds during one drift."""

    drift: float  # factor of the friction's temperature
    limit: float  # A
    delay: tuple[int, float]  # nd, dead time in s
    extra: float  # A, noise
    turn: float  # rad of the pitch per rad | m
    masses: transmission.Coefficients


class _Moving(NamedTuple):
    """What changes at every step."""

    time: float  # s, session clock
    current: float  # A
    rate: float  # A/s
    acting: float  # s
    bodies: Bodies
    contact: Contact
    behind: Contact  # at the load
    path: Path


@kernel
def steps(p: Stage, dt: float, substeps: int) -> Steps:
    """`substeps` of a drift of `dt` (s), or as many as the fastest mode needs."""
    number = substeps * transmission.finer(p.mechanics, dt / substeps)
    h = dt / number
    return Steps(number, drive_effects.loop(p.drive, 0.5 * h), friction_effects.held(p.friction, h))


@kernel
def drifted(p: Stage, x: State, noise: Noise, dt: float, steps: Steps) -> State:
    """The plant `dt` (s) later, under the commands that act."""
    m, friction = x.memory, p.friction
    kept = _Kept(
        effects.drifting(friction.warming, friction.step, m.time),
        drive_effects.folded(p.drive, m.heat),
        (p.drive.delay_samples, max(p.drive.dead_time + noise.delay, 0.0)),
        noise.current,
        effects.TURN / p.mechanics.pitch,
        transmission.coefficients(p.mechanics, m.time, steps.contact.h),
    )
    bodies = Bodies(x.position, x.velocity, m.load, m.load_velocity, m.base, m.base_velocity)
    contact = Contact(x.force, x.bristle, m.lagged, m.rested)
    path = Path(m.cable, m.turned, m.furthest, m.direction)
    y = _stepped(p, (steps, kept), x, _Moving(m.time, x.current, m.rate, m.acting, bodies, contact, m.behind, path))
    heat = drive_effects.heated(p.drive, m.heat, y.current, dt)
    b, c, w = y.bodies, y.contact, y.path
    memory = Memory(
        m.time + dt, m.begun, y.acting, m.before, heat, b.load, b.load_velocity, b.base, b.base_velocity,
        c.lagged, c.rested, w.cable, w.turned, w.furthest, w.direction, y.rate, y.behind, m.stops,
    )  # fmt: skip
    return State(x.commands, x.latched, y.current, b.position, b.velocity, c.force, x.stops, c.bristle, memory)


@kernel
def _stepped(p: Stage, given: tuple[Steps, _Kept], x: State, y: _Moving) -> _Moving:
    """All steps of one drift: kick, drift, kick."""
    current, rate, acting, bodies, path, contact, behind = (
        y.current, y.rate, y.acting, y.bodies, y.path, y.contact, y.behind,
    )  # fmt: skip
    steps, c = given
    later, faster, mean = steps.loop
    held = steps.contact
    drive, mechanics, operators, stops, h = p.drive, p.mechanics, p.friction.operators, x.stops, held.h
    along, code = p.friction.along, p.residual.coordinate
    lead, second, balls = p.friction.lead, p.friction.lead_second, p.friction.ball_pass
    lines, motor, bias, back = (x.commands, x.memory.begun), p.motor, mechanics.bias, TURN_SHARE * held.length
    at = motoring(motor, c.turn * bodies.position)
    against = transmission.pulled(mechanics, bodies.load, path.cable)
    if code != effects.NONE:
        against += effects.looked_up(p.residual, coordinate(code, mechanics.pitch, bodies, path, (current, y.time)))
    for k in range(steps.number):
        time = y.time + k * h
        target, acting = driven(drive, lines, c.delay, (time, time + h), acting)
        target = drive_effects.limited(drive, target, c.limit, bodies.velocity)
        error = current - target
        driving = at.constant * (target + (error * mean[0] + rate * mean[1]) + c.extra)
        error, rate = error * later[0] + rate * later[1], error * faster[0] + rate * faster[1]
        kick = (driving + at.cogging, bias - against, contact.force, behind.force)
        bodies = transmission.kicked(mechanics, c.masses, bodies, kick)
        load, bodies = bodies.load, transmission.moved(c.masses, bodies)
        angle = c.turn * bodies.position
        at = motoring(motor, angle)
        driving = at.constant * (target + (error * mean[0] + rate * mean[1]) + c.extra)
        error, rate = error * later[0] + rate * later[1], error * faster[0] + rate * faster[1]
        current = target + error
        place = c.drift * friction_effects.place_factor(along, lead, second, balls, (bodies.position, angle))
        if c.masses.share < 1.0:
            v = bodies.velocity
            contact = friction_effects.rubbed(held, operators, stops, contact, (v, h * v, place, driving))
        if c.masses.share > 0.0:
            v = bodies.load_velocity
            behind = friction_effects.rubbed(held, operators, x.memory.stops, behind, (v, h * v, place, driving))
        path = pulled_along(path, mechanics.cable, bodies.load - load)
        against = transmission.pulled(mechanics, bodies.load, path.cable)
        if code != effects.NONE:
            path = turning(path, bodies.position, back)
            now = coordinate(code, mechanics.pitch, bodies, path, (current, time + h))
            against += effects.looked_up(p.residual, now)
        kick = (driving + at.cogging, bias - against, contact.force, behind.force)
        bodies = transmission.kicked(mechanics, c.masses, bodies, kick)
    return _Moving(y.time + steps.number * h, current, rate, acting, bodies, contact, behind, path)


@kernel
def opposing(p: Mechanics, x: State) -> float:
    """Friction of motor and load together, without its viscous part (N m | N)."""
    if not transmission.sprung(p):
        return x.force
    share = p.transmission.load_friction
    return (1.0 - share) * x.force + share * x.memory.behind.force


@kernel
def seen(p: Encoder, pitch: float, position: float) -> float:
    """Position with the errors of the encoder's grating (rad | m)."""
    fine = p.interpolation.amplitude != 0.0 or p.interpolation_second.amplitude != 0.0
    if p.eccentricity.amplitude == 0.0 and not fine:
        return position
    angle = effects.TURN / pitch * position
    within = effects.wave(p.interpolation, angle) + effects.wave(p.interpolation_second, angle)
    return position + effects.wave(p.eccentricity, angle) + within
