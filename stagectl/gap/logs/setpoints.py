"""What a deployed controller knew beforehand in each period, recomputed from the reference that was logged.

As the description of capture folders has it: a quintic spline (not-a-knot) through all samples of the reference,
constant outside; perfect tracking ahead by the command's delay, the target without; friction operators ahead by half a
period more, zero at the first sample.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from stagectl.gap.logs.deployed_controller import DeployedController
from stagectl.gap.logs.session import Array
from stagectl.kernels import feedforward, friction, friction_path, rollout
from stagectl.kernels.law import Setpoint

LEAST = 6  # samples that a quintic spline needs
_COLUMN = {name: number for number, name in enumerate(Setpoint._fields)}


class LoggedReference(NamedTuple):
    """What a log says of the motion that was asked for."""

    time: Array  # (m,) s, of the reference's samples; row k of the log is at k Ts
    reference: Array  # (m,) rad | m
    rows: int  # of the log
    injection: Array | None = None  # (rows,) A


def setpoint_rows(p: DeployedController, asked: LoggedReference) -> Array:
    """Setpoints (rows, 8), the fields of `kernels.law.Setpoint`."""
    count = asked.rows + asked.rows % 2  # whole frames
    at = _curve(asked)
    t: Array = p.dt * np.arange(count + 2, dtype=np.float64)
    late = at(t - p.late * p.dt)
    seen = feedforward.Foreseen(
        at(t[:-2])[:, 0].copy(), at(t + p.advance), late, at(t[:-2] + p.friction_advance)[:, 0].copy()
    )
    found = np.zeros((count, rollout.SETPOINTS))
    feedforward.setpoints(p.feedforward, seen, friction.relaxed(p.feedforward.friction), found)
    found[:, _COLUMN["friction"]] += _compensation(p, seen, at(t[:-2] + p.friction_advance))
    found = found[: asked.rows]
    if asked.injection is not None:
        found[:, _COLUMN["injection"]] = asked.injection
    return found


def _curve(asked: LoggedReference) -> Callable[[Array], Array]:
    """Position and velocity (n, 2) at any times (n,); outside it stands at its first or last sample."""
    first, last = float(asked.time[0]), float(asked.time[-1])
    spline: BSpline = make_interp_spline(asked.time, asked.reference, k=5)
    speed = spline.derivative()

    def at(t: Array) -> Array:
        inside = np.clip(t, first, last)
        return np.ascontiguousarray(np.stack([spline(inside), np.where(inside == t, speed(inside), 0.0)], axis=1))

    return at


def _compensation(p: DeployedController, seen: feedforward.Foreseen, ahead: Array) -> Array:
    """Current (n,) A of a friction compensation that is none of stop operators."""
    if p.form is not None:
        force: Array = p.form.force(ahead[:, 0], ahead[:, 1], p.dt)
    elif p.bristle.coulomb > 0.0:
        place = np.concatenate([seen.reference[:1], seen.friction])
        columns = np.empty((len(place), 2))
        friction_path.bristle(p.bristle, place, p.dt, columns)
        force = (columns[:, 0] + p.bristle.damping * columns[:, 1])[1:]
    else:
        return np.zeros(len(ahead))
    return force / p.feedforward.force_constant
