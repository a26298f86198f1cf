"""What changes the friction's limit: age of the contact, load, place, temperature, side of the motion.

All of it is one factor on what may slip, never below 0: the force of what sticks stays, so nothing jumps, and a stop
operator between any two limits that enclose 0 takes energy or stores it, however the limits move::

        -factor (1 - asymmetry) <= s <= factor (1 + asymmetry)

        factor = stribeck (1 + rise ln(1 + t_d / time)) p(x) (1 + lead) (1 + ball pass) warming step + mu |effort| / T_c

Source of the dwell: the ageing law ``dt_d/dt = 1 - t_d |v_slip| / length`` of J. H. Dieterich, J. Geophysical Research
84, 1979; what slips of a move is taken as its share ``F / (T_c factor)`` in the direction of the force, as in Dahl's
law, and the length is the mean slip of the friction's own elements.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from stagectl.kernels import effects, friction, friction_bristle
from stagectl.kernels.jit import kernel
from stagectl.units import Quantity

if TYPE_CHECKING:
    from stagectl.kernels.plant import Friction

_LEAST = 1e-9  # share of the bristle's limit that is always left: it divides by it


class Dwell(NamedTuple):
    """Ageing of the contact at rest: a factor ``1 + rise ln(1 + t_d / time)``, wiped by slip."""

    rise: Annotated[float, Quantity("", "[0, 10]", "rise per e-fold of the time at rest; 0 is neutral")] = 0.0
    time: Annotated[float, Quantity("s", "(0, 1e6]", "time at rest from which it grows")] = 0.1


class Along(NamedTuple):
    """A factor over the stroke, ``1 + slope (x - centre) + bow (x - centre)^2``, never below 0."""

    slope: Annotated[float, Quantity("1/rad | 1/m", "[-1e6, 1e6]", "linear part; 0 is neutral")] = 0.0
    bow: Annotated[float, Quantity("1/rad^2 | 1/m^2", "[-1e9, 1e9]", "quadratic part; 0 is neutral")] = 0.0
    centre: Annotated[float, Quantity("rad | m", "[-1e6, 1e6]", "where the factor is 1")] = 0.0


class Held(NamedTuple):
    """What holds during one drift."""

    h: float  # s, integration step
    drift: float  # factor of warming and step
    learns: float  # share of the velocity's change that Stribeck's factor takes in one step
    coulomb: float  # N m | N, all that can slip
    length: float  # rad | m, mean slip


class Contact(NamedTuple):
    """The friction at one instant."""

    force: float  # N m | N
    bristle: float  # rad | m
    lagged: float  # rad/s | m/s
    rested: float  # s


@kernel
def neutral(p: Friction) -> bool:
    """Whether nothing here changes the friction."""
    still = p.lag == 0.0 and p.asymmetry == 0.0 and p.dwell.rise == 0.0 and p.load == 0.0
    along = p.along.slope == 0.0 and p.along.bow == 0.0 and p.lead.amplitude == 0.0 and p.ball_pass.amplitude == 0.0
    return still and along and p.warming.rise == 0.0 and p.step.share == 0.0


@kernel
def held(p: Friction, time: float, h: float) -> Held:
    """At the session clock `time` (s), for steps of `h` (s)."""
    coulomb, lengths = p.bristle.coulomb, p.bristle.coulomb * p.bristle.coulomb / p.bristle.stiffness
    for j in range(len(p.operators.weight)):
        coulomb += p.operators.weight[j]
        lengths += p.operators.weight[j] * p.operators.slip[j]
    learns = 1.0
    if p.lag > 0.0:
        learns = -math.expm1(-h / p.lag)
    length = lengths / coulomb if coulomb > 0.0 else 1.0
    return Held(h, effects.drifting(p.warming, p.step, time), learns, coulomb, length)


@kernel
def place_factor(p: Friction, position: float, angle: float) -> float:
    """Factor of stroke, lead and balls at a position (rad | m) and its angle in the pitch (rad)."""
    factor = 1.0
    if p.along.slope != 0.0 or p.along.bow != 0.0:
        away = position - p.along.centre
        factor = max(1.0 + away * (p.along.slope + away * p.along.bow), 0.0)
    factor *= 1.0 + effects.wave(p.lead, angle)
    return factor * (1.0 + effects.wave(p.ball_pass, angle))


@kernel
def slid(p: Friction, c: Held, s: Any, x: Contact, move: tuple[float, float, float, float]) -> Contact:
    """After a `move` = (dx, velocity, factor of the place, motor effort); the operators `s` change **in place**."""
    dx, velocity, place, effort = move
    lagged = x.lagged + c.learns * (velocity - x.lagged)
    if p.lag == 0.0:
        lagged = velocity
    factor, pressed = c.drift * place, 0.0
    if p.dwell.rise != 0.0:
        factor *= 1.0 + p.dwell.rise * math.log1p(x.rested / p.dwell.time)
    if p.load != 0.0 and c.coulomb > 0.0:
        pressed = p.load * abs(effort) / c.coulomb
    limit = max(factor * friction.stribeck(p.stribeck, lagged) + pressed, 0.0)
    force = friction.stops_between(p.operators, s, dx, -limit * (1.0 - p.asymmetry), limit * (1.0 + p.asymmetry))
    bristle = x.bristle
    if p.bristle.coulomb != 0.0 and dx != 0.0:
        limit = max(factor * friction.stribeck(p.bristle.stribeck, lagged) + pressed, _LEAST)
        holds = p.bristle.coulomb * limit * (1.0 + p.asymmetry * math.copysign(1.0 - _LEAST, dx))
        carried, bristle = friction_bristle.within(p.bristle, bristle, holds, dx, c.h)
        force += carried
    elif p.bristle.coulomb != 0.0:
        force += p.bristle.stiffness * bristle
    rested = x.rested
    if p.dwell.rise != 0.0:
        rested = _aged(c, rested, dx, force / max(c.coulomb * limit, 1e-300))
    return Contact(force, bristle, lagged, rested)


@kernel
def _aged(c: Held, rested: float, dx: float, share: float) -> float:
    """Age of the contact after a move `dx`, of which `share` slips where it has the force's sign; exact in the step."""
    slips = min(max(math.copysign(share, share * dx), 0.0), 1.0) * abs(dx) / c.length
    mean = effects.relaxed(slips)
    return rested * (1.0 - slips * mean) + c.h * mean
