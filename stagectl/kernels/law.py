"""The deployed control law: feedback on the target, plus what is known beforehand, limited.

::

    trajectory --> plan ----- target y0 ------>(-)--> PID or cascade -- feedback -->(+)--> limit --> current
                    |                           ^ measured                           ^ |
                    |                           +--> disturbance observer --> - d ---+-+
                    +-- feedforward (PTC) + friction compensation + learned current -+
                    +-- injected current (experiments) ------------------------------+

What depends on the reference alone is computed before the motion (`kernels.feedforward`); what is left for the
period is a subtraction, the feedback and a limit.  A setpoint may open the loop: then only what is known beforehand
flows, as in a frequency response or when the axis is released.  One function, wherever the law runs: loop,
simulator, replay, tests.

An encoder does not see less than a count, so a loop with an integrator hunts about a target between two counts.  While
the reference stands still and nothing is injected, an error within the `standstill_band` is left alone: the integral
keeps the current that carries the friction, and the axis rests.  What it took at rest it gives up as the axis moves on
(`kernels.unloading`).
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from stagectl.kernels import cascade, feedback, observer, unloading
from stagectl.kernels.jit import kernel
from stagectl.units import Quantity

_ANY = "[-inf, inf]"


class Law(NamedTuple):
    """Parameters of the law, designed for one stage at one control period."""

    feedback: feedback.Pid
    current_limit: float  # A
    cascade: cascade.Cascade = cascade.ABSENT
    cascaded: bool = False  # which of the two feeds back
    observer: observer.Observer = observer.ABSENT
    standstill_band: float = 0.0  # rad | m, error that is left alone while the reference stands still; 0: none
    unloading: unloading.Unloading = unloading.ABSENT


class Setpoint(NamedTuple):
    """All that is known of a period beforehand."""

    reference: Annotated[float, Quantity("rad | m", _ANY, "commanded position now")]
    target: Annotated[float, Quantity("rad | m", _ANY, "y0, what the measured position is compared with")]
    feedforward: Annotated[float, Quantity("A", _ANY, "perfect tracking feedforward")]
    friction: Annotated[float, Quantity("A", _ANY, "friction compensation")]
    velocity: Annotated[float, Quantity("rad/s | m/s", _ANY, "reference velocity, for the cascade")] = 0.0
    learned: Annotated[float, Quantity("A", _ANY, "learned from earlier trials")] = 0.0
    injection: Annotated[float, Quantity("A", _ANY, "excitation of an experiment")] = 0.0
    closed: Annotated[float, Quantity("", "[0, 1]", "1: the loop is closed; 0: no feedback acts")] = 1.0


class State(NamedTuple):
    """Memory of the law."""

    feedback: feedback.State
    cascade: cascade.State
    observer: observer.State
    unloading: unloading.State = unloading.AT_REST


class Output(NamedTuple):
    """The command and the terms of it that the setpoint does not hold."""

    error: Annotated[float, Quantity("rad | m", _ANY, "target minus measured; 0 while the loop is open")]
    proportional: Annotated[float, Quantity("A", _ANY, "feedback, proportional term (cascade: of the velocity)")]
    integral: Annotated[float, Quantity("A", _ANY, "feedback, integral term (cascade: of the velocity)")]
    derivative: Annotated[float, Quantity("A", _ANY, "feedback, derivative term (cascade: change by the force filter)")]
    observer: Annotated[float, Quantity("A", _ANY, "against the disturbance that the observer sees; 0 without one")]
    command: Annotated[float, Quantity("A", _ANY, "sum of all terms, before any limit")]
    current: Annotated[float, Quantity("A", _ANY, "command handed to the drive, after the limit")]


# Columns of arrays of setpoints (n, 8) and outputs (n, 7).
SETPOINT_COLUMNS = {name: number for number, name in enumerate(Setpoint._fields)}
OUTPUT_COLUMNS = {name: number for number, name in enumerate(Output._fields)}

AT_REST = State(feedback.AT_REST, cascade.AT_REST, observer.AT_REST)


@kernel
def carrying(x: State, more: float) -> State:
    """The memory `x` with a feedback that gives `more` (A) from now on: of the two, the one that acts."""
    pid, outer, held = x.feedback, x.cascade, x.unloading
    return State(
        feedback.State(pid.error, pid.integral + more, pid.derivative),
        cascade.State(outer.error, outer.integral + more, outer.filtered + more, outer.last, outer.before),
        x.observer,
        unloading.State(
            held.carried + more, held.unloaded, held.sense, held.bristle, held.left, held.low, held.high
        ),
    )  # fmt: skip


@kernel
def limited(p: Law, command: float) -> float:
    """`command` (A) within the limit."""
    if command > p.current_limit:
        return p.current_limit
    if command < -p.current_limit:
        return -p.current_limit
    return command


@kernel
def acted_on(p: Law, r: Setpoint, error: float) -> float:
    """The error (rad | m) that the feedback sees: at standstill what exceeds the band, so that it begins at zero.

    An observer acts within a band, too, so with one there is none.
    """
    if p.standstill_band == 0.0 or p.observer.active or r.velocity != 0.0 or r.injection != 0.0:
        return error
    return max(error - p.standstill_band, 0.0) + min(error + p.standstill_band, 0.0)


@kernel
def _integral_changed(p: Law, x: State, change: float) -> tuple[feedback.State, cascade.State]:
    """Both feedbacks, the integral of the one that acts changed by `change` (A)."""
    pid, outer = x.feedback, x.cascade
    if change != 0.0 and p.cascaded:
        outer = cascade.State(outer.error, outer.integral + change, outer.filtered, outer.last, outer.before)
    elif change != 0.0:
        pid = feedback.State(pid.error, pid.integral + change, pid.derivative)
    return pid, outer


@kernel
def step(p: Law, x: State, r: Setpoint, measured: float) -> tuple[Output, State]:
    """One period: the current for this measured position (rad | m)."""
    if r.closed == 0.0:
        known = r.feedforward + r.friction + r.learned + r.injection
        return Output(0.0, 0.0, 0.0, 0.0, 0.0, known, limited(p, known)), AT_REST
    error = r.target - measured
    driving = acted_on(p, r, error)
    given_up, held = 0.0, x.unloading
    if r.friction != 0.0:
        given_up, held = unloading.given_up(p.unloading, held, r.velocity)
    pid, outer = _integral_changed(p, x, given_up)
    before = outer.integral if p.cascaded else pid.integral
    if p.cascaded:
        terms, outer = cascade.step(p.cascade, outer, (driving, r.velocity), measured)
        driving = outer.error
    else:
        terms, pid = feedback.step(p.feedback, pid, driving)
    known = r.feedforward + r.friction + r.learned + r.injection
    against, seen = 0.0, x.observer
    if p.observer.active:
        against = 0.0 - observer.estimate(p.observer, x.observer, measured)
    command = terms.proportional + terms.integral + terms.derivative + against + known
    current = limited(p, command)
    if current != command and driving * command > 0.0:  # anti-windup: do not integrate further into the limit
        pid = feedback.State(pid.error, before, pid.derivative)
        outer = cascade.State(outer.error, before, outer.filtered, outer.last, outer.before)
    if p.observer.active:  # without the friction compensation, or it would see all the friction and compensate it again
        seen = observer.updated(p.observer, x.observer, measured, current - r.friction)
    output = Output(error, terms.proportional, terms.integral, terms.derivative, against, command, current)
    held = unloading.after(p.unloading, held, r.velocity, error, terms.proportional + terms.integral)
    return output, State(pid, outer, seen, held)
