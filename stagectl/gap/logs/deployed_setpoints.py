"""The setpoints that a deployed controller had, from the reference of a log.

As the description of capture folders specifies.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from stagectl.compensation import model_effects
from stagectl.compensation.legs import legs
from stagectl.gap.logs.deployed_controller import DERIVATIVE, DIFFERENCES, DeployedController
from stagectl.gap.logs.grid import LoggedReference
from stagectl.gap.logs.session import Array
from stagectl.kernels import feedforward, friction, stage
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.plan import bristle_force, setpoint_rows


def setpoints_of(p: DeployedController, reference: LoggedReference, rows: int, injection: Array | None) -> Array:
    """Setpoints (rows, 8), the fields of `kernels.law.Setpoint`, with an `injection` (rows,) A if there was one.

    As the description of capture folders specifies: a quintic spline (not-a-knot) through all samples of the reference,
    constant outside; perfect tracking ahead by the command's delay, the target without; friction operators ahead by
    half a period more, from zero at the first sample.
    """
    count = rows + rows % 2  # whole frames
    at = _curve(reference)
    t: Array = p.dt * np.arange(count + 2, dtype=np.float64)
    ahead = at(t[:-2] + p.friction_advance)
    tracked, late = (np.ascontiguousarray(at(times)[:, :2]) for times in (t + p.advance, t - p.late * p.dt))
    late[_standing(np.interp(t - p.late * p.dt, reference.time, reference.value)), 1] = 0.0
    seen = feedforward.Foreseen(at(t[:-2])[:, 0].copy(), tracked, late, ahead[:, 0].copy())
    stops = friction.relaxed(p.feedforward.friction)
    setpoints = setpoint_rows(p.feedforward, seen, stops, _further_friction(p, seen, ahead))[:rows]
    if p.effects is not None and model_effects.present(p.effects):
        setpoints[:, SETPOINT_COLUMNS["friction"]] += _against_effects(p.effects, p, at, count)[:rows]
    if injection is not None:
        setpoints[:, SETPOINT_COLUMNS["injection"]] = injection
    return differenced(setpoints, p.reference_velocity, p.dt)


def differenced(setpoints: Array, kind: str, dt: float) -> Array:
    """The setpoints (n, 8) with a velocity of this `kind`, from their targets; the reference rests before and after."""
    if kind == DERIVATIVE:
        return setpoints
    before, after = DIFFERENCES[kind]
    target = np.pad(setpoints[:, SETPOINT_COLUMNS["target"]], (before, after), mode="edge")
    own = setpoints.copy()
    own[:, SETPOINT_COLUMNS["velocity"]] = (target[before + after :] - target[: len(setpoints)]) / (
        (before + after) * dt
    )
    return own


def _standing(logged: Array) -> NDArray[np.bool_]:
    """Rows from which on the reference stays for two periods; at a crest it does for one.

    The spline's velocity is only nearly 0 there, and the law asks whether it is.
    """
    moved: NDArray[np.bool_] = np.diff(logged, append=[logged[-1]] * 2) != 0.0
    standing: NDArray[np.bool_] = ~(moved[:-1] | moved[1:])
    return standing


def _curve(reference: LoggedReference) -> Callable[[Array], Array]:
    """Position, velocity and acceleration (n, 3) at any times (n,); at rest outside the samples."""
    first, last = float(reference.time[0]), float(reference.time[-1])
    spline: BSpline = make_interp_spline(reference.time, reference.value, k=5)
    derivatives = (spline.derivative(), spline.derivative(2))

    def at(t: Array) -> Array:
        inside = np.clip(t, first, last)
        moving = [np.where(inside == t, derivative(inside), 0.0) for derivative in derivatives]
        return np.stack([spline(inside), *moving], axis=1)

    return at


def _against_effects(model: stage.Stage, p: DeployedController, at: Callable[[Array], Array], count: int) -> Array:
    """Current (count,) A against the model's further effects, from rest at the first sample."""
    each = model_effects.steps(model, p.dt)
    path = at(p.dt / each * np.arange(each * count + 1, dtype=np.float64) + p.advance)
    memory = model_effects.begun(model, float(path[0, 0]))
    return model_effects.along(model, memory, path, p.dt)[0]


def _further_friction(p: DeployedController, seen: feedforward.Foreseen, ahead: Array) -> Array | None:
    """Friction (n,) N m | N that is compensated and not of stop operators; None where there is none."""
    if p.form is not None:
        force: Array = p.form.along(legs(ahead[:, 0], ahead[:, 1], p.dt))
        return force
    return bristle_force(p.bristle, seen, p.dt) if p.bristle.coulomb > 0.0 else None
