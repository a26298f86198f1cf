"""The deployed control law: perfect tracking feedforward + PID + friction compensation, limited.

::

    reference --+-- ahead by L ------> PTC ------------------------ feedforward --+
                |                       | target y0                               v
                +-- late by nm Ts ------+--->(-)--> PID ------------ feedback -->(+)--> limit --> current
                |                             ^ measured                          ^
                +-- ahead by L + Ts/2 --> stop operators / Kt --- friction -------+

with ``L = current lag + nd Ts``.  The friction is compensated from the *reference*: from the measured position
it would chatter at standstill.  One function, wherever the law runs: loop, simulator, replay, tests.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from stagectl.kernels import feedback, feedforward, friction
from stagectl.kernels.jit import kernel
from stagectl.units import Quantity

_POSITION, _VELOCITY = "rad | m", "rad/s | m/s"
_ANY = "[-inf, inf]"


class Law(NamedTuple):
    """Parameters of the law, designed for one stage at one control period."""

    feedback: feedback.Pid
    plant: feedforward.Held
    friction: friction.StopOperators
    force_constant: float  # N m/A | N/A
    current_limit: float  # A
    with_ptc: bool
    with_friction: bool


class Reference(NamedTuple):
    """All that the law must know of the trajectory in one period."""

    reference: Annotated[float, Quantity(_POSITION, _ANY, "commanded position now")]
    delayed: Annotated[float, Quantity(_POSITION, _ANY, "commanded position at the instant of the measurement")]
    ahead_position: Annotated[float, Quantity(_POSITION, _ANY, "at t + 2 Ts + L, the frame's end")]
    ahead_velocity: Annotated[float, Quantity(_VELOCITY, _ANY, "at t + 2 Ts + L")]
    late_position: Annotated[float, Quantity(_POSITION, _ANY, "at t + 2 Ts - nm Ts, the frame's end")]
    late_velocity: Annotated[float, Quantity(_VELOCITY, _ANY, "at t + 2 Ts - nm Ts")]
    friction_position: Annotated[float, Quantity(_POSITION, _ANY, "at t + L + Ts/2, where friction acts")]


class State(NamedTuple):
    """Memory of the law."""

    feedback: feedback.State
    feedforward: feedforward.State
    stops: Any  # (n,) operators of the compensation, changed in place
    friction_position: float  # rad | m, where they stand


class Output(NamedTuple):
    """The command and every term of it."""

    target: Annotated[float, Quantity(_POSITION, _ANY, "y0, what the measured position is compared with")]
    error: Annotated[float, Quantity(_POSITION, _ANY, "target minus measured")]
    proportional: Annotated[float, Quantity("A", _ANY, "feedback, proportional term")]
    integral: Annotated[float, Quantity("A", _ANY, "feedback, integral term")]
    derivative: Annotated[float, Quantity("A", _ANY, "feedback, derivative term")]
    feedforward: Annotated[float, Quantity("A", _ANY, "perfect tracking feedforward")]
    friction: Annotated[float, Quantity("A", _ANY, "friction compensation")]
    command: Annotated[float, Quantity("A", _ANY, "sum of the terms, before any limit")]
    current: Annotated[float, Quantity("A", _ANY, "command handed to the drive, after the limit")]


def at_rest(p: Law, position: float = 0.0) -> State:
    """The law of an axis that has been standing at `position` (rad | m): all terms zero."""
    place = float(position)
    return State(feedback.AT_REST, feedforward.at_rest(place), friction.relaxed(p.friction), place)


@kernel
def after_gap(x: State) -> State:
    """Periods were missed, and their rows with them: the law goes on from where the reference is now."""
    return State(x.feedback, feedforward.after_gap(x.feedforward), x.stops, x.friction_position)


@kernel
def step(p: Law, x: State, r: Reference, measured: float) -> tuple[Output, State]:
    """One period: the current for this measured position (rad | m)."""
    ahead = feedforward.Desired(r.ahead_position, r.ahead_velocity)
    late = feedforward.Desired(r.late_position, r.late_velocity)
    forward, ptc = feedforward.step(p.plant, x.feedforward, ahead, late, r.delayed)
    if not p.with_ptc:
        forward = feedforward.Output(0.0, r.delayed)
    rub = 0.0
    if p.with_friction:
        rub = friction.stops(p.friction, x.stops, r.friction_position - x.friction_position) / p.force_constant
    error = forward.target - measured
    terms, pid = feedback.step(p.feedback, x.feedback, error)
    command = terms.proportional + terms.integral + terms.derivative + forward.current + rub
    current = min(max(command, -p.current_limit), p.current_limit)
    if current != command and error * command > 0.0:  # anti-windup: do not integrate further into the limit
        pid = feedback.State(error, x.feedback.integral, pid.derivative)
    output = Output(
        forward.target,
        error,
        terms.proportional,
        terms.integral,
        terms.derivative,
        forward.current,
        rub,
        command,
        current,
    )
    return output, State(pid, ptc, x.stops, r.friction_position)
