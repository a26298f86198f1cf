"""What changes the friction's limit: age of the contact, load, place, temperature, side of the motion.

All of it is one factor on what may slip, never below 0: the force of what sticks stays, so nothing jumps, and a stop
operator between any two limits that enclose 0 takes energy or stores it, however the limits move::

        -factor (1 - asymmetry) <= s <= factor (1 + asymmetry)

        factor = stribeck (1 + rise ln(1 + t_d / time)) p(x) (1 + lead) (1 + ball pass) warming step + mu |effort| / T_c

Source of the dwell: the ageing law ``dt_d/dt = 1 - t_d |v_slip| / length`` of J. H. Dieterich, J. Geophysical Research
84, 1979; what slips of a move is taken as its share ``F / (T_c factor)`` in the direction of the force, as in Dahl's
law, and the length is that of the dwell, or the mean slip of the friction's own elements.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from stagectl.kernels import effects, friction, friction_bristle
from stagectl.kernels.constants import LEAST_FORCE, LEAST_LIMIT
from stagectl.kernels.jit import kernel
from stagectl.kernels.plant import Along, Contact, Dwell, Friction


class Held(NamedTuple):
    """What holds at every step; without the arrays, which cost a count of references wherever they go."""

    h: float  # s, integration step
    learns: float  # share of the velocity's change that Stribeck's factor takes in one step
    coulomb: float  # N m | N, all that can slip
    length: float  # rad | m, mean slip
    wiping: float  # rad | m, slip that wipes the contact's age
    stribeck: friction.Stribeck  # of the operators
    bristle: friction_bristle.Bristle
    asymmetry: float
    dwell: Dwell
    load: float


class Limits(NamedTuple):
    """Between what the friction may slip, as factors on its elements."""

    low: float
    high: float
    bristle: float  # without asymmetry
    lagged: float  # rad/s | m/s


@kernel
def neutral(p: Friction) -> bool:
    """Whether nothing here changes the friction."""
    still = p.lag == 0.0 and p.asymmetry == 0.0 and p.dwell.rise == 0.0 and p.load == 0.0
    along = p.along.slope == 0.0 and p.along.bow == 0.0
    waves = p.lead.amplitude == 0.0 and p.lead_second.amplitude == 0.0 and p.ball_pass.amplitude == 0.0
    return still and along and waves and p.warming.rise == 0.0 and p.step.share == 0.0


@kernel
def held(p: Friction, h: float) -> Held:
    """For steps of `h` (s)."""
    coulomb, lengths = p.bristle.coulomb, p.bristle.coulomb * p.bristle.coulomb / p.bristle.stiffness
    for j in range(len(p.operators.weight)):
        coulomb += p.operators.weight[j]
        lengths += p.operators.weight[j] * p.operators.slip[j]
    learns = 1.0
    if p.lag > 0.0:
        learns = -math.expm1(-h / p.lag)
    length = lengths / coulomb if coulomb > 0.0 else 1.0
    wiping = p.dwell.length if p.dwell.length > 0.0 else length
    return Held(h, learns, coulomb, length, wiping, p.stribeck, p.bristle, p.asymmetry, p.dwell, p.load)


@kernel
def place_factor(
    along: Along,
    lead: effects.Harmonic,
    second: effects.Harmonic,
    balls: effects.Harmonic,
    place: tuple[float, float],
) -> float:
    """Factor of stroke, lead and balls at a `place` = (position in rad | m, its angle in the pitch in rad)."""
    position, angle = place
    factor = 1.0
    if along.slope != 0.0 or along.bow != 0.0:
        away = position - along.centre
        factor = max(1.0 + away * (along.slope + away * along.bow), 0.0)
    factor *= 1.0 + effects.wave(lead, angle) + effects.wave(second, angle)
    return factor * (1.0 + effects.wave(balls, angle))


@kernel
def limits(c: Held, x: Contact, velocity: float, place: float, effort: float) -> Limits:
    """At a velocity, with the factor of the `place` and the temperature there, under a motor effort (N m | N)."""
    lagged = velocity
    if c.learns < 1.0:
        lagged = x.lagged + c.learns * (velocity - x.lagged)
    factor, pressed = place, 0.0
    if c.dwell.rise != 0.0:
        factor *= 1.0 + c.dwell.rise * math.log1p(x.rested / c.dwell.time)
    if c.load != 0.0 and c.coulomb > 0.0:
        pressed = c.load * abs(effort) / c.coulomb
    limit = max(factor * friction.stribeck(c.stribeck, lagged) + pressed, 0.0)
    bristle = limit
    if c.bristle.coulomb != 0.0:
        bristle = max(factor * friction.stribeck(c.bristle.stribeck, lagged) + pressed, 0.0)
    return Limits(-limit * (1.0 - c.asymmetry), limit * (1.0 + c.asymmetry), bristle, lagged)


@kernel
def rubbed(
    c: Held,
    operators: friction.StopOperators,
    stops: Any,
    x: Contact,
    given: tuple[float, float, float, float],
) -> Contact:
    """A contact after a step: `given` are velocity, way, factor of the place and motor effort (N m | N).

    The states `stops` (n,) of its operators change in place.
    """
    velocity, dx, place, effort = given
    to = limits(c, x, velocity, place, effort)
    return slid(c, x, to, friction.stops_between(operators, stops, dx, to.low, to.high), dx)


@kernel
def slid(c: Held, x: Contact, to: Limits, force: float, dx: float) -> Contact:
    """After a move `dx` in which the operators have come to `force`: the bristle's part, and the contact's age."""
    bristle = x.bristle
    if c.bristle.coulomb != 0.0:
        carried, bristle = _bent(c, x.bristle, to.bristle, dx)
        force += carried
    rested = x.rested
    if c.dwell.rise != 0.0:
        rested = _aged(c, rested, dx, force / max(c.coulomb * to.bristle, LEAST_FORCE))
    return Contact(force, bristle, to.lagged, rested)


@kernel
def _bent(c: Held, z: float, limit: float, dx: float) -> tuple[float, float]:
    """Force and deflection of the bristle within +-`limit`, each side with its asymmetry."""
    if dx == 0.0:
        return c.bristle.stiffness * z, z
    side = 1.0 + c.asymmetry if dx > 0.0 else 1.0 - c.asymmetry
    return friction_bristle.within(c.bristle, z, c.bristle.coulomb * max(limit * side, LEAST_LIMIT), dx, c.h)


@kernel
def _aged(c: Held, rested: float, dx: float, share: float) -> float:
    """Age of the contact after a move `dx`, of which `share` slips where it has the force's sign; exact in the step."""
    slips = min(max(math.copysign(share, share * dx), 0.0), 1.0) * abs(dx) / c.wiping
    mean = effects.relaxed(slips)
    return rested * (1.0 - slips * mean) + c.h * mean
