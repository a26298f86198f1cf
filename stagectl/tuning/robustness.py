"""Robustness of a sampled loop: margins both ways, sensitivity, bandwidth, step and stiffness.

A loop is cut where its controller's current enters the plant, or, in a cascade, at one of its two errors::

    PID                 L = P C                        P: zero-order hold, current loop, inertia, nd + nm periods
    cascade, whole      L = P (W + V)                  W = Kp PI F    from the position error to the current
    its velocity loop   L = P V                        V = d PI F     from the measured velocity to the current
    its position loop   L = P W / (1 + P V)            the velocity loop closed

Sensitivity ``S = 1/(1 + L)``, complementary sensitivity ``T = L/(1 + L)``, peaks Ms and Mt; 1/Ms is the modulus margin,
the smallest distance of the Nyquist plot from -1.  Both gain margins are given: a loop with two integrators and lag
from the plant's damping is conditionally stable, so its gain may neither rise nor fall without end.

Source: S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed., 2005, section 2.4 (margins, peaks,
bandwidths).
"""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar
from scipy.signal import lfilter

from stagectl import design
from stagectl.design import Rational
from stagectl.kernels import cascade, feedback, observer, stage
from stagectl.tuning.constants import FAINTEST, LOWEST, POINTS

Array = NDArray[np.float64]
NOTHING = Rational(np.zeros(1), np.ones(1))


class Loop(NamedTuple):
    """``L = P cut / (1 + P closed)``: `cut` is the path that is open, `closed` the one that stays closed."""

    plant: Rational
    cut: Rational
    closed: Rational
    dt: float  # s

    def at(self, frequency: Any) -> Any:
        """L at `frequency` (Hz), a number or (n,)."""
        z = np.exp(2j * np.pi * np.asarray(frequency) * self.dt)
        plant = self.plant.at(z)
        path = plant * self.cut.at(z)
        return path if self.closed is NOTHING else path / (1.0 + plant * self.closed.at(z))


class Peak(NamedTuple):
    """The largest value of a gain, and where."""

    value: float
    frequency: float  # Hz


class Robustness(NamedTuple):
    """Margins and peaks of one loop."""

    stable: bool
    phase: float  # rad, phase margin; inf where the gain never passes 1
    crossover: float  # Hz, where the phase margin is; 0 where there is none
    delay: float  # s, further delay before it is unstable
    raised: Peak  # the gain may rise by less than this factor: (inf, 0) where it may without end
    lowered: Peak  # and fall by more than this one: (0, 0) where it may without end
    sensitivity: Peak  # Ms
    complementary: Peak  # Mt

    @property
    def modulus(self) -> float:
        """Smallest distance of the Nyquist plot from -1."""
        return 1.0 / self.sensitivity.value


def loops(
    p: stage.Stage, designed: design.Feedback, dt: float, watching: observer.Observer = observer.ABSENT
) -> dict[str, Loop]:
    """The loop cut at the current first, then those of a cascade cut at its two errors; `watching` stays closed."""
    plant, whole = design.plant(p, dt), design.with_observer(design.compensator(designed, dt), watching)
    if isinstance(designed, feedback.Gains):
        return {"loop": Loop(plant, whole, NOTHING, dt)}
    inner, outer = _parts(designed, whole, watching)
    return {
        "whole loop": Loop(plant, whole, NOTHING, dt),
        "velocity loop": Loop(*_differenced(plant, inner), NOTHING, dt),
        "position loop": Loop(plant, outer, inner, dt),
    }


def following(
    p: stage.Stage, designed: design.Feedback, dt: float, watching: observer.Observer = observer.ABSENT
) -> Loop:
    """From the target to the measured position in closed loop; a cascade's velocity feedforward is not in it."""
    alone = design.compensator(designed, dt)
    whole = design.with_observer(alone, watching)
    if isinstance(designed, feedback.Gains):
        seen = design.with_observer(Rational(np.zeros(1), alone.denominator), watching)
        target_path = Rational(np.polysub(whole.numerator, seen.numerator), whole.denominator)
    else:
        target_path = _parts(designed, whole, watching)[1]
    return Loop(design.plant(p, dt), target_path, whole, dt)


def _parts(designed: cascade.Cascade, whole: Rational, watching: observer.Observer) -> tuple[Rational, Rational]:
    """Both paths of a cascade to the current: V from the measured velocity, W from the position error."""
    inner = design.with_observer(design.compensator(designed._replace(position=0.0), designed.dt), watching)
    return inner, Rational(np.polysub(whole.numerator, inner.numerator), whole.denominator)


def _differenced(plant: Rational, inner: Rational) -> tuple[Rational, Rational]:
    """Plant and path of the velocity loop: the difference cancels the integrator from velocity to position."""
    integrator = np.array([1.0, 0.0])
    velocity = Rational(plant.numerator, np.polydiv(plant.denominator, integrator)[0])
    return velocity, Rational(np.polydiv(inner.numerator, integrator)[0], inner.denominator)


@functools.lru_cache(maxsize=1)
def grid(dt: float) -> Array:
    """Frequencies (POINTS,) Hz up to Nyquist's, between which particular points are refined."""
    return np.geomspace(LOWEST / dt, 0.5 / dt, POINTS)


def robustness(loop: Loop) -> Robustness:
    """Margins and peaks of the loop, each refined between the frequencies of the grid."""
    values = loop.at(grid(loop.dt))
    crossings = _crossings(loop, values)
    crossover, phase = _worst(crossings)
    delay = min((angle % (2.0 * math.pi) / (2.0 * math.pi * f) for f, angle in crossings), default=math.inf)
    raised, lowered = _gain_margins(loop, values)
    complementary = _peak(loop, lambda value: np.abs(value / (1.0 + value)), values)
    return Robustness(stable(loop), phase, crossover, delay, raised, lowered, _sensitivity(loop, values), complementary)


def essence(loop: Loop) -> tuple[float, float]:
    """Phase margin (rad) and Ms alone, for a search."""
    values = loop.at(grid(loop.dt))
    return _worst(_crossings(loop, values))[1], _sensitivity(loop, values).value


def _roots(loop: Loop, function: Callable[[Any], float], values: NDArray[Any]) -> list[float]:
    """Frequencies (Hz) at which a `function` of L changes its sign; `values` (n,) are its own along the curve."""
    at, f = loop.at, grid(loop.dt)
    changes = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    return [float(brentq(lambda x: function(at(x)), f[k], f[k + 1], xtol=1e-14, rtol=1e-13)) for k in changes]


def _crossings(loop: Loop, values: NDArray[Any]) -> list[tuple[float, float]]:
    """Where |L| passes 1: (Hz, phase above -180 deg in rad)."""
    unity = _roots(loop, lambda value: math.log(abs(value)), np.log(np.abs(values)))
    return [(f, float(np.angle(-loop.at(f)))) for f in unity]


def _worst(crossings: list[tuple[float, float]]) -> tuple[float, float]:
    return min(crossings, key=lambda pair: pair[1], default=(0.0, math.inf))


def _sensitivity(loop: Loop, values: NDArray[Any]) -> Peak:
    return _peak(loop, lambda value: 1.0 / np.abs(1.0 + value), values)


def _gain_margins(loop: Loop, values: NDArray[Any]) -> tuple[Peak, Peak]:
    """Factors on the gain at which a closed-loop pole meets the unit circle: where L is negative and real."""
    last = float(grid(loop.dt)[-1])  # Nyquist's frequency: L is real there, but for rounding
    frequencies = [*_roots(loop, lambda value: float(value.imag), values.imag[:-1]), last]
    values_there = [(f, complex(loop.at(f))) for f in frequencies]
    factors = [Peak(1.0 / abs(value), f) for f, value in values_there if value.real < 0.0]
    raised = min((factor for factor in factors if factor.value > 1.0), default=Peak(math.inf, 0.0))
    lowered = max((factor for factor in factors if FAINTEST < factor.value < 1.0), default=Peak(0.0, 0.0))
    return raised, lowered


def _peak(loop: Loop, gain: Callable[[Any], Any], values: NDArray[Any]) -> Peak:
    """Largest `gain` of the complex `values` (n,) along the curve, refined around the highest of them."""
    sizes, f = gain(values), grid(loop.dt)
    k = int(np.argmax(sizes))
    lowest = _lowest(lambda x: -float(gain(loop.at(x))), f, k)
    return Peak(float(sizes[k]), float(f[k])) if -lowest.value < sizes[k] else lowest._replace(value=-lowest.value)


def _lowest(function: Callable[[float], float], f: Array, k: int) -> Peak:
    """The lowest value of a `function` of the frequency between the neighbours of the k-th of `f` (n,) Hz."""
    bounds = (math.log(f[max(k - 1, 0)]), math.log(f[min(k + 1, len(f) - 1)]))
    minimum = minimize_scalar(lambda x: function(math.exp(x)), bounds=bounds, options={"xatol": 1e-9})
    return Peak(float(minimum.fun), math.exp(float(minimum.x)))


def stable(loop: Loop) -> bool:
    """Whether all poles of the closed loop lie inside the unit circle."""
    return design.settles(characteristic(loop))


def characteristic(loop: Loop) -> NDArray[Any]:
    """``dP dcut dclosed + nP (ncut dclosed + nclosed dcut)``, without a denominator that both paths share."""
    shared = np.array_equal(loop.cut.denominator, loop.closed.denominator)
    closed: NDArray[Any] = np.ones(1) if shared else loop.closed.denominator
    cut: NDArray[Any] = np.ones(1) if shared else loop.cut.denominator
    paths = np.polyadd(np.polymul(loop.cut.numerator, closed), np.polymul(loop.closed.numerator, cut))
    poles: NDArray[Any] = np.polymul(loop.plant.denominator, np.polymul(loop.cut.denominator, closed))
    polynomial: NDArray[Any] = np.polyadd(poles, np.polymul(loop.plant.numerator, paths))
    return polynomial


def bandwidth(response: Loop) -> float:
    """Frequency (Hz) at which the response from target to position first falls below -3 dB; inf if it never does."""
    return _passes(lambda f: math.sqrt(0.5) - np.abs(response.at(f)), grid(response.dt))


def attenuated(loop: Loop) -> float:
    """Frequency (Hz) up to which disturbances are attenuated by 3 dB or more: |S| first rises above -3 dB."""
    return _passes(lambda f: np.abs(1.0 / (1.0 + loop.at(f))) - math.sqrt(0.5), grid(loop.dt))


def _passes(function: Callable[[Any], Any], frequency: Array) -> float:
    """The first frequency (Hz) at which `function` becomes positive."""
    above = np.flatnonzero(function(frequency) > 0.0)
    if not above.size or above[0] == 0:
        return float(frequency[0]) if above.size else math.inf
    k = int(above[0])
    return float(brentq(lambda f: float(function(f)), frequency[k - 1], frequency[k], rtol=1e-13))


def stepped(response: Loop, length: int) -> Array:
    """Measured position (length,) for a step of the target by 1 at the first sample."""
    numerator = _in_z(np.polymul(response.plant.numerator, response.cut.numerator))
    # The target's path and the feedback share their denominator, so the closed loop's poles are those of the feedback.
    poles = _in_z(characteristic(Loop(response.plant, response.closed, NOTHING, response.dt)))
    late = np.concatenate([np.zeros(len(poles) - len(numerator)), numerator])
    position: Array = lfilter(late / poles[0], poles / poles[0], np.ones(length))
    return position


def _in_z(polynomial: NDArray[Any]) -> NDArray[Any]:
    """Coefficients of a polynomial in ``w = z - 1`` by powers of z."""
    return np.asarray(np.poly1d(polynomial)(np.poly1d([1.0, -1.0])).coeffs)


def stiffness(p: stage.Stage, loop: Loop, frequency: Any) -> Any:
    """Dynamic stiffness ``|1 + L| / |Pm|`` (N m/rad | N/m) at `frequency` (Hz): effort on the axis per deflection.

    Pm is the mechanics alone under an effort that is held over each period; friction is not in it.
    """
    bare = p._replace(
        drive=p.drive._replace(current_lag=0.0, delay_samples=0), encoder=p.encoder._replace(delay_samples=0)
    )
    z = np.exp(2j * np.pi * np.asarray(frequency) * loop.dt)
    pushed = design.plant(bare, loop.dt).at(z) / p.motor.force_constant
    return np.abs(1.0 + loop.at(frequency)) / np.abs(pushed)


def softest(p: stage.Stage, loop: Loop) -> Peak:
    """The smallest dynamic stiffness (N m/rad | N/m), and where."""
    f = grid(loop.dt)
    return _lowest(lambda x: float(stiffness(p, loop, x)), f, int(np.argmin(stiffness(p, loop, f))))
