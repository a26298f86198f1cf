"""The inverse of the whole stage: the current that moves it along a known path.

::

    position, velocity, acceleration --> friction with its memory, cable, table, load, base --> effort --> current

Path and memory are those of `plant_with_effects`; here the motor's motion is given and the effort is sought.  The load
behind a spring and the base on its feet move freely under it: as the encoder sits at the motor, this inverse is stable
(the zeros of a collocated mechanism are damped).  The drive's lag and delay are no part of it: the caller looks ahead.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from stagectl.kernels import effects, friction, friction_effects, plant_with_effects, transmission
from stagectl.kernels.constants import TURN_SHARE
from stagectl.kernels.jit import kernel
from stagectl.kernels.plant import Contact, Memory, Stage, State
from stagectl.kernels.transmission import Bodies


class _Given(NamedTuple):
    """The motor's motion at one instant."""

    position: float  # rad | m
    velocity: float  # rad/s | m/s
    acceleration: float  # rad/s^2 | m/s^2


class _Opposed(NamedTuple):
    """What the motor works against, and what that remembers after the move."""

    friction: float  # N m | N, at the motor; viscous part and all, as if all of it were there
    behind: float  # N m | N, the same at the load
    pull: float  # N m | N, cable and table, less the bias
    contacts: tuple[Contact, Contact]  # of motor and load
    path: plant_with_effects.Path
    load: float  # rad | m


@kernel
def along(p: Stage, x: State, motion: Any, h: float, out: Any) -> State:
    """Fill `out` (n,) with the motor current (A) at each row of `motion` (n, 3); the state at its end.

    `motion` has position, velocity and acceleration of the motor in axis units, from the position of `x` on.  `h` is
    the time between its rows (s), short enough for the model (`transmission.finer`).
    """
    held = friction_effects.held(p.friction, h)
    for k in range(len(motion)):
        masses = transmission.coefficients(p.mechanics, x.memory.time, h)
        row = motion[k]
        given = _Given(row[0], row[1], row[2])
        opposed = _opposed(p, (masses, held), x, given)
        effort, bodies = _effort(masses, x.memory, given, opposed)
        motor = plant_with_effects.motoring(p.motor, effects.TURN / p.mechanics.pitch * given.position)
        out[k] = (effort - motor.cogging) / motor.constant - p.drive.offset
        x = _moved(x, h, out[k], opposed, bodies)
    return x


@kernel
def _moved(x: State, h: float, current: float, opposed: _Opposed, bodies: Bodies) -> State:
    """The state after a step of `h` (s)."""
    m, (c, behind), path = x.memory, opposed.contacts, opposed.path
    memory = Memory(
        m.time + h, m.begun, m.acting, x.current, m.heat, bodies.load, bodies.load_velocity, bodies.base,
        bodies.base_velocity, c.lagged, c.rested, path.cable, path.turned, path.furthest, path.direction,
        m.rate, behind, m.stops,
    )  # fmt: skip
    return State(x.commands, x.latched, current, bodies.position, bodies.velocity, c.force, x.stops, c.bristle, memory)


@kernel
def _opposed(
    p: Stage, held: tuple[transmission.Coefficients, friction_effects.Held], x: State, given: _Given
) -> _Opposed:
    """Friction, cable and table after the move to the `given` position."""
    masses, c = held
    m, h = x.memory, c.h
    load = m.load + h * m.load_velocity if masses.load > 0.0 else given.position
    place = effects.drifting(p.friction.warming, p.friction.step, m.time) * friction_effects.place_factor(
        p.friction.along,
        p.friction.lead,
        p.friction.lead_second,
        p.friction.ball_pass,
        (given.position, effects.TURN / p.mechanics.pitch * given.position),
    )
    driving = p.motor.force_constant * (2.0 * x.current - m.before)  # as it is now: the last two steps', continued
    contact, behind = Contact(x.force, x.bristle, m.lagged, m.rested), m.behind
    if masses.share < 1.0:
        v = given.velocity
        motion = (v, v - 0.5 * (v - x.velocity), given.position - x.position)
        contact = _rubbed(p, (c, x.stops), contact, motion, (place, driving))
    if masses.share > 0.0:
        v = m.load_velocity
        behind = _rubbed(p, (c, m.stops), behind, (v, v, load - m.load), (place, driving))
    path = plant_with_effects.Path(m.cable, m.turned, m.furthest, m.direction)
    path = plant_with_effects.pulled_along(path, p.mechanics.cable, load - m.load)
    bodies = Bodies(given.position, given.velocity, load, m.load_velocity, m.base, m.base_velocity)
    pull = transmission.pulled(p.mechanics, load, path.cable) - p.mechanics.bias
    code = p.residual.coordinate
    if code != effects.NONE:
        path = plant_with_effects.turning(path, given.position, TURN_SHARE * c.length)
        place = plant_with_effects.coordinate(code, p.mechanics.pitch, bodies, path, (x.current, m.time))
        pull += effects.looked_up(p.residual, place)
    drag = transmission.viscous(p.mechanics, masses, given.velocity) * given.velocity
    load_drag = transmission.viscous(p.mechanics, masses, m.load_velocity) * m.load_velocity
    return _Opposed(contact.force + drag, behind.force + load_drag, pull, (contact, behind), path, load)


@kernel
def _rubbed(
    p: Stage,
    held: tuple[friction_effects.Held, Any],
    x: Contact,
    motion: tuple[float, float, float],
    given: tuple[float, float],
) -> Contact:
    """A contact after the `motion` (velocity, mean velocity, way); see `friction_effects.rubbed`."""
    (c, stops), (place, driving) = held, given
    limits = _limits_now(c, x, motion, place, driving)
    force = friction.stops_between(p.friction.operators, stops, motion[2], limits.low, limits.high)
    return friction_effects.slid(c, x, limits, force, motion[2])


@kernel
def _limits_now(
    c: friction_effects.Held,
    x: Contact,
    motion: tuple[float, float, float],
    place: float,
    effort: float,
) -> friction_effects.Limits:
    """What may slip at the end of a step, of a contact `x` as it was at its beginning.

    `motion` has the velocity at the end, the mean one and the way.  The velocity that lags follows the mean one; the
    contact has become older or younger on the way.
    """
    velocity, mean, dx = motion
    if c.learns < 1.0:
        velocity = mean
    limits = friction_effects.limits(c, x, velocity, place, effort)
    if c.dwell.rise == 0.0:
        return limits
    aged = friction_effects.slid(c, x, limits, x.force, dx).rested
    now = Contact(x.force, x.bristle, x.lagged, aged)
    return friction_effects.limits(c, now, velocity, place, effort)


@kernel
def _effort(c: transmission.Coefficients, m: Memory, given: _Given, opposed: _Opposed) -> tuple[float, Bodies]:
    """Effort (N m | N) on the motor; load and base take their step.

    Accelerations are those of `transmission`: on the ground g = effort / inertia, the base takes the recoil of both.
    """
    mu, stiffness, damping = c.base
    feet = stiffness * m.base + damping * m.base_velocity
    spring, load_share, free = 0.0, 0.0, 0.0
    if c.load > 0.0:
        spring = transmission.transmitted(
            c, Bodies(given.position, given.velocity, opposed.load, m.load_velocity, m.base, m.base_velocity)
        )
        load_share = c.load / (c.motor + c.load)
        free = (spring - opposed.pull - c.share * opposed.behind) / c.load
    share = 1.0 + mu * (1.0 - load_share)
    # The base's velocity is half a step old, and the feet damp it as it is now: half a step of the recoil later.
    recoil = mu * (given.acceleration * (1.0 - load_share) + load_share * free) + feet
    recoil /= share + c.half * damping  # of the coordinate: less the base's acceleration
    ground = given.acceleration - recoil
    against = opposed.friction + opposed.pull if c.load == 0.0 else spring + (1.0 - c.share) * opposed.friction
    effort = c.motor * ground + against
    h = 2.0 * c.half
    base_velocity = m.base_velocity - h * recoil if mu > 0.0 else 0.0
    base = m.base + h * base_velocity
    load, load_velocity = given.position, given.velocity
    if c.load > 0.0:
        load_velocity = m.load_velocity + h * (free + recoil)
        load = opposed.load
    return effort, Bodies(given.position, given.velocity, load, load_velocity, base, base_velocity)
