"""The loop as it runs, and how far it is from instability.

Tustin's PID or the cascade at the control period, the plant under zero-order hold with its current loop, its load
behind a spring and its base on feet, nd + nm whole periods of delay, and the disturbance observer where there is one.

Transfer functions are polynomials in ``w = z - 1``.  The poles of a slow loop all lie near z = 1: in powers of z they
are differences of numbers that agree to all their digits, in powers of w they are not.

Source: R. H. Middleton, G. C. Goodwin, IEEE Trans. Automatic Control 31(11), 1986 (delta operator).
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.design.constants import FREQUENCIES, LOWEST, SHORTEST_LAG
from stagectl.design.control import Feedback, computable
from stagectl.kernels import cascade, feedback, observer, stage, transmission
from stagectl.kernels.constants import FIRST_ORDER

# Speeds over that at which a Stribeck rise has decayed: with an exponent of 1, 0.1 % of it has gone, and all.
_SLOWEST, _FASTEST, _HALVINGS = 1e-3, 1e2, 20
_ORDER = 16  # of a series whose terms fall by half and more: the next one is 1e-20 of the first


class Margins(NamedTuple):
    """How far the loop is from instability."""

    phase: float  # rad, negative when unstable
    gain: float  # largest factor on the gain before it is unstable
    crossover: float  # Hz
    delay: float  # s, further delay before it is unstable
    stable: bool


def margins(
    p: stage.Stage, designed: Feedback | feedback.Pid, dt: float, watching: observer.Observer = observer.ABSENT
) -> Margins:
    """Margins of the running loop at the period `dt` (s), cut at the plant's input; `watching` is its observer.

    Raises DesignError where the stage's numbers are too extreme to compute with.
    """
    frequency = np.geomspace(LOWEST / dt, 0.5 / dt, FREQUENCIES)
    with computable(p):
        moved, controller = plant(p, dt), with_observer(compensator(designed, dt), watching)
        z = np.exp(2j * np.pi * frequency * dt)
        loop = moved.at(z) * controller.at(z)
        phase = np.unwrap(np.angle(loop))
        phase -= 2.0 * np.pi * round((phase[0] + np.pi) / (2.0 * np.pi))  # starts near -180 deg: a double integrator
        stable = settles(_characteristic(moved, controller))
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
        controller = with_observer(compensator(designed, dt), watching)
        poles = 1.0 + np.roots(_characteristic(plant(p, dt, held=True), controller))
    worst = poles[np.argmax(np.abs(poles))]
    return float(abs(np.angle(worst))) / (2.0 * np.pi * dt) if abs(worst) >= 1.0 else None


def sticking_speed(
    p: stage.Stage, designed: Feedback, dt: float, watching: observer.Observer = observer.ABSENT
) -> float | None:
    """Speed (rad/s | m/s) below which the loop does not hold a sliding axis; None where it does at any.

    Friction that falls with the speed is a negative damping.  Where it falls faster than the loop can bear, the axis
    sticks and slips, and no current that is known beforehand changes that.  A friction that follows the speed late
    falls less than this in time.
    """
    speeds, falls = _falling(p.friction)
    least, most = 0.0, float(falls.max())
    if p.friction.lag > 0.0 or most == 0.0:
        return None
    with computable(p):
        controller = with_observer(compensator(designed, dt), watching)

        def bears(fall: float) -> bool:
            damped = p.mechanics._replace(viscous=p.mechanics.viscous - fall)
            return settles(_characteristic(plant(p._replace(mechanics=damped), dt), controller))

        if bears(most):
            return None
        for _ in range(_HALVINGS):
            middle = 0.5 * (least + most)
            least, most = (middle, most) if bears(middle) else (least, middle)
    return float(speeds[falls > least].max())


def _falling(p: stage.Friction) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Speeds (n,) rad/s | m/s, and how fast friction falls there (n,) N m s/rad | N s/m."""
    parts = ((float(sum(p.operators.weight)), p.stribeck), (p.bristle.coulomb, p.bristle.stribeck))
    own = [rise.velocity for size, rise in parts if size * rise.rise > 0.0] or [1.0]
    speeds = np.geomspace(_SLOWEST * min(own), _FASTEST * max(own), FREQUENCIES)
    falls = np.zeros(len(speeds))
    for size, rise in parts:
        over = (speeds / rise.velocity) ** rise.shape
        falls += size * rise.rise * rise.shape * over * np.exp(-over) / speeds
    return speeds, falls


def _rates(p: stage.Stage, held: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rate of the plant's state, (position, velocity, ..., current), by the state (n, n), and by the command (n,).

    `held`: by friction.  Load and base are in it, as `kernels.transmission` moves them, without the load's gap.
    """
    x, v, bend, bending, foot, recoiling, current, rate = np.eye(8)
    c, m = transmission.coefficients(p.mechanics, 0.0, 1.0), p.mechanics
    spring, damping = (stage.stiffness(p.friction), p.friction.bristle.damping) if held else (0.0, 0.0)
    rubbing = spring * (x + c.share * bend) + (m.viscous + damping) * (v + c.share * bending)
    carried, mu = -c.spring * bend - c.damper * bending, c.base[0]
    motor = (p.motor.force_constant * current - carried - (1.0 - c.share) * rubbing) / c.motor
    load = (carried - c.share * rubbing) / c.load if c.load > 0.0 else motor
    recoil = -mu * (c.motor * motor + c.load * load) / m.inertia - c.base[1] * foot - c.base[2] * recoiling
    by_current, by_command = _current_loop(p.drive, current, rate)
    rates = np.stack([v, motor - recoil, bending, load - motor, recoiling, recoil, *by_current])
    loaded, second = c.load > 0.0, p.drive.current_damping < FIRST_ORDER
    there = np.flatnonzero([True, True, loaded, loaded, mu > 0.0, mu > 0.0, True, second])
    return rates[np.ix_(there, there)], (1.0 + p.drive.gain) * by_command[there]


def _current_loop(p: stage.Drive, current: NDArray[Any], rate: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Rates of the current and of its rate, (2, 8) by the state and (8,) by the command, from their own two rows."""
    lag = max(p.current_lag, SHORTEST_LAG)
    if p.current_damping >= FIRST_ORDER:
        return np.stack([-current / lag, 0.0 * rate]), current / lag
    stiffness = (2.0 * p.current_damping / lag) ** 2
    return np.stack([rate, -stiffness * (current + lag * rate)]), stiffness * rate


def _sampled(p: stage.Stage, dt: float, held: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Change of the plant's state in a period under zero-order hold, by the state (n, n) and by the command (n,)."""
    by_state, by_command = _rates(p, held)
    n = len(by_command)
    a = np.zeros((n + 1, n + 1))
    a[:n, :n], a[:n, n] = dt * by_state, dt * by_command
    change = _expm1(a)
    return change[:n, :n], change[:n, n]


def _expm1(a: NDArray[np.float64]) -> NDArray[np.float64]:
    """``exp(a) - 1``, no digit lost where `a` is small: the series of a part of it, doubled until it is the whole.

    Not scipy's `expm`: a quarter of a second to import, of every program that reads a stage file.
    """
    doublings = max(0, math.frexp(np.abs(a).sum(axis=0).max())[1] + 1)  # of a part whose norm is below a half
    part = a / 2.0**doublings
    series = one = np.eye(len(a))
    for order in range(_ORDER, 1, -1):
        series = one + part @ series / order
    change: NDArray[np.float64] = part @ series
    for _ in range(doublings):
        change = change @ change + 2.0 * change
    return change


class Rational(NamedTuple):
    """A transfer function in ``w = z - 1``: coefficients, highest power first."""

    numerator: NDArray[np.floating[Any]]
    denominator: NDArray[np.floating[Any]]

    def at(self, z: NDArray[Any]) -> NDArray[Any]:
        """Its values at `z` (n,)."""
        values: NDArray[Any] = np.polyval(self.numerator, z - 1.0) / np.polyval(self.denominator, z - 1.0)
        return values


def compensator(designed: Feedback | feedback.Pid, dt: float) -> Rational:
    """From the position error to the current, as it runs at the period `dt` (s); a reference at rest."""
    if isinstance(designed, feedback.Gains):
        return _pid(feedback.discretised(designed, dt))
    if isinstance(designed, feedback.Pid):
        return _pid(designed)
    return _cascade(designed)


def with_observer(controller: Rational, p: observer.Observer) -> Rational:
    """The controller together with a disturbance observer: ``(C + M) / (1 + U)``, see `observer.transfer`."""
    if not p.active:
        return controller
    poles, late = np.poly([p.pole - 1.0] * 3), _power(p.delay + 1)
    measured = p.disturbance * np.poly([-1.0, 0.0, p.a22 - 1.0])
    moved = np.polymul([p.b1, p.a12 * p.b2 + p.b1 * (1.0 - p.a22)], [p.share, 1.0])
    current = -p.disturbance * np.polymul(moved, _power(1))
    numerator = np.polyadd(np.polymul(controller.numerator, poles), np.polymul(controller.denominator, measured))
    denominator = np.polymul(controller.denominator, np.polyadd(np.polymul(poles, late), current))
    return Rational(np.polymul(numerator, late), denominator)


def _power(exponent: int) -> NDArray[np.float64]:
    """``z^exponent`` in powers of w."""
    return np.asarray(np.poly([-1.0] * exponent), dtype=np.float64)


def _pid(p: feedback.Pid) -> Rational:
    integrator, filtered = np.array([1.0, 0.0]), np.array([1.0, 1.0 - p.decay])
    numerator = np.polyadd(
        p.proportional * np.polymul(integrator, filtered),
        np.polyadd(p.integral * np.polymul([1.0, 2.0], filtered), p.derivative * np.polymul(integrator, integrator)),
    )
    return Rational(numerator, np.polymul(integrator, filtered))


def _cascade(p: cascade.Cascade) -> Rational:
    """``(Kp + (1 - z^-span)/(span Ts)) (Kv + I (z + 1)/(z - 1)) (1 - c) z/(z - c)``, over z^span."""
    last = _power(p.span)
    outer = p.position * last + np.append(last[:-1], 0.0) / (p.span * p.dt)
    inner, integrator = np.array([p.velocity + p.integral, 2.0 * p.integral]), np.array([1.0, 0.0])
    if p.integral == 0.0:  # no integrator: a pole and a zero at z = 1 would look like a pole that is not stable
        inner, integrator = np.array([p.velocity]), np.ones(1)
    numerator = np.polymul(np.polymul(outer, inner), (1.0 - p.retained) * _power(1))
    return Rational(numerator, np.polymul(np.polymul(last, integrator), [1.0, 1.0 - p.retained]))


def plant(p: stage.Stage, dt: float, held: bool = False) -> Rational:
    """From the command to the measured position: zero-order hold, current loop, inertia, nd + nm periods, dead time.

    `held`: while friction holds the axis.
    """
    change, by_command = _sampled(p, dt, held)
    whole, part = divmod(p.drive.dead_time, dt)
    if part > 0.0:
        change, by_command = _within_a_period(change, by_command, _sampled(p, dt - part, held)[1])
    denominator, state, answers = np.poly(change), by_command, []
    for _ in by_command:
        answers.append(float(state[0]))
        state = change @ state
    numerator = np.convolve(answers, denominator)[: len(answers)]
    late = _power(p.drive.delay_samples + int(whole) + p.encoder.delay_samples)
    return Rational(numerator, np.polymul(denominator, late))


def _within_a_period(change: NDArray[Any], whole: NDArray[Any], begun: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """A command that does `begun` in the rest of the period in which it comes, and what is left in the next one.

    Until then it is one more state.
    """
    left = np.append(whole - begun, -1.0)
    return np.column_stack([np.vstack([change, np.zeros(len(change))]), left]), np.append(begun, 1.0)


def _characteristic(moved: Rational, controller: Rational) -> NDArray[Any]:
    """Polynomial in w whose roots are the poles of the closed loop."""
    ways = np.polymul(moved.numerator, controller.numerator)
    polynomial: NDArray[Any] = np.polyadd(np.polymul(moved.denominator, controller.denominator), ways)
    return polynomial


def settles(characteristic: NDArray[Any]) -> bool:
    """Whether all roots w of a closed loop's polynomial are stable, ``|1 + w| < 1``; to the digits of a small w."""
    roots = np.roots(characteristic)
    return bool(np.all(2.0 * roots.real + np.abs(roots) ** 2 < 0.0))


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
