"""The loop as it runs, and how far it is from instability.

Tustin's PID or the cascade at the control period, the plant under zero-order hold with its current loop, nd + nm
whole periods of delay, and the disturbance observer where there is one.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.design.constants import FREQUENCIES, LOWEST, SHORTEST_LAG
from stagectl.design.control import Feedback, computable
from stagectl.kernels import cascade, feedback, observer, stage


class Margins(NamedTuple):
    """How far the loop is from instability."""

    phase: float  # rad, negative when unstable
    gain: float  # largest factor on the gain before it is unstable
    crossover: float  # Hz
    delay: float  # s, further delay before it is unstable
    stable: bool


def margins(p: stage.Stage, designed: Feedback, dt: float, watching: observer.Observer = observer.ABSENT) -> Margins:
    """Margins of the running loop at the period `dt` (s), cut at the plant's input; `watching` is its observer.

    Raises DesignError where the stage's numbers are too extreme to compute with.
    """
    with computable(p):
        return _margins(p, with_observer(compensator(designed, dt), watching), dt)


def _margins(p: stage.Stage, controller: Rational, dt: float) -> Margins:
    frequency = np.geomspace(LOWEST / dt, 0.5 / dt, FREQUENCIES)
    moved, z = plant(p, dt), np.exp(2j * np.pi * frequency * dt)
    loop = moved.at(z) * controller.at(z)
    phase = np.unwrap(np.angle(loop))
    phase -= 2.0 * np.pi * round((phase[0] + np.pi) / (2.0 * np.pi))  # starts near -180 deg: a double integrator
    stable = bool(np.max(np.abs(_poles(moved, controller))) < 1.0)
    crossover, margin = _phase_margin(frequency, np.log(np.abs(loop)), phase)
    gain = _gain_margin(np.abs(loop), phase)
    delay = margin / (2.0 * np.pi * crossover) if crossover > 0.0 else math.inf
    return Margins(margin, gain, crossover, delay, stable)


def limit_cycle_frequency(
    p: stage.Stage, designed: Feedback, dt: float, watching: observer.Observer = observer.ABSENT
) -> float | None:
    """Frequency (Hz) at which the loop oscillates on an axis that friction holds; None where it comes to rest.

    Until anything slips, friction is a spring of `stage.stiffness`, with the damping of a bristle.  An oscillation
    that grows in this linear loop is bounded by the elements that then slip: a limit cycle of about the shortest slip,
    for as long as there is power.  Simulated limit cycles begin at this bandwidth and have this frequency
    (tests/test_rest.py).
    """
    with computable(p):
        poles = _poles(plant(p, dt, held=True), with_observer(compensator(designed, dt), watching))
    worst = poles[np.argmax(np.abs(poles))]
    return float(abs(np.angle(worst))) / (2.0 * np.pi * dt) if abs(worst) >= 1.0 else None


def _sampled(p: stage.Stage, dt: float, held: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Plant with current loop, (position, velocity, current), sampled under zero-order hold; `held`: by friction."""
    lag = max(p.drive.current_lag, SHORTEST_LAG)
    spring, damping = (stage.stiffness(p.friction), p.friction.bristle.damping) if held else (0.0, 0.0)
    rates = -np.array([spring, p.mechanics.viscous + damping, -p.motor.force_constant]) / p.mechanics.inertia
    a = np.array([[0, 1, 0], rates, [0, 0, -1 / lag]])
    whole: NDArray[np.float64] = np.zeros((4, 4))
    whole[:3, :3], whole[2, 3] = a, 1 / lag
    from scipy.linalg import expm  # of a quarter of a second, which a command that designs nothing need not wait for

    stepped = expm(whole * dt)
    return stepped[:3, :3], stepped[:3, 3]


class Rational(NamedTuple):
    """A transfer function in z: coefficients, highest power first."""

    numerator: NDArray[np.floating[Any]]
    denominator: NDArray[np.floating[Any]]

    def at(self, z: NDArray[Any]) -> NDArray[Any]:
        """Its values at `z` (n,)."""
        values: NDArray[Any] = np.polyval(self.numerator, z) / np.polyval(self.denominator, z)
        return values


def compensator(designed: Feedback, dt: float) -> Rational:
    """From the position error to the current, as it runs at the period `dt` (s); a reference at rest."""
    if isinstance(designed, feedback.Gains):
        return _pid(feedback.discretised(designed, dt))
    return _cascade(designed)


def with_observer(controller: Rational, p: observer.Observer) -> Rational:
    """The controller together with a disturbance observer: ``(C + M) / (1 + U)``, see `observer.transfer`."""
    if not p.active:
        return controller
    poles, late = np.poly([p.pole] * 3), np.append(1.0, np.zeros(p.delay + 1))
    measured = p.disturbance * np.poly([0.0, 1.0, p.a22])
    current = -p.disturbance * np.polymul([p.b1, p.a12 * p.b2 - p.b1 * p.a22, 0.0], [p.share, 1.0 - p.share])
    numerator = np.polyadd(np.polymul(controller.numerator, poles), np.polymul(controller.denominator, measured))
    denominator = np.polymul(controller.denominator, np.polyadd(np.polymul(poles, late), current))
    return Rational(np.polymul(numerator, late), denominator)


def _pid(p: feedback.Pid) -> Rational:
    integrator, filtered = np.array([1.0, -1.0]), np.array([1.0, -p.decay])
    numerator = np.polyadd(
        p.proportional * np.polymul(integrator, filtered),
        np.polyadd(p.integral * np.polymul([1.0, 1.0], filtered), p.derivative * np.polymul(integrator, integrator)),
    )
    return Rational(numerator, np.polymul(integrator, filtered))


def _cascade(p: cascade.Cascade) -> Rational:
    """``(Kp + (1 - z^-span)/(span Ts)) (Kv + I (z + 1)/(z - 1)) (1 - c) z/(z - c)``, over z^span."""
    last = np.zeros(p.span + 1)
    last[0] = 1.0
    difference = (last - last[::-1]) / (p.span * p.dt)
    outer = p.position * last + difference
    inner, integrator = np.array([p.velocity + p.integral, p.integral - p.velocity]), np.array([1.0, -1.0])
    if p.integral == 0.0:  # no integrator: a pole and a zero at z = 1 would look like a pole that is not stable
        inner, integrator = np.array([p.velocity]), np.ones(1)
    numerator = np.polymul(np.polymul(outer, inner), [1.0 - p.retained, 0.0])
    return Rational(numerator, np.polymul(np.polymul(last, integrator), [1.0, -p.retained]))


def plant(p: stage.Stage, dt: float, held: bool = False) -> Rational:
    """From the command to the measured position: zero-order hold, current loop, inertia, nd + nm periods, dead time.

    The axis may be `held` by its rolling friction before it slips.
    """
    a, b = _sampled(p, dt, held)
    denominator = np.poly(a)
    whole, part = divmod(p.drive.dead_time, dt)
    states = [b, a @ b, a @ a @ b] if part == 0.0 else _within_a_period(a, b, _sampled(p, dt - part, held)[1])
    order = len(states)
    numerator = np.convolve([float(x[0]) for x in states], denominator)[:order]
    delays = np.zeros(order - 2 + p.drive.delay_samples + int(whole) + p.encoder.delay_samples)
    delays[0] = 1.0
    return Rational(numerator, np.polymul(denominator, delays))


def _within_a_period(a: NDArray[Any], b: NDArray[Any], begun: NDArray[Any]) -> list[NDArray[Any]]:
    """States after 1 to 4 periods of a command that acts from within a period on, in whose rest it does `begun`."""
    states = [begun, a @ begun + (b - begun)]
    for _ in range(2):
        states.append(a @ states[-1])
    return states


def _poles(moved: Rational, controller: Rational) -> NDArray[Any]:
    """Of the closed loop."""
    ways = np.polymul(moved.numerator, controller.numerator)
    return np.roots(np.polyadd(np.polymul(moved.denominator, controller.denominator), ways))


def _phase_margin(frequency: NDArray[Any], level: NDArray[Any], phase: NDArray[Any]) -> tuple[float, float]:
    """Smallest margin over all frequencies at which the loop's gain passes 1: (Hz, rad)."""
    crossings = [(0.0, math.inf)]
    for k in np.flatnonzero(np.diff(np.sign(level))):
        part = level[k] / (level[k] - level[k + 1])
        there = frequency[k] + part * (frequency[k + 1] - frequency[k])
        crossings.append((float(there), float(np.pi + phase[k] + part * (phase[k + 1] - phase[k]))))
    return min(crossings, key=lambda pair: pair[1])


def _gain_margin(size: NDArray[Any], phase: NDArray[Any]) -> float:
    """The smallest factor above 1 at which the phase is -180 deg; those below 1 are the lower margin, not this one."""
    factors = 1.0 / size[np.flatnonzero(np.diff(np.sign(phase + np.pi)))]
    above = factors[factors > 1.0]
    return float(np.min(above)) if above.size else float(np.max(factors, initial=0.0)) or math.inf
