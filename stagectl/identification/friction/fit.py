"""One member of the friction family fitted to captures: linear in its weights, searched in the rest.

Force, acceleration, velocity and every friction column pass one filter (`filtering`).  For given theta the weights
follow from non-negative least squares; theta from a bounded search over the remaining residual (variable projection,
G. Golub, V. Pereyra, SIAM J. Numerical Analysis 10(2), 1973), begun at the best point of a grid.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.filtering import FilterDesign, decimated, design_filter, filtered_motion
from stagectl.identification.friction.members import FAMILY, LENGTH, SPEED, Member, Path, Searched
from stagectl.identification.least_squares.regression import check_directions
from stagectl.kernels import stage


class FilteredCapture(NamedTuple):
    """One capture, filtered; columns that do not depend on the friction model are decimated already."""

    path: Path
    design: FilterDesign
    fixed: Array  # (m, 3) acceleration, velocity, and one, which the filter changes a little, too
    force: Array  # (m,) N m | N
    rate: Array  # (m,) N m/s | N/s, of the force


class Scale(NamedTuple):
    """Units of the search's bounds: of lengths and of speeds."""

    step: float  # rad | m, the encoder's step or the capture's resolution
    stroke: float  # rad | m
    fastest: float  # rad/s | m/s

    def bounds(self, searched: Searched) -> tuple[float, float]:
        """Admissible values of a searched parameter."""
        low, high = searched.low, searched.high
        if searched.unit == LENGTH:
            return low * self.step, max(high * self.stroke, 10.0 * low * self.step)
        return (low * self.fastest, high * self.fastest) if searched.unit == SPEED else (low, high)


class FrictionFit(NamedTuple):
    """One member, fitted."""

    name: str
    weights: Array  # inertia, viscous, then those of the member, then the offset
    theta: Array
    residual: Array  # (m,) N m | N
    regressor: Array  # (m, k), columns of the weights
    bounds: list[tuple[float, float]]

    @property
    def member(self) -> Member:
        """The member of the family."""
        return FAMILY[self.name]

    @property
    def residual_square(self) -> float:
        """Sum of squares of the residual."""
        return float(self.residual @ self.residual)


def prepared(captures: Sequence[Capture], file: StageFile) -> tuple[list[FilteredCapture], Scale]:
    """The captures filtered, and the scale of their motion.

    Raises IdentificationError where one is too short for the filter or goes one way only.
    """
    data, steps, speeds = [], [], []
    for capture in captures:
        try:
            design = design_filter(capture.position, capture.dt)
            motion = filtered_motion(capture.position, design)
            check_directions(motion.velocity)
        except IdentificationError as error:
            raise error.within(capture.name) from error
        force, ones = file.motor.force_constant * capture.current, np.ones(len(capture.position))
        both = [force, np.gradient(force, capture.dt)]
        thin = decimated(np.column_stack([motion.acceleration, motion.velocity, ones, *both]), design)
        data.append(FilteredCapture(Path(motion.position, capture.dt), design, thin[:, :3], thin[:, 3], thin[:, 4]))
        steps.append(capture.encoder_step or _resolution(capture.position))
        speeds.append(float(np.abs(motion.velocity).max()))
    stroke = max(float(np.ptp(capture.position)) for capture in captures)
    return data, Scale(max(steps), stroke, max(speeds))


def fitted(
    name: str,
    data: Sequence[FilteredCapture],
    scale: Scale,
    rows: NDArray[np.bool_] | None = None,
    near: Array | None = None,
) -> FrictionFit:
    """The member `name` fitted to `rows` (m,) of `data`, all if None; searched from the grid, or from `near`."""
    member = FAMILY[name]
    bounds = [scale.bounds(searched) for searched in member.searched]
    low, high = np.log(np.array(bounds).reshape(-1, 2)).T

    def residual_of(logs: Array) -> Array:
        return _solved(member, data, np.exp(logs), rows)[1]

    start = np.log(near) if near is not None else _grid(residual_of, low, high)
    if len(low):
        inner = 1e-6 * (high - low)
        start = np.clip(start, low + inner, high - inner)
        evaluations = thresholds.SEARCH_STEPS if near is None else thresholds.REFIT_STEPS
        steps = [thresholds.SEARCH_DERIVATIVE] * len(low)
        start = optimize.least_squares(residual_of, start, bounds=(low, high), diff_step=steps, max_nfev=evaluations).x
    weights, residual, regressor = _solved(member, data, np.exp(start), rows)
    return FrictionFit(name, weights, np.exp(start), residual, regressor, bounds)


def plant(fit: FrictionFit, file: StageFile, slip: float) -> stage.Stage:
    """The stage model of a fit: no delay and no lag, `slip` (rad | m) where Coulomb friction would jump."""
    inertia, viscous, *weights, offset = fit.weights.tolist()
    creep = fit.weights[3] * fit.theta[2] if fit.name == "rheology" else 0.0
    return stage.Stage(
        stage.Drive(0.0, 0, file.drive.current_limit, 0.0),
        file.motor,
        stage.Mechanics(max(inertia, 1e-12), viscous + float(creep), -offset),
        fit.member.plant(weights, fit.theta.tolist(), slip),
        stage.Encoder(file.encoder.step or 0.0, 0),
    )


def _grid(residual_of: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """The best point of a grid within the bounds."""
    count = thresholds.SEARCH_GRID[len(low)]
    shares = (np.arange(count) + 0.5) / count
    points = [low + np.array(point) * (high - low) for point in itertools.product(shares, repeat=len(low))]
    return min(points, key=lambda point: float(np.sum(residual_of(point) ** 2))) if len(low) else low


def _solved(
    member: Member, data: Sequence[FilteredCapture], theta: Array, rows: NDArray[np.bool_] | None
) -> tuple[Array, Array, Array]:
    """Weights by non-negative least squares, the residual (m,) of the chosen rows, and their regressor (m, k)."""
    regressor = np.vstack([_columns(member, capture, theta) for capture in data])
    force = np.concatenate([capture.force for capture in data])
    if rows is not None:
        regressor, force = regressor[rows], force[rows]
    length = np.linalg.norm(regressor, axis=0)
    length[length == 0.0] = 1.0
    unit = regressor / length
    solution, _ = optimize.nnls(np.column_stack([unit, -unit[:, -1]]), force)  # the offset has either sign
    weights = np.append(solution[:-2], solution[-2] - solution[-1]) / length
    return weights, force - regressor @ weights, regressor


def fitted_force(fit: FrictionFit, data: Sequence[FilteredCapture]) -> Array:
    """Force (m,) N m | N of the model on all rows."""
    return np.vstack([_columns(fit.member, capture, fit.theta) for capture in data]) @ fit.weights


def sensitivity(fit: FrictionFit, data: Sequence[FilteredCapture]) -> Array:
    """Columns (m, t): how the model's force changes with the logarithm of each searched parameter."""
    columns, step = [], thresholds.SENSITIVITY_STEP
    for number in range(len(fit.theta)):
        ends = []
        for factor in (step, 1.0 / step):
            theta = fit.theta.copy()
            theta[number] *= factor
            ends.append(fitted_force(fit._replace(theta=theta), data))
        columns.append((ends[0] - ends[1]) / (2.0 * np.log(step)))
    return np.array(columns).T.reshape(len(fit.residual), len(fit.theta))


def _columns(member: Member, capture: FilteredCapture, theta: Array) -> Array:
    """Columns (m, k) of a capture: acceleration, velocity, friction, one."""
    thin = decimated(member.columns(capture.path, theta.tolist()), capture.design)
    return np.column_stack([capture.fixed[:, :2], thin, capture.fixed[:, 2]])


def _resolution(position: Array) -> float:
    steps = np.abs(np.diff(position))
    return float(steps[steps > 0.0].min())
