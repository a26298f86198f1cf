"""P position, PI velocity, force filter and velocity feedforward: the cascade of the linear slider's paper.

::

    position error --> Kp --(+)--(-)--> Kv (1 + 1/(Ti s)) --> 1/(Tf s + 1) --> current
                             ^    ^
        share x reference velocity   velocity, by differences of the measured position

Source: the friction paper of the linear slider, Fig. 2 (Kp, Kv, Ti, Tf, FF); discretised by Tustin's rule, the
filter exactly.  With an average of two positions before the difference (``span`` = 2) it is the controller of the EMPS
benchmark: ``(q[k] + q[k-1])/2 - (q[k-1] + q[k-2])/2 = (q[k] - q[k-2])/2``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.kernels import feedback
from stagectl.kernels.jit import kernel


class Cascade(NamedTuple):
    """The cascade at its control period, ready to run."""

    position: float = 0.0  # Kp, 1/s
    velocity: float = 0.0  # Kv/Kt, A s/rad | A s/m
    integral: float = 0.0  # Kv Ts/(2 Ti Kt)
    retained: float = 0.0  # exp(-Ts/Tf): what the force filter keeps of the last period; 0 is no filter
    share: float = 0.0  # of the reference velocity that is fed forward
    span: int = 1  # periods over which the velocity is differenced, 1 or 2
    dt: float = 1.0  # s


class State(NamedTuple):
    """Memory of the cascade; NaN is a position that has not been measured yet."""

    error: float  # rad/s | m/s, velocity error of the last period
    integral: float  # A
    filtered: float  # A, behind the force filter
    last: float  # rad | m, position one period ago
    before: float  # rad | m, position two periods ago


AT_REST = State(0.0, 0.0, 0.0, math.nan, math.nan)
ABSENT = Cascade()


@kernel
def step(p: Cascade, x: State, asked: tuple[float, float], measured: float) -> tuple[feedback.Output, State]:
    """One period for `asked` = (position error, reference velocity) and the `measured` position (rad | m).

    The terms sum up to the filtered force; the third one is what the force filter holds back or gives later.
    """
    error, reference = asked
    last = measured if math.isnan(x.last) else x.last
    before = last if math.isnan(x.before) else x.before
    moved = measured - last if p.span == 1 else 0.5 * (measured - before)
    wanted = p.position * error + p.share * reference - moved / p.dt
    proportional = p.velocity * wanted
    integral = x.integral + p.integral * (wanted + x.error)
    force = proportional + integral
    filtered = p.retained * x.filtered + (1.0 - p.retained) * force
    return feedback.Output(proportional, integral, filtered - force), State(wanted, integral, filtered, measured, last)
