"""From the stage and the control settings to the law that runs: gains, margins, and what is refused.

The margins are those of the loop as it runs: Tustin's PID at the control period, the plant under zero-order
hold with its current loop, and nd + nm whole periods of delay.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from stagectl.kernels import cascade, feedback, feedforward, law, observer, stage
from stagectl.units import Quantity, StageError


class DesignError(StageError):
    """A control design that would be unstable or too close to it."""


Layer = Literal["ptc", "friction", "observer"]
_PERIOD = Quantity("s", "[1e-5, 0.1]", "control period Ts")
_MARGIN = Quantity("rad", "[0, 1.5]", "least phase margin that is accepted")
_LAYERS = "what acts beside the feedback: ptc, friction, observer"
_OBSERVER = Quantity("Hz", "(0, 2000]", "where the disturbance observer's three poles are placed")


class Control(NamedTuple):
    """PID by pole placement: what the user asks of the controller."""

    period: Annotated[float, _PERIOD]
    bandwidth: Annotated[float, Quantity("Hz", "(0, 2000]", "where all four closed-loop poles are placed")]
    margin: Annotated[float, _MARGIN] = math.radians(20)
    layers: Annotated[tuple[Layer, ...], _LAYERS] = ("ptc", "friction")
    observer_bandwidth: Annotated[float | None, _OBSERVER] = None  # that of the position loop


class CascadeControl(NamedTuple):
    """P position, PI velocity, force filter and velocity feedforward."""

    period: Annotated[float, _PERIOD]
    position_gain: Annotated[float, Quantity("1/s", "(0, 1e5]", "Kp, velocity asked for per position error")]
    velocity_bandwidth: Annotated[float, Quantity("Hz", "(0, 1e4]", "of the velocity loop: Kv = inertia x 2 pi this")]
    integral_time: Annotated[float, Quantity("s", "[0, 100]", "Ti of the velocity loop; 0: no integrator")] = 0.0
    force_filter: Annotated[float, Quantity("s", "[0, 1]", "Tf, time constant of the force filter; 0: none")] = 0.0
    velocity_feedforward: Annotated[float, Quantity("", "[0, 2]", "share of the reference velocity, FF")] = 1.0
    velocity_span: Annotated[int, Quantity("", "[1, 2]", "periods over which the velocity is differenced")] = 1
    margin: Annotated[float, _MARGIN] = math.radians(20)
    layers: Annotated[tuple[Layer, ...], _LAYERS] = ("friction",)
    observer_bandwidth: Annotated[float | None, _OBSERVER] = None  # that of the position loop


Settings = Control | CascadeControl
Feedback = feedback.Gains | cascade.Cascade


class Controller(NamedTuple):
    """What runs: the law period by period, and what is computed from the trajectory beforehand."""

    law: law.Law
    feedforward: feedforward.Feedforward


class Margins(NamedTuple):
    """How far the loop is from instability."""

    phase: float  # rad, negative when unstable
    gain: float  # largest factor on the gain before it is unstable
    crossover: float  # Hz
    delay: float  # s, further delay before it is unstable
    stable: bool


def designed_feedback(p: stage.Stage, control: Settings) -> Feedback:
    """The feedback that `control` asks for.

    Raises DesignError where its numbers cannot be realised on this stage.
    """
    return gains(p, control) if isinstance(control, Control) else cascaded(p, control)


def cascaded(p: stage.Stage, control: CascadeControl) -> cascade.Cascade:
    """The cascade at its period: ``Kv = J 2 pi f_v / Kt``, the integrator by Tustin's rule, the filter exactly."""
    dt, ti, tf = control.period, control.integral_time, control.force_filter
    velocity = p.mechanics.inertia * 2.0 * math.pi * control.velocity_bandwidth / p.motor.force_constant
    if not (math.isfinite(velocity) and velocity > 0.0):
        raise DesignError(_incomputable(p))
    return cascade.Cascade(
        control.position_gain,
        velocity,
        0.5 * velocity * dt / ti if ti > 0.0 else 0.0,
        math.exp(-dt / tf) if tf > 0.0 else 0.0,
        control.velocity_feedforward,
        control.velocity_span,
        dt,
    )


def gains(p: stage.Stage, control: Control) -> feedback.Gains:
    """Continuous PID gains of the four-pole placement.

    Raises DesignError where the bandwidth is too low for the plant's own damping: a gain would be negative.
    """
    with _computable(p):
        designed = feedback.place_poles(p.mechanics, p.motor.force_constant, control.bandwidth)
    if not all(math.isfinite(gain) for gain in designed):
        raise DesignError(_incomputable(p))
    if min(designed) <= 0.0:
        least = p.mechanics.viscous / p.mechanics.inertia / (8.0 * math.pi)
        raise DesignError(
            f"control.bandwidth = {control.bandwidth:g} Hz is too low for this axis: the placement asks for "
            f"{_listed(designed)}; the damping D/J needs more than {least:.3g} Hz at the very least"
        )
    return designed


def _listed(designed: feedback.Gains) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in designed._asdict().items())


@contextlib.contextmanager
def _computable(p: stage.Stage) -> Iterator[None]:
    """Say it in words where the numbers of `p` leave what floats can hold."""
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            yield
    except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        raise DesignError(_incomputable(p)) from error


def _incomputable(p: stage.Stage) -> str:
    return (
        f"the loop of this stage is beyond computing: mechanics.inertia = {p.mechanics.inertia:g}, mechanics.viscous = "
        f"{p.mechanics.viscous:g}, motor.force_constant = {p.motor.force_constant:g} (SI); check their units and "
        f"powers of ten"
    )


def margins(p: stage.Stage, designed: Feedback, dt: float, watching: observer.Observer = observer.ABSENT) -> Margins:
    """Margins of the running loop at the period `dt` (s), cut at the plant's input; `watching` is its observer.

    Raises DesignError where the stage's numbers are too extreme to compute with.
    """
    with _computable(p):
        return _margins(p, observed(compensator(designed, dt), watching), dt)


def _margins(p: stage.Stage, controller: Rational, dt: float) -> Margins:
    frequency = np.geomspace(1e-5 / dt, 0.5 / dt, 20_000)
    loop = _open_loop(p, controller, dt, np.exp(2j * np.pi * frequency * dt))
    phase = np.unwrap(np.angle(loop))
    phase -= 2.0 * np.pi * round((phase[0] + np.pi) / (2.0 * np.pi))  # starts near -180 deg: a double integrator
    stable = _stable(p, controller, dt)
    crossover, margin = _phase_margin(frequency, np.log(np.abs(loop)), phase)
    gain = _gain_margin(np.abs(loop), phase)
    delay = margin / (2.0 * np.pi * crossover) if crossover > 0.0 else math.inf
    return Margins(margin, gain, crossover, delay, stable)


def _held(p: stage.Stage, dt: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Plant with current loop, (position, velocity, current), sampled under zero-order hold."""
    lag = max(p.drive.current_lag, 1e-9)  # a current loop this fast is none
    rate = p.mechanics.viscous / p.mechanics.inertia
    a = np.array([[0, 1, 0], [0, -rate, p.motor.force_constant / p.mechanics.inertia], [0, 0, -1 / lag]])
    whole: NDArray[np.float64] = np.zeros((4, 4))
    whole[:3, :3], whole[2, 3] = a, 1 / lag
    stepped = expm(whole * dt)
    return stepped[:3, :3], stepped[:3, 3]


class Rational(NamedTuple):
    """A transfer function in z: coefficients, highest power first."""

    numerator: NDArray[np.floating[Any]]
    denominator: NDArray[np.floating[Any]]

    def at(self, z: NDArray[Any]) -> NDArray[Any]:
        """Its values at `z` (n,)."""
        found: NDArray[Any] = np.polyval(self.numerator, z) / np.polyval(self.denominator, z)
        return found


def compensator(designed: Feedback, dt: float) -> Rational:
    """From the position error to the current, as it runs at the period `dt` (s); a reference at rest."""
    if isinstance(designed, feedback.Gains):
        return _pid(feedback.discretised(designed, dt))
    return _cascade(designed)


def observed(controller: Rational, p: observer.Observer) -> Rational:
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


def plant(p: stage.Stage, dt: float) -> Rational:
    """From the command to the measured position: zero-order hold, current loop, inertia, and nd + nm periods."""
    a, b = _held(p, dt)
    denominator = np.poly(a)
    pulse = [float(b[0]), float((a @ b)[0]), float((a @ a @ b)[0])]  # position after 1, 2 and 3 periods
    numerator = np.convolve(pulse, denominator)[:3]
    delays = np.zeros(1 + p.drive.delay_samples + p.encoder.delay_samples)
    delays[0] = 1.0
    return Rational(numerator, np.polymul(denominator, delays))


def _open_loop(p: stage.Stage, controller: Rational, dt: float, z: NDArray[Any]) -> NDArray[Any]:
    loop: NDArray[Any] = plant(p, dt).at(z) * controller.at(z)
    return loop


def _stable(p: stage.Stage, controller: Rational, dt: float) -> bool:
    """Whether all closed-loop poles of the sampled loop lie inside the unit circle."""
    moved = plant(p, dt)
    poles = np.roots(
        np.polyadd(
            np.polymul(moved.denominator, controller.denominator), np.polymul(moved.numerator, controller.numerator)
        )
    )
    return bool(np.max(np.abs(poles)) < 1.0)


def _phase_margin(frequency: NDArray[Any], level: NDArray[Any], phase: NDArray[Any]) -> tuple[float, float]:
    """Smallest margin over all frequencies at which the loop's gain passes 1: (Hz, rad)."""
    found = [(0.0, math.inf)]
    for k in np.flatnonzero(np.diff(np.sign(level))):
        part = level[k] / (level[k] - level[k + 1])
        there = frequency[k] + part * (frequency[k + 1] - frequency[k])
        found.append((float(there), float(np.pi + phase[k] + part * (phase[k + 1] - phase[k]))))
    return min(found, key=lambda pair: pair[1])


def _gain_margin(size: NDArray[Any], phase: NDArray[Any]) -> float:
    """The smallest factor above 1 at which the phase is -180 deg; those below 1 are the lower margin, not this one."""
    factors = 1.0 / size[np.flatnonzero(np.diff(np.sign(phase + np.pi)))]
    above = factors[factors > 1.0]
    return float(np.min(above)) if above.size else float(np.max(factors, initial=0.0)) or math.inf


def design(p: stage.Stage, control: Settings, without: frozenset[str] = frozenset()) -> Controller:
    """The controller for this stage; `without` names layers of ``control.layers`` that are switched off.

    Raises DesignError where the phase margin is below ``control.margin``.
    """
    designed = designed_feedback(p, control)
    reached = margins(p, designed, control.period)
    if not reached.stable or reached.phase < control.margin:
        raise DesignError(_refusal(p, control, reached))
    layers = frozenset(control.layers) - without
    watching = watched(p, control, designed) if "observer" in layers else observer.ABSENT
    anticipation = feedforward.Feedforward(
        feedforward.held(p.mechanics, p.motor.force_constant, control.period),
        p.friction.operators,
        p.motor.force_constant,
        "ptc" in layers,
        "friction" in layers,
    )
    feeding = running(designed, control.period, p.drive.current_limit)
    return Controller(feeding._replace(observer=watching), anticipation)


def observer_bandwidth(control: Settings) -> float:
    """Where the disturbance observer's poles are placed (Hz): as asked for, or as fast as the position loop."""
    if control.observer_bandwidth is not None:
        return control.observer_bandwidth
    return control.bandwidth if isinstance(control, Control) else control.position_gain / (2.0 * math.pi)


def watched(p: stage.Stage, control: Settings, designed: Feedback) -> observer.Observer:
    """The disturbance observer that `control` asks for, beside this feedback.

    Raises DesignError where the two together fall below ``control.margin``, or the delay is too long to observe.
    """
    bandwidth, dt = observer_bandwidth(control), control.period
    try:
        found = observer.designed(p, dt, bandwidth)
        reached = margins(p, designed, dt, found)
    except observer.DelayError as error:
        raise DesignError(f"control.layers holds observer: {error}") from error
    if reached.stable and reached.phase >= control.margin:
        return found
    alone = math.degrees(margins(p, designed, dt).phase)
    state = f"{math.degrees(reached.phase):.1f} deg" if reached.stable else "none: the sampled loop is unstable"
    raise DesignError(
        f"control.observer_bandwidth = {bandwidth:g} Hz leaves a phase margin of {state} ({alone:.1f} deg without the "
        f"observer); at least {math.degrees(control.margin):g} deg are asked for.  {_calmer(p, control, designed)}"
    )


def _calmer(p: stage.Stage, control: Settings, designed: Feedback) -> str:
    for share in (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1):
        lower = share * observer_bandwidth(control)
        reached = margins(p, designed, control.period, observer.designed(p, control.period, lower))
        if reached.stable and reached.phase >= control.margin:
            return f"Take {lower:.3g} Hz ({math.degrees(reached.phase):.1f} deg), or switch the layer observer off"
    return "Switch the layer observer off, or take a lower bandwidth for the feedback"


def running(designed: Feedback, dt: float, current_limit: float) -> law.Law:
    """The law with this feedback, at the period `dt` (s)."""
    if isinstance(designed, feedback.Gains):
        return law.Law(feedback.discretised(designed, dt), current_limit)
    return law.Law(feedback.ABSENT, current_limit, designed, True)


def _refusal(p: stage.Stage, control: Settings, reached: Margins) -> str:
    margin = f"a phase margin of {math.degrees(reached.phase):.1f} deg" if math.isfinite(reached.phase) else "no margin"
    state = "" if reached.stable else " and the sampled loop is unstable"
    name, value, unit = speed(control)
    return (
        f"control.{name} = {value:g} {unit} leaves {margin}{state}; at least "
        f"{math.degrees(control.margin):g} deg are asked for.  Period {control.period * 1e3:g} ms, nd "
        f"{p.drive.delay_samples}, nm {p.encoder.delay_samples}, current lag {p.drive.current_lag * 1e3:.3g} ms.  "
        f"{_advice(p, control)}"
    )


def speed(control: Settings) -> tuple[str, float, str]:
    """What makes the loop fast: name, value, unit."""
    if isinstance(control, Control):
        return "bandwidth", control.bandwidth, "Hz"
    return "velocity_bandwidth", control.velocity_bandwidth, "Hz"


def _slower(control: Settings, share: float) -> Settings:
    """The same control, slower by `share`; a cascade keeps the ratio of its loops."""
    if isinstance(control, Control):
        return control._replace(bandwidth=share * control.bandwidth)
    return control._replace(
        position_gain=share * control.position_gain,
        velocity_bandwidth=share * control.velocity_bandwidth,
        integral_time=control.integral_time / share,
    )


def _advice(p: stage.Stage, control: Settings) -> str:
    for share in (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1):
        lower = _slower(control, share)
        try:
            reached = margins(p, designed_feedback(p, lower), control.period)
        except DesignError:
            break
        if reached.stable and reached.phase >= control.margin:
            also = "" if isinstance(control, Control) else f" with position_gain and 1/integral_time x {share:g}"
            value = speed(lower)[1]
            return f"Take {value:.3g} Hz{also} ({math.degrees(reached.phase):.1f} deg) or a shorter period"
    return "Take a shorter period or remove delay: no lower bandwidth helps"
