r"""Friction around the zero crossing of the velocity, as a force along the reference, computed before the motion.

On the way to a standstill friction rises from its constant value ``C`` to ``Cs`` at the crossing; behind it, it
goes on from ``Cs``, which now assists the motion, to the constant value of the new direction::

    F  C1 ______----- Cs                 t <= tz:   F =  C1 + (Cs - C1) rise
                     |\                  t >  tz:   F = -C2 + (Cs + C2) decay
                     | \____
       -C2 ..........|......--------     continuous, not symmetric about zero speed
                     tz            t

    exponential   rise exp(-(tz - t) / t1)   decay exp(-(t - tz) / t2)            the paper's
    gaussian      the same                   decay exp(-((t - tz) / t2)^2)
    displacement  F = way [C + (Cs - C) exp(-|v| / vs)] [1 - 2 exp(-|x - xz| / delta)]
    symmetric     +-[C + (Cs - C) exp(-|t - tz| / t1)]   jumps at tz              Tustin, Stribeck: the baseline

At constant acceleration ``|x - xz|`` is quadratic in time and ``|v|`` linear, so there the displacement form and the
gaussian one look alike; with another acceleration only the displacement form still holds.  The viscous part is
*not* inside: it belongs to the plant, as ``M a`` does.

A leg begins with the force ``F0`` at which the last one ended.  In time, and over the displacement::

    F = way [C + (Cs - C) rise] + (F0 - way [C + (Cs - C) rise at its beginning]) decay
    F = way [C + (Cs - C) exp(-|v| / vs)] s,   s = way + (s0 - way) exp(-|x - xz| / (delta |s0 - way| / 2))

so a standstill keeps the force, a leg in the same direction continues it, a tail that reaches the next crossing stays
continuous, and a start from rest begins at zero.

Source: the friction paper of the linear slider, sections 3.1 and 3.2.  The available text lacks its equations; these
are a reconstruction from its description (continuous, exponential, three parameters t1, t2, Cs).
"""

from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np

from stagectl.compensation.constants import SMALLEST
from stagectl.compensation.legs import Array, Legs
from stagectl.units import Quantity

_TIME, _FORCE = "(0, 1e3]", "[0, 1e6]"
_STATIC = Quantity("N m | N", _FORCE, "friction at zero velocity, Cs")
_POSITIVE = Quantity("N m | N", _FORCE, "constant friction at positive velocity, C1")
_NEGATIVE = Quantity("N m | N", _FORCE, "constant friction at negative velocity, C2; a positive number")
_BEFORE = Quantity("s", _TIME, "time constant of the rise towards the crossing, t1")
_AFTER = Quantity("s", _TIME, "time constant of the decay behind the crossing, t2")


class Exponential(NamedTuple):
    """The paper's form: exponentials in time on both sides of the crossing."""

    before: Annotated[float, _BEFORE]
    after: Annotated[float, _AFTER]
    static: Annotated[float, _STATIC]
    positive: Annotated[float, _POSITIVE]
    negative: Annotated[float, _NEGATIVE]

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known."""
        return _in_time(cut, self, lambda t: np.exp(-t / self.after))


class Gaussian(NamedTuple):
    """Exponential towards the crossing, gaussian behind it: friction is a spring before it slides."""

    before: Annotated[float, _BEFORE]
    after: Annotated[float, _AFTER]
    static: Annotated[float, _STATIC]
    positive: Annotated[float, _POSITIVE]
    negative: Annotated[float, _NEGATIVE]

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known."""
        return _in_time(cut, self, lambda t: np.exp(-((t / self.after) ** 2)))


class Displacement(NamedTuple):
    """Stribeck's rise over the speed and a decay over the displacement: no time inside, so any acceleration.

    A leg that begins with less than a full reversal, as from rest, decays over proportionally less displacement
    (Masing's rule: the stiffness after a turn is always the same).
    """

    velocity: Annotated[float, Quantity("rad/s | m/s", "(0, 1e4]", "speed over which the rise decays, vs")]
    slip: Annotated[float, Quantity("rad | m", "(0, 1e3]", "displacement over which a reversal decays, delta")]
    static: Annotated[float, _STATIC]
    positive: Annotated[float, _POSITIVE]
    negative: Annotated[float, _NEGATIVE]

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known."""
        constant = _constant(self, cut)[cut.leg]
        size = constant + (self.static - constant) * np.exp(-cut.speed / self.velocity)
        return np.asarray(size * _stretch(cut, self.slip), dtype=np.float64)


class Symmetric(NamedTuple):
    """Tustin's curve with Stribeck's rise, over time: symmetric about the crossing, and jumps there."""

    before: Annotated[float, Quantity("s", _TIME, "time constant on both sides of the crossing, t1")]
    static: Annotated[float, _STATIC]
    positive: Annotated[float, _POSITIVE]
    negative: Annotated[float, _NEGATIVE]

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known; a standstill holds the last value."""
        way, constant = cut.way[cut.leg], _constant(self, cut)[cut.leg]
        near = np.exp(-np.minimum(cut.since, cut.until) / self.before)
        return np.asarray(way * (constant + (self.static - constant) * near), dtype=np.float64)


Form = Exponential | Gaussian | Displacement | Symmetric

FORMS: dict[str, type[Form]] = {
    "exponential": Exponential,
    "gaussian": Gaussian,
    "displacement": Displacement,
    "symmetric": Symmetric,
}


def _constant(p: Form, cut: Legs) -> Array:
    """C1 or C2 (m,) N m | N for the direction of each leg; 0 at rest."""
    return np.where(cut.way > 0.0, p.positive, np.where(cut.way < 0.0, p.negative, 0.0))


def _in_time(cut: Legs, p: Exponential | Gaussian, decay: Callable[[Array], Array]) -> Array:
    """Friction along all legs: the rise to the next crossing, and `decay` of the time since the last."""
    rise, first = np.exp(-cut.until / p.before), np.exp(-cut.duration / p.before)
    constant = _constant(p, cut)
    top = cut.way * (constant + (p.static - constant) * first)
    jump = _jumps(cut, p, top, decay(cut.duration))
    way, level, gap = cut.way[cut.leg], constant[cut.leg], jump[cut.leg]
    tail = gap * decay(cut.since)
    # In the same direction the tail adds to the rise: both together end at Cs, not beyond.
    tail *= np.where(gap * way > 0.0, (1.0 - rise) / np.maximum(1.0 - first[cut.leg], SMALLEST), 1.0)
    steady = level + np.where(way == 0.0, 0.0, p.static - level) * rise
    return np.asarray(way * steady + tail, dtype=np.float64)


def _jumps(cut: Legs, p: Exponential | Gaussian, top: Array, remaining: Array) -> Array:
    """Force (m,) N m | N by which each leg begins off its curve; the share `remaining` of it is left at its end."""
    jump = np.zeros(len(top))
    held = 0.0  # after assembly, and at the start of every reference
    for j in range(1, len(top)):
        jump[j] = 0.0 if np.isinf(cut.start[j]) else held - top[j]
        against = jump[j] * cut.way[j] < 0.0
        held = float(cut.way[j] * p.static + (jump[j] * remaining[j] if against else 0.0))
    return jump


def _stretch(cut: Legs, slip: float) -> Array:
    """State (n,) in [-1, 1] of a spring that yields exponentially over `slip` (rad | m): -way, then +way."""
    jump, share = np.zeros(len(cut.way)), np.ones(len(cut.way))
    held = 0.0
    for j in range(1, len(cut.way)):
        jump[j] = 0.0 if np.isinf(cut.start[j]) else held - cut.way[j]
        share[j] = max(0.5 * abs(jump[j]), SMALLEST)
        held = float(cut.way[j] + jump[j] * np.exp(-cut.length[j] / (slip * share[j])))
    decay = np.exp(-cut.covered / (slip * share[cut.leg]))
    return np.asarray(cut.way[cut.leg] + jump[cut.leg] * decay, dtype=np.float64)
