r"""Friction around the zero crossing of the velocity, as a force over the reference, laid out before the motion.

On the way to a standstill friction rises from its constant value ``C`` to ``Cs`` at the crossing; behind it, it
goes on from ``Cs``, which now assists the motion, to the constant value of the new direction::

    F  C1 ______----- Cs                 t <= tz:   F =  C1 + (Cs - C1) rise
                     |\                  t >  tz:   F = -C2 + (Cs + C2) decay
                     | \____
       -C2 ..........|......--------     continuous, not symmetric about zero speed
                     tz            t

    exponential   rise exp(-(tz - t) / t1)   decay exp(-(t - tz) / t2)            the paper's
    gaussian      the same                   decay exp(-((t - tz) / t2)^2)
    displacement  rise exp(-|v| / vs)        decay exp(-|x - xz| / delta)         constant part C + (Cs - C) rise
    symmetric     +-[C + (Cs - C) exp(-|t - tz| / t1)]   jumps at tz              Tustin, Stribeck: the baseline

At constant acceleration ``|x - xz|`` is quadratic in time and ``|v|`` linear, so there the displacement form and the
gaussian one look alike; with another acceleration only the displacement form still holds.  The viscous part is
*not* inside: it belongs to the plant, as ``M a`` does.

One recursion serves all continuous forms.  A leg begins with the force ``F0`` at which the last one ended::

    F = way [C + (Cs - C) rise] + (F0 - way [C + (Cs - C) rise at its beginning]) decay

so a standstill holds the force, going on in the same direction does not start anew, a tail that meets the next
crossing stays continuous, and a start from rest begins at zero.

Source: the friction paper of the linear slider, sections 3.1 and 3.2; its equations are missing from the text that
we have, these are a reconstruction from its description (continuous, exponential, three parameters t1, t2, Cs).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np

from stagectl.compensation.legs import Array, Legs, legs
from stagectl.units import Quantity

_TIME, _FORCE = "(0, 1e3]", "[0, 1e6]"
_STATIC = Quantity("N m | N", _FORCE, "friction at zero velocity, Cs")
_POSITIVE = Quantity("N m | N", _FORCE, "constant friction at positive velocity, C1")
_NEGATIVE = Quantity("N m | N", _FORCE, "constant friction at negative velocity, C2; a positive number")
_BEFORE = Quantity("s", _TIME, "time constant of the rise towards the crossing, t1")
_AFTER = Quantity("s", _TIME, "time constant of the decay behind the crossing, t2")
_SMALLEST = 1e-3  # share of a full reversal: below, the slip would shrink to nothing

Decay = Callable[[Array, Array, Array], Array]  # of times, distances and shares of a full reversal


class Level(NamedTuple):
    """The three forces that all forms have in common (N m | N)."""

    static: float
    positive: float
    negative: float

    def constant(self, way: Array) -> Array:
        """C1 or C2 for each direction; 0 at rest."""
        return np.where(way > 0.0, self.positive, np.where(way < 0.0, self.negative, 0.0))


class Exponential(NamedTuple):
    """The paper's form: exponentials in time on both sides of the crossing."""

    before: Annotated[float, _BEFORE]
    after: Annotated[float, _AFTER]
    static: Annotated[float, _STATIC]
    positive: Annotated[float, _POSITIVE]
    negative: Annotated[float, _NEGATIVE]

    def force(self, position: Array, velocity: Array, dt: float) -> Array:
        """Friction (n,) N m | N along a reference sampled every `dt` (s)."""
        return self.along(legs(position, velocity, dt))

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known."""
        rise, first = np.exp(-cut.until / self.before), np.exp(-cut.duration / self.before)
        return _continuous(cut, Level(*self[2:]), rise, first, lambda t, s, share: np.exp(-t / self.after))


class Gaussian(NamedTuple):
    """Exponential towards the crossing, gaussian behind it: friction is a spring before it slides."""

    before: Annotated[float, _BEFORE]
    after: Annotated[float, _AFTER]
    static: Annotated[float, _STATIC]
    positive: Annotated[float, _POSITIVE]
    negative: Annotated[float, _NEGATIVE]

    def force(self, position: Array, velocity: Array, dt: float) -> Array:
        """Friction (n,) N m | N along a reference sampled every `dt` (s)."""
        return self.along(legs(position, velocity, dt))

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known."""
        rise, first = np.exp(-cut.until / self.before), np.exp(-cut.duration / self.before)
        return _continuous(cut, Level(*self[2:]), rise, first, lambda t, s, share: np.exp(-((t / self.after) ** 2)))


class Displacement(NamedTuple):
    """Stribeck's rise over the speed and a decay over the displacement: no time inside, so any acceleration.

    A leg that has less than a full reversal ``2 Cs`` to make up for, as from rest, does so over proportionally less
    displacement (Masing's rule).
    """

    velocity: Annotated[float, Quantity("rad/s | m/s", "(0, 1e4]", "speed over which the rise decays, vs")]
    slip: Annotated[float, Quantity("rad | m", "(0, 1e3]", "displacement over which a reversal decays, delta")]
    static: Annotated[float, _STATIC]
    positive: Annotated[float, _POSITIVE]
    negative: Annotated[float, _NEGATIVE]

    def force(self, position: Array, velocity: Array, dt: float) -> Array:
        """Friction (n,) N m | N along a reference sampled every `dt` (s)."""
        return self.along(legs(position, velocity, dt))

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known."""
        rise = np.exp(-cut.speed / self.velocity)
        first = np.where(np.isinf(cut.start), 0.0, 1.0)  # a leg begins at zero speed, unless in motion
        return _continuous(cut, Level(*self[2:]), rise, first, lambda t, s, share: np.exp(-s / (self.slip * share)))


class Symmetric(NamedTuple):
    """Tustin's curve with Stribeck's rise, over time: symmetric about the crossing, and jumps there."""

    before: Annotated[float, Quantity("s", _TIME, "time constant on both sides of the crossing, t1")]
    static: Annotated[float, _STATIC]
    positive: Annotated[float, _POSITIVE]
    negative: Annotated[float, _NEGATIVE]

    def force(self, position: Array, velocity: Array, dt: float) -> Array:
        """Friction (n,) N m | N along a reference sampled every `dt` (s)."""
        return self.along(legs(position, velocity, dt))

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known; a standstill holds the last value."""
        way, constant = cut.way[cut.leg], Level(*self[1:]).constant(cut.way)[cut.leg]
        near = np.exp(-np.minimum(cut.since, cut.until) / self.before)
        return np.asarray(way * (constant + (self.static - constant) * near), dtype=np.float64)


Form = Exponential | Gaussian | Displacement | Symmetric

FORMS: dict[str, type[Form]] = {
    "exponential": Exponential,
    "gaussian": Gaussian,
    "displacement": Displacement,
    "symmetric": Symmetric,
}


def _continuous(cut: Legs, p: Level, rise: Array, first: Array, decay: Decay) -> Array:
    """Friction along all legs; `rise` (n,) at each row and `first` (m,) at each leg's beginning."""
    constant = p.constant(cut.way)
    top = cut.way * (constant + (p.static - constant) * first)
    jump, share = _jumps(cut, p, top, decay)
    way, level = cut.way[cut.leg], constant[cut.leg]
    tail = jump[cut.leg] * decay(cut.since, cut.covered, share[cut.leg])
    steady = level + np.where(way == 0.0, 0.0, p.static - level) * rise
    return np.asarray(way * steady + tail, dtype=np.float64)


def _jumps(cut: Legs, p: Level, top: Array, decay: Decay) -> tuple[Array, Array]:
    """What each leg (m,) has to make up for at its beginning (N m | N), and its share of a full reversal."""
    jump, share = np.zeros(len(top)), np.ones(len(top))
    held = 0.0  # after assembly, and at the start of every reference
    for j in range(1, len(top)):
        jump[j] = 0.0 if np.isinf(cut.start[j]) else held - top[j]
        share[j] = max(abs(jump[j]) / (2.0 * p.static), _SMALLEST) if p.static > 0.0 else 1.0
        left = decay(cut.duration[j : j + 1], cut.length[j : j + 1], share[j : j + 1])
        held = float(cut.way[j] * p.static + jump[j] * left[0])
    return jump, share
