"""From the stage and the control settings to the law that runs: gains, margins, and what is refused.

The margins are those of the loop as it runs: Tustin's PID at the control period, the plant under zero-order
hold with its current loop, and nd + nm whole periods of delay.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from stagectl.kernels import feedback, feedforward, law, stage
from stagectl.units import Quantity, StageError


class DesignError(StageError):
    """A control design that would be unstable or too close to it."""


class Control(NamedTuple):
    """What the user asks of the controller."""

    period: Annotated[float, Quantity("s", "[1e-5, 0.1]", "control period Ts")]
    bandwidth: Annotated[float, Quantity("Hz", "(0, 2000]", "where all four closed-loop poles are placed")]
    margin: Annotated[float, Quantity("rad", "[0, 1.5]", "least phase margin that is accepted")] = math.radians(20)


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


def margins(p: stage.Stage, designed: feedback.Gains, dt: float) -> Margins:
    """Margins of the running loop at the period `dt` (s).

    Raises DesignError where the stage's numbers are too extreme to compute with.
    """
    with _computable(p):
        return _margins(p, designed, dt)


def _margins(p: stage.Stage, designed: feedback.Gains, dt: float) -> Margins:
    pid = feedback.discretised(designed, dt)
    frequency = np.geomspace(1e-3 / dt, 0.5 / dt, 20_000)
    loop = _open_loop(p, pid, dt, np.exp(2j * np.pi * frequency * dt))
    phase = np.unwrap(np.angle(loop))
    phase -= 2.0 * np.pi * round((phase[0] + np.pi) / (2.0 * np.pi))  # starts near -180 deg: a double integrator
    stable = _stable(p, pid, dt)
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


def _open_loop(p: stage.Stage, pid: feedback.Pid, dt: float, z: NDArray[Any]) -> NDArray[Any]:
    a, b = _held(p, dt)
    numerator, denominator = _polynomials(a, b)
    plant = np.polyval(numerator, z) / np.polyval(denominator, z)
    controller = pid.proportional + pid.integral * (z + 1) / (z - 1) + pid.derivative * (z - 1) / (z - pid.decay)
    loop: NDArray[Any] = plant * controller * z ** -(p.drive.delay_samples + p.encoder.delay_samples)
    return loop


def _polynomials(a: NDArray[Any], b: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Transfer function of the position: numerator and denominator in z."""
    denominator = np.poly(a)
    numerator = np.poly(a - np.outer(b, [1.0, 0.0, 0.0])) - denominator
    return numerator, denominator


def _stable(p: stage.Stage, pid: feedback.Pid, dt: float) -> bool:
    """Whether all closed-loop poles of the sampled loop lie inside the unit circle."""
    numerator, denominator = _polynomials(*_held(p, dt))
    integrator, filtered = np.array([1.0, -1.0]), np.array([1.0, -pid.decay])
    controller = np.polyadd(
        pid.proportional * np.polymul(integrator, filtered),
        np.polyadd(
            pid.integral * np.polymul([1.0, 1.0], filtered), pid.derivative * np.polymul(integrator, integrator)
        ),
    )
    delays = np.zeros(1 + p.drive.delay_samples + p.encoder.delay_samples)
    delays[0] = 1.0
    bottom = np.polymul(np.polymul(denominator, delays), np.polymul(integrator, filtered))
    poles = np.roots(np.polyadd(bottom, np.polymul(numerator, controller)))
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
    falling = np.flatnonzero((phase[:-1] > -np.pi) & (phase[1:] <= -np.pi))
    return float(1.0 / size[falling[0]]) if falling.size else math.inf


def design(p: stage.Stage, control: Control, without: frozenset[str] = frozenset()) -> Controller:
    """The controller for this stage; `without` names layers that are switched off (``ptc``, ``friction``).

    Raises DesignError where the phase margin is below ``control.margin``.
    """
    designed = gains(p, control)
    reached = margins(p, designed, control.period)
    if not reached.stable or reached.phase < control.margin:
        raise DesignError(_refusal(p, control, reached))
    anticipation = feedforward.Feedforward(
        feedforward.held(p.mechanics, p.motor.force_constant, control.period),
        p.friction.operators,
        p.motor.force_constant,
        "ptc" not in without,
        "friction" not in without,
    )
    return Controller(law.Law(feedback.discretised(designed, control.period), p.drive.current_limit), anticipation)


def _refusal(p: stage.Stage, control: Control, reached: Margins) -> str:
    margin = f"a phase margin of {math.degrees(reached.phase):.1f} deg" if math.isfinite(reached.phase) else "no margin"
    state = "" if reached.stable else " and the sampled loop is unstable"
    return (
        f"control.bandwidth = {control.bandwidth:g} Hz leaves {margin}{state}; at least "
        f"{math.degrees(control.margin):g} deg are asked for.  Period {control.period * 1e3:g} ms, nd "
        f"{p.drive.delay_samples}, nm {p.encoder.delay_samples}, current lag {p.drive.current_lag * 1e3:.3g} ms.  "
        f"{_advice(p, control)}"
    )


def _advice(p: stage.Stage, control: Control) -> str:
    for share in (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1):
        lower = control._replace(bandwidth=share * control.bandwidth)
        try:
            reached = margins(p, gains(p, lower), control.period)
        except DesignError:
            break
        if reached.stable and reached.phase >= control.margin:
            return f"Take {lower.bandwidth:.3g} Hz ({math.degrees(reached.phase):.1f} deg) or a shorter period"
    return "Take a shorter period or remove delay: no lower bandwidth helps"
