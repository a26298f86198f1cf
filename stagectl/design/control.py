"""The control settings of a stage file, and the feedback that follows: PID by pole placement, or a cascade."""

import contextlib
import math
from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

import numpy as np

from stagectl.kernels import cascade, feedback, stage
from stagectl.problem import Problem, ProblemKind
from stagectl.units import Quantity, StageError


class DesignError(StageError):
    """A control design that would be unstable or too close to it."""

    def __init__(self, *problems: Problem | str, phase: float = math.nan, advised: float | None = None) -> None:
        super().__init__(*problems)
        self.phase = phase  # rad, phase margin of the refused loop; NaN where it has none or cannot be computed
        self.advised = advised  # Hz, the bandwidth that would be accepted; None where no lower one helps


Layer = Literal["ptc", "friction", "effects", "observer"]
_PERIOD = Quantity("s", "[1e-5, 0.1]", "control period Ts")
_MARGIN = Quantity("rad", "[0, 1.5]", "least phase margin that is accepted")
_LAYERS = "layers that act together with the feedback: ptc, friction, effects, observer"
_UNANSWERED = "entries of the model, such as motor.cogging, that the layer effects leaves to the feedback"
_STANDSTILL = Quantity("", "[0, 100]", "counts of error that are left alone while the reference stands still; 0: none")
_FRICTION_SCALE = Quantity("", "[0, 2]", "factor on the friction that is compensated; 1: as it was identified")
_OBSERVER = Quantity("Hz", "(0, 2000]", "frequency at which the disturbance observer's three poles are placed")


class Control(NamedTuple):
    """PID by pole placement."""

    period: Annotated[float, _PERIOD]
    bandwidth: Annotated[float, Quantity("Hz", "(0, 2000]", "frequency at which all four closed-loop poles are placed")]
    margin: Annotated[float, _MARGIN] = math.radians(20)
    layers: Annotated[tuple[Layer, ...], _LAYERS] = ("ptc", "friction", "effects")
    unanswered: Annotated[tuple[str, ...], _UNANSWERED] = ()
    observer_bandwidth: Annotated[float | None, _OBSERVER] = None  # that of the position loop
    standstill_band: Annotated[float, _STANDSTILL] = 0.0  # an axis that hunts about its target: 1
    friction_scale: Annotated[float, _FRICTION_SCALE] = 1.0  # `identify --watch` keeps it current


class CascadeControl(NamedTuple):
    """P position, PI velocity, force filter and velocity feedforward."""

    period: Annotated[float, _PERIOD]
    position_gain: Annotated[
        float, Quantity("1/s", "(0, 1e5]", "Kp, velocity reference for each unit of position error")
    ]
    velocity_bandwidth: Annotated[
        float, Quantity("Hz", "(0, 1e4]", "bandwidth of the velocity loop; Kv = inertia x 2 pi bandwidth")
    ]
    integral_time: Annotated[float, Quantity("s", "[0, 100]", "Ti of the velocity loop; 0: no integrator")] = 0.0
    force_filter: Annotated[float, Quantity("s", "[0, 1]", "Tf, time constant of the force filter; 0: none")] = 0.0
    velocity_feedforward: Annotated[float, Quantity("", "[0, 2]", "share of the reference velocity, FF")] = 1.0
    velocity_span: Annotated[int, Quantity("", "[1, 2]", "periods over which the velocity is differenced")] = 1
    margin: Annotated[float, _MARGIN] = math.radians(20)
    layers: Annotated[tuple[Layer, ...], _LAYERS] = ("friction", "effects")
    unanswered: Annotated[tuple[str, ...], _UNANSWERED] = ()
    observer_bandwidth: Annotated[float | None, _OBSERVER] = None  # that of the position loop
    standstill_band: Annotated[float, _STANDSTILL] = 0.0  # an axis that hunts about its target: 1
    friction_scale: Annotated[float, _FRICTION_SCALE] = 1.0  # `identify --watch` keeps it current


Settings = Control | CascadeControl
Feedback = feedback.Gains | cascade.Cascade


def designed_feedback(p: stage.Stage, control: Settings) -> Feedback:
    """The feedback that `control` asks for.  Raises DesignError where its numbers cannot be realised on this stage."""
    return gains(p, control) if isinstance(control, Control) else cascaded(p, control)


def cascaded(p: stage.Stage, control: CascadeControl) -> cascade.Cascade:
    """The cascade at its period: ``Kv = J 2 pi f_v / Kt``, the integrator by Tustin's rule, the filter exactly."""
    dt, ti, tf = control.period, control.integral_time, control.force_filter
    velocity = p.mechanics.inertia * 2.0 * math.pi * control.velocity_bandwidth / p.motor.force_constant
    if not (math.isfinite(velocity) and velocity > 0.0):
        raise incomputable(p)
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
    with computable(p):
        designed = feedback.place_poles(p.mechanics, p.motor.force_constant, control.bandwidth)
    if not all(math.isfinite(gain) for gain in designed):
        raise incomputable(p)
    if min(designed.proportional, designed.pole) <= 0.0:  # Kd, as (D/J - 3 p)^4, is below 0 by rounding alone
        least = p.mechanics.viscous / p.mechanics.inertia / (7.5 * math.pi)
        gains_needed = ", ".join(f"{name} {value:.4g}" for name, value in designed._asdict().items())
        reason = f"is too low for this axis, as a gain would be negative ({gains_needed})"
        problem = Problem(reason, ProblemKind.LOOP, "control.bandwidth", f"{control.bandwidth:g} Hz", "Hz")
        raise DesignError(problem._replace(remedy=f"the damping D/J needs more than {least:.3g} Hz"))
    return designed


@contextlib.contextmanager
def computable(p: stage.Stage) -> Iterator[None]:
    """Raise DesignError where the numbers of `p` exceed what floats can hold."""
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            yield
    except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        raise incomputable(p) from error


def incomputable(p: stage.Stage) -> DesignError:
    """The error where a loop cannot be computed; it names the numbers to look at."""
    reason = (
        f"the loop of this stage cannot be computed with mechanics.inertia = {p.mechanics.inertia:g}, "
        f"mechanics.viscous = {p.mechanics.viscous:g}, motor.force_constant = {p.motor.force_constant:g} (SI)"
    )
    return DesignError(Problem(reason, ProblemKind.LOOP, remedy="check their units and powers of ten"))


def speed(control: Settings) -> tuple[str, float, str]:
    """What makes the loop fast: name, value, unit."""
    if isinstance(control, Control):
        return "bandwidth", control.bandwidth, "Hz"
    return "velocity_bandwidth", control.velocity_bandwidth, "Hz"


def slower(control: Settings, share: float) -> Settings:
    """The same control, slower by `share`; a cascade keeps the ratio of its loops."""
    if isinstance(control, Control):
        return control._replace(bandwidth=share * control.bandwidth)
    return control._replace(
        position_gain=share * control.position_gain,
        velocity_bandwidth=share * control.velocity_bandwidth,
        integral_time=control.integral_time / share,
    )


def observer_bandwidth(control: Settings) -> float:
    """Frequency of the disturbance observer's poles (Hz): that of `control`, or else that of the position loop."""
    if control.observer_bandwidth is not None:
        return control.observer_bandwidth
    return control.bandwidth if isinstance(control, Control) else control.position_gain / (2.0 * math.pi)
