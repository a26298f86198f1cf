"""The deployed control law: PID on the target, plus what is known beforehand, limited.

::

    trajectory --> plan ----- target y0 ------>(-)--> PID -------- feedback -->(+)--> limit --> current
                    |                           ^ measured                      ^
                    +-- feedforward (PTC) + friction compensation --------------+

What depends on the reference alone is computed before the motion (`kernels.feedforward`); what is left for the
period is a subtraction, a PID and a limit.  One function, wherever the law runs: loop, simulator, replay, tests.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from stagectl.kernels import feedback
from stagectl.kernels.jit import kernel
from stagectl.units import Quantity

_ANY = "[-inf, inf]"


class Law(NamedTuple):
    """Parameters of the law, designed for one stage at one control period."""

    feedback: feedback.Pid
    current_limit: float  # A


class Setpoint(NamedTuple):
    """All that is known of a period beforehand."""

    reference: Annotated[float, Quantity("rad | m", _ANY, "commanded position now")]
    target: Annotated[float, Quantity("rad | m", _ANY, "y0, what the measured position is compared with")]
    feedforward: Annotated[float, Quantity("A", _ANY, "perfect tracking feedforward")]
    friction: Annotated[float, Quantity("A", _ANY, "friction compensation")]


class Output(NamedTuple):
    """The command and the terms of it that the setpoint does not hold."""

    error: Annotated[float, Quantity("rad | m", _ANY, "target minus measured")]
    proportional: Annotated[float, Quantity("A", _ANY, "feedback, proportional term")]
    integral: Annotated[float, Quantity("A", _ANY, "feedback, integral term")]
    derivative: Annotated[float, Quantity("A", _ANY, "feedback, derivative term")]
    command: Annotated[float, Quantity("A", _ANY, "sum of all terms, before any limit")]
    current: Annotated[float, Quantity("A", _ANY, "command handed to the drive, after the limit")]


@kernel
def step(p: Law, x: feedback.State, r: Setpoint, measured: float) -> tuple[Output, feedback.State]:
    """One period: the current for this measured position (rad | m)."""
    error = r.target - measured
    terms, state = feedback.step(p.feedback, x, error)
    command = terms.proportional + terms.integral + terms.derivative + r.feedforward + r.friction
    current = command
    if command > p.current_limit:
        current = p.current_limit
    elif command < -p.current_limit:
        current = -p.current_limit
    if current != command and error * command > 0.0:  # anti-windup: do not integrate further into the limit
        state = feedback.State(error, x.integral, state.derivative)
    return Output(error, terms.proportional, terms.integral, terms.derivative, command, current), state
