"""What a standstill takes off the friction, and the next motion puts back.

::

    moving     carried = P + I                                 unloaded falls by rate |v|, and I with it
    at rest    unloaded = P + I - carried, within -range of the last motion's sense and 0        (A)

An axis that arrives too far is turned back by the feedback.  It stays within the friction's presliding, so this takes a
part of the load off the friction, and the integral holds it.  The next motion is laid out from friction that still
carries all of its load.  As the axis moves on, the friction is loaded again, within micrometres; an integral that only
gives way to the error is too slow for that, and the axis is dragged off its path.  So the integral gives up what it
took at rest, over the way in which the friction is loaded: a motion against the sign of what is held stretches it as a
spring, with its stiffness at rest; one along it reverses it, with the mean stiffness over presliding.

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
    along: float = 0.0  # A s/rad | A s/m, where it has the same sign
    range: float = 0.0  # A, from sliding one way to sliding the other


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
    held = x.unloaded
    rate = p.against if held * velocity < 0.0 else p.along
    change = min(abs(held), rate * abs(velocity))
    return -change if held > 0.0 else change


@kernel
def after(p: Unloading, x: State, velocity: float, change: float, carrying: float) -> State:
    """The memory after a period in which the integral changed by `change` (A); P + I is now `carrying` (A)."""
    if velocity != 0.0:
        return State(carrying, x.unloaded + change, math.copysign(1.0, velocity))
    along = (carrying - x.carried) * x.sense
    return State(x.carried, x.sense * max(min(along, 0.0), -p.range), x.sense)
