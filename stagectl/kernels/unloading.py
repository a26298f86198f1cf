"""What a standstill takes off the friction, and the next motion puts back.

::

    moving     carried = P + I                                 unloaded falls with the way, and I with it
    at rest    unloaded = P + I - carried, within -range of the last motion's sense and 0        (A)

An axis that arrives too far is turned back by the feedback.  It stays within the friction's presliding, so this takes a
part of the load off the friction, and the integral holds it.  Noise that shakes a standing axis does the same.  The
next motion is laid out from friction that still carries all of its load.  As the axis moves on, the friction is loaded
again, within micrometres; an integral that only gives way to the error is too slow for that, and the axis is dragged
off its path.  So the integral gives up what it took at rest, over the way in which the friction is loaded.

A motion against the sign of what is held goes on as before the rest.  It stretches stop operators as a spring, with
their stiffness at rest; a bristle approaches sliding without end: ``du/ds = -u stiffness / Tc``.  One along it is a
reversal, and the friction is on the reversal's curve F already, as if it had moved on by d: what is held is
``u = F(s + d) - F(s)``, which falls as the curve's slope does.  The slope is taken to fall exponentially, from what it
is right after a full reversal, and so that the whole curve rises by the range: ``du/ds = -u F'(0) / range``.  For a
bristle of Dahl's law with exponent 1 this is exact.

A motion leaves the friction loaded against it, so a standstill can only change the current against the sense of the
last motion, and by no more than friction has from sliding one way to sliding the other.  A change the other way is a
load that was put on, and stays; so does what the feedback carried before the axis came to rest, such as a weight.
Where no friction is fed forward, nothing was laid out that this would put right, and `law.step` gives nothing up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.kernels.jit import kernel


class Unloading(NamedTuple):
    """How fast the integral gives up what it took at rest, per period and reference velocity."""

    against: float = 0.0  # A s/rad | A s/m, where the motion is against the sign of what is held
    along: float = 0.0  # A s/rad | A s/m, where it has the same sign, if all of the range is held; less is slower
    range: float = 0.0  # A, from sliding one way to sliding the other
    bristle: float = 0.0  # as `along`, of a bristle where the motion is against the sign of what is held


class State(NamedTuple):
    """What the feedback carries."""

    carried: float  # A, when the reference moved last
    unloaded: float  # A, by which friction may have changed that at rest
    sense: float  # +1 or -1, of that motion; 0: the reference has not moved yet


ABSENT = Unloading()
AT_REST = State(0.0, 0.0, 0.0)


@kernel
def given_up(p: Unloading, x: State, velocity: float) -> float:
    """Change of the integral (A) in this period, at this reference velocity (rad/s | m/s); it shrinks what is held."""
    size, speed = abs(x.unloaded), abs(velocity)
    if size == 0.0 or p.range == 0.0:
        return 0.0
    along = x.unloaded * velocity > 0.0
    left = size * math.exp(-(p.along if along else p.bristle) * speed / p.range)
    if not along:
        left = max(left - p.against * speed, 0.0)
    return math.copysign(size - left, -x.unloaded)


@kernel
def after(p: Unloading, x: State, velocity: float, change: float, carrying: float) -> State:
    """The memory after a period in which the integral changed by `change` (A); P + I is now `carrying` (A)."""
    if velocity != 0.0:
        return State(carrying, x.unloaded + change, math.copysign(1.0, velocity))
    along = (carrying - x.carried) * x.sense
    return State(x.carried, x.sense * max(min(along, 0.0), -p.range), x.sense)
