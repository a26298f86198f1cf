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
    against: float = 0.0  # A per rad/s and row, given up by a motion against the sign of what was taken
    along: float = 0.0  # A per rad/s and row, by one along it, as the share that `span` still is
    span: float = 0.0  # A, the most that friction can have changed
    bristle: float = 0.0  # A per rad/s and row, further given up by a motion against it, as the share that `span` is


Held = tuple[float, float, float]  # A carried when it moved last, A taken at rest since, sign of that motion


@compiled
def left_alone(p: Rest, error: float, speed: float) -> float:
    """The error that the feedback sees, at this speed of the reference."""
    band = p.band if speed == 0.0 else 0.0
    return max(error - band, 0.0) + min(error + band, 0.0)


@compiled
def given_up(p: Rest, held: Held, speed: float) -> float:
    """Change of the integrator in this row, A."""
    taken = held[1]
    if taken == 0.0 or p.span == 0.0:
        return 0.0
    if taken * speed > 0.0:
        return -taken * (1.0 - math.exp(-p.along * abs(speed) / p.span))
    change = -taken * (1.0 - math.exp(-p.bristle * abs(speed) / p.span))
    most = p.against * abs(speed)
    return max(-taken, change - most) if taken > 0.0 else min(-taken, change + most)


@compiled
def remembered(p: Rest, held: Held, speed: float, change: float, carried: float) -> Held:
    """What is known in the next row; `carried` are the proportional and the integral term, A."""
    if speed > 0.0:
        return carried, held[1] + change, 1.0
    if speed < 0.0:
        return carried, held[1] + change, -1.0
    taken = (carried - held[0]) * held[2]
    return held[0], held[2] * max(min(taken, 0.0), -p.span), held[2]
