"""What a standstill takes off the friction, and the next motion puts back.

::

    moving     carried = P + I                                 unloaded falls with the way, and I with it
    at rest    unloaded = P + I - carried, within -range of the last motion's sense and 0        (A)

An axis that arrives too far is turned back by the feedback.  It stays within the friction's presliding, so this takes a
part of the load off the friction, and the integral holds it.  Noise that shakes a standing axis does the same.  The
next motion is laid out from friction that still carries all of its load.  As the axis moves on, the friction is loaded
again, within micrometres; an integral that only gives way to the error is too slow for that, and the axis is dragged
off its path.  So the integral gives up what it took at rest, over the way in which the friction is loaded.

What was taken is loaded again by the law that took it.  **Springs**, stop operators that stick, have given up no more
than their stiffness times the way on which the axis was seen at rest.  A motion against the sign of what is held goes
on as before the rest and stretches them again, with that stiffness.  One along it is a reversal, and they are on the
reversal's curve F already, as if it had moved on by d: what is held is ``u = F(s + d) - F(s)``, which falls as the
curve's slope does; the slope is taken to fall exponentially, from what it is right after a full reversal, and so that
the whole curve rises by the range: ``du/ds = -u F'(0) / range``.

What a rest takes beyond that is **creep**: a bristle gives up a little with each to and fro, without end.  It is
followed twice, as it was laid out and as it is.  The share w that is left to sliding obeys ``dw/ds = -w^n stiffness /
Tc`` for both (`kernels.friction_bristle`), and what is held is ``u = Tc (w - w')``.  A model without a bristle does
not foresee creep; where the machine shows it, it is loaded again as that of Dahl's law with the same curve.

A motion leaves the friction loaded against it, so a standstill can only change the current against the sense of the
last motion, and by no more than friction has from sliding one way to sliding the other.  A change the other way is a
load that was put on, and stays; so does what the feedback carried before the axis came to rest, such as a weight.
Where no friction is fed forward, nothing was laid out that this would put right, and `law.step` gives nothing up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.kernels import friction_bristle
from stagectl.kernels.jit import kernel


class Unloading(NamedTuple):
    """How fast the integral gives up what it took at rest, per period and reference velocity."""

    against: float = 0.0  # A s/rad | A s/m, of stop operators, where the motion is against the sign of what is held
    along: float = 0.0  # A s/rad | A s/m, where it has the same sign, if all of their range is held; less is slower
    range: float = 0.0  # A, of all friction, from sliding one way to sliding the other
    bristle: float = 0.0  # A s/rad | A s/m, of the bristle right after a full reversal, with an exponent of 1
    coulomb: float = 0.0  # A, the bristle's part of sliding one way
    exponent: float = 1.0  # of the bristle
    stiffness: float = 0.0  # A/rad | A/m, of the stop operators at rest
    unseen: float = 0.0  # rad | m, way that the encoder does not show


class State(NamedTuple):
    """What the feedback carries."""

    carried: float  # A, when the reference moved last
    unloaded: float  # A, by which stop operators may have changed that at rest
    sense: float  # +1 or -1, of that motion; 0: the reference has not moved yet
    bristle: float = 0.0  # A, by which the bristle may have
    left: float = 1.0  # share of its friction at speed that the bristle, as laid out, lacked then; not for exponent 1
    low: float = 0.0  # rad | m, least error since then
    high: float = 0.0  # rad | m, largest


ABSENT = Unloading()
AT_REST = State(0.0, 0.0, 0.0)


@kernel
def given_up(p: Unloading, x: State, velocity: float) -> tuple[float, State]:
    """Change of the integral (A) in this period, at this reference velocity (rad/s | m/s), and what is held then."""
    nothing = x.unloaded == 0.0 and x.bristle == 0.0 and p.exponent == 1.0
    if nothing or velocity == 0.0 or p.range == 0.0:
        return 0.0, x
    change = _stops(p, x.unloaded, velocity)
    bristle, left = x.bristle, x.left
    if p.coulomb > 0.0:
        bristle, left = _bristle(p, x, velocity)
    after = State(x.carried, x.unloaded + change, math.copysign(1.0, velocity), bristle, left, x.low, x.high)
    return change + (bristle - x.bristle), after


@kernel
def _stops(p: Unloading, unloaded: float, velocity: float) -> float:
    """Change (A) of what stop operators hold."""
    size, speed = abs(unloaded), abs(velocity)
    if size == 0.0:
        return 0.0
    if unloaded * velocity > 0.0:
        left = size * math.exp(-p.along * speed / p.range)
    else:
        left = max(size - p.against * speed, 0.0)
    return math.copysign(size - left, -unloaded)


@kernel
def _bristle(p: Unloading, x: State, velocity: float) -> tuple[float, float]:
    """What the bristle holds (A) after this period, and what it lacks as it was laid out.

    With an exponent of 1 that does not matter: the difference of the two falls as they do.
    """
    move = 0.5 * p.bristle * abs(velocity) / p.coulomb
    if p.exponent == 1.0:
        return x.bristle * math.exp(-move), x.left
    way = math.copysign(1.0, velocity)
    laid_out = x.left if way * x.sense >= 0.0 else 2.0 - x.left
    left = friction_bristle.left_after(laid_out, p.exponent, move)
    if x.bristle == 0.0:
        return 0.0, left
    is_left = friction_bristle.left_after(laid_out - way * x.bristle / p.coulomb, p.exponent, move)
    return way * p.coulomb * (left - is_left), left


@kernel
def after(p: Unloading, x: State, velocity: float, error: float, carrying: float) -> State:
    """The memory after a period that left `x`, with its `error` (rad | m); P + I came to `carrying` (A)."""
    if velocity != 0.0:
        return State(carrying, x.unloaded, math.copysign(1.0, velocity), x.bristle, x.left, error, error)
    low, high = min(x.low, error), max(x.high, error)
    taken = max(min((carrying - x.carried) * x.sense, 0.0), -p.range)
    springs = max(taken, -p.stiffness * (high - low + p.unseen))
    return State(x.carried, x.sense * springs, x.sense, x.sense * (taken - springs), x.left, low, high)
