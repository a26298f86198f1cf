"""Setpoints of a deployed controller in each period, recomputed from the logged reference.

As the description of capture folders specifies: a quintic spline (not-a-knot) through all samples of the reference,
constant outside; perfect tracking ahead by the command's delay, the target without; friction operators ahead by half a
period more, from zero at the first sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from stagectl.compensation.legs import legs
from stagectl.gap.logs.deployed_controller import DeployedController
from stagectl.gap.logs.grid import LoggedReference
from stagectl.gap.logs.session import Array
from stagectl.kernels import feedforward, friction
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.plan import bristle_force, setpoint_rows


def from_reference(p: DeployedController, reference: LoggedReference, rows: int, injection: Array | None) -> Array:
    """Setpoints (rows, 8), the fields of `kernels.law.Setpoint`, with an `injection` (rows,) A if there was one."""
    count = rows + rows % 2  # whole frames
    at = _curve(reference)
    t: Array = p.dt * np.arange(count + 2, dtype=np.float64)
    ahead = at(t[:-2] + p.friction_advance)
    seen = feedforward.Foreseen(at(t[:-2])[:, 0].copy(), at(t + p.advance), at(t - p.late * p.dt), ahead[:, 0].copy())
    stops = friction.relaxed(p.feedforward.friction)
    setpoints = setpoint_rows(p.feedforward, seen, stops, _further_friction(p, seen, ahead))[:rows]
    if injection is not None:
        setpoints[:, SETPOINT_COLUMNS["injection"]] = injection
    return setpoints


def _curve(reference: LoggedReference) -> Callable[[Array], Array]:
    """Position and velocity (n, 2) at any times (n,); at rest outside the samples."""
    first, last = float(reference.time[0]), float(reference.time[-1])
    spline: BSpline = make_interp_spline(reference.time, reference.value, k=5)
    speed = spline.derivative()

    def at(t: Array) -> Array:
        inside = np.clip(t, first, last)
        return np.ascontiguousarray(np.stack([spline(inside), np.where(inside == t, speed(inside), 0.0)], axis=1))

    return at


def _further_friction(p: DeployedController, seen: feedforward.Foreseen, ahead: Array) -> Array | None:
    """Friction (n,) N m | N that is compensated and not of stop operators; None where there is none."""
    if p.form is not None:
        force: Array = p.form.along(legs(ahead[:, 0], ahead[:, 1], p.dt))
        return force
    return bristle_force(p.bristle, seen, p.dt) if p.bristle.coulomb > 0.0 else None
