"""What the deployed controller does at rest: a small error is left alone, and what rest took is given up afterwards.

Written from the law's description, not from its code.  Friction holds the axis at rest; the feedback may take a part of
that load over.  The next motion loads the friction again, so the integrator gives the part up over the way.
"""

import math
from typing import NamedTuple

from stagectl_studies.machine.jit import compiled


class Rest(NamedTuple):
    """Rules at rest; zeros switch them off, bit for bit."""

    band: float = 0.0  # rad, error that is left alone
    against: float = 0.0  # A per rad/s and row, given up by a motion against the sign of what springs gave
    along: float = 0.0  # A per rad/s and row, by one along it, as the share that `span` still is
    span: float = 0.0  # A, the most that friction can have changed
    bristle: float = 0.0  # A per rad/s and row, of a bristle that has just turned
    slides: float = 0.0  # A, the force at which it slides
    exponent: float = 1.0  # of its law
    stiffness: float = 0.0  # A/rad, of the springs
    blind: float = 0.0  # rad, way that the encoder does not show


class Held(NamedTuple):
    """What is known of the last rest."""

    carried: float  # A, when it moved last
    springs: float  # A, taken from springs since
    sign: float  # of that motion
    creep: float  # A, taken from the bristle since
    lacking: float  # share that the bristle, as laid out, lacked of sliding at the end of that motion
    least: float  # rad, errors since
    largest: float  # rad


NOTHING = Held(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)


@compiled
def left_alone(p: Rest, error: float, speed: float) -> float:
    """The error that the feedback sees, at this speed of the reference."""
    band = p.band if speed == 0.0 else 0.0
    return max(error - band, 0.0) + min(error + band, 0.0)


@compiled
def given_up(p: Rest, held: Held, speed: float, friction: float) -> tuple[float, Held]:
    """Change of the integrator in this row, A, and what is known after it; none where no `friction` is fed forward."""
    if speed == 0.0 or friction == 0.0 or p.span == 0.0:
        return 0.0, held
    sign = 1.0 if speed > 0.0 else -1.0
    springs = _springs(p, held.springs, sign, abs(speed))
    creep, lacking = 0.0, held.lacking
    if p.slides > 0.0:
        wanted = lacking if sign * held.sign >= 0.0 else 2.0 - lacking
        path = 0.5 * p.bristle * abs(speed) / p.slides
        lacking = _nearer(wanted, p.exponent, path)
        if held.creep != 0.0:
            creep = sign * p.slides * (lacking - _nearer(wanted - sign * held.creep / p.slides, p.exponent, path))
    change = springs + (creep - held.creep)
    return change, Held(held.carried, held.springs + springs, sign, creep, lacking, held.least, held.largest)


@compiled
def _springs(p: Rest, taken: float, sign: float, speed: float) -> float:
    """Change of what was taken from springs, A."""
    if taken == 0.0:
        return 0.0
    if taken * sign > 0.0:
        return -taken * (1.0 - math.exp(-p.along * speed / p.span))
    most = p.against * speed
    return max(-taken, -most) if taken > 0.0 else min(-taken, most)


@compiled
def _nearer(lacking: float, exponent: float, path: float) -> float:
    """Share that is lacking of sliding after a `path`: it falls by its own power."""
    size = abs(lacking)
    if exponent == 1.0 or size == 0.0:
        return lacking * math.exp(-path) if exponent == 1.0 else 0.0
    left: float = size ** (1.0 - exponent) - (1.0 - exponent) * path
    return math.copysign(left ** (1.0 / (1.0 - exponent)), lacking) if left > 0.0 else 0.0


@compiled
def remembered(p: Rest, held: Held, speed: float, error: float, carried: float) -> Held:
    """What is known in the next row; `carried` are the proportional and the integral term, A."""
    if speed != 0.0:
        sign = 1.0 if speed > 0.0 else -1.0
        return Held(carried, held.springs, sign, held.creep, held.lacking, error, error)
    least, largest = min(held.least, error), max(held.largest, error)
    taken = max(min((carried - held.carried) * held.sign, 0.0), -p.span)
    springs = max(taken, -p.stiffness * (largest - least + p.blind))
    sign = held.sign
    return Held(held.carried, sign * springs, sign, sign * (taken - springs), held.lacking, least, largest)
