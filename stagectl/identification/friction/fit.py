"""One member of the friction family fitted to captures: linear in its weights, searched in the rest.

Force, acceleration, velocity and every friction column go through one recipe (`recipe`).  For given theta the weights
follow from non-negative least squares; theta from a bounded search over the residual that is left (variable projection,
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
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.filtering import Recipe, moved, recipe, thinned
from stagectl.identification.friction.members import FAMILY, LENGTH, SPEED, Member, Path, Searched
from stagectl.identification.least_squares import check_directions
from stagectl.kernels import stage

GRID = {0: 1, 1: 9, 2: 5, 3: 3}  # points of the grid along each of so many searched parameters
STEPS, AGAIN = 10, 3  # of the search from the grid, and from a fit of nearly the same rows


class Data(NamedTuple):
    """One capture, filtered; what does not depend on the friction model is thinned already."""

    path: Path
    recipe: Recipe
    fixed: Array  # (m, 3) acceleration, velocity, and one, which the filter changes a little, too
    force: Array  # (m,) N m | N
    rate: Array  # (m,) N m/s | N/s, of the force


class Scale(NamedTuple):
    """Bounds of what is searched for: of lengths and of speeds."""

    step: float  # rad | m, the encoder's step or the capture's resolution
    stroke: float  # rad | m
    fastest: float  # rad/s | m/s

    def bounds(self, one: Searched) -> tuple[float, float]:
        """Admissible values of a searched parameter."""
        if one.unit == LENGTH:
            return one.low * self.step, max(one.high * self.stroke, 10.0 * one.low * self.step)
        return (one.low * self.fastest, one.high * self.fastest) if one.unit == SPEED else (one.low, one.high)


class Fit(NamedTuple):
    """One member, fitted."""

    name: str
    weights: Array  # inertia, viscous, then those of the member, then the offset
    theta: Array
    residual: Array  # (m,) N m | N
    regressor: Array  # (m, k), columns of the weights
    bounds: list[tuple[float, float]]

    @property
    def member(self) -> Member:
        """What was fitted."""
        return FAMILY[self.name]


def prepared(captures: Sequence[Capture], file: StageFile) -> tuple[list[Data], Scale]:
    """The captures filtered, and the scale of their motion."""
    data, counts, speeds = [], [], []
    for capture in captures:
        try:
            how = recipe(capture.position, capture.dt)
            motion = moved(capture.position, how)
            check_directions(motion.velocity)
        except IdentificationError as error:
            raise IdentificationError(f"{capture.name}: {error}") from error
        force, one = file.motor.force_constant * capture.current, np.ones(len(capture.position))
        both = [force, np.gradient(force, capture.dt)]
        thin = thinned(np.column_stack([motion.acceleration, motion.velocity, one, *both]), how)
        data.append(Data(Path(motion.position, capture.dt), how, thin[:, :3], thin[:, 3], thin[:, 4]))
        counts.append(capture.encoder_step or _resolution(capture.position))
        speeds.append(float(np.abs(motion.velocity).max()))
    stroke = max(float(np.ptp(capture.position)) for capture in captures)
    return data, Scale(max(counts), stroke, max(speeds))


def fitted(
    name: str, data: Sequence[Data], scale: Scale, rows: NDArray[np.bool_] | None = None, near: Array | None = None
) -> Fit:
    """The member `name` fitted to `rows` (m,) of `data`, all if None; searched from the grid, or from `near`."""
    member = FAMILY[name]
    bounds = [scale.bounds(one) for one in member.searched]
    low, high = np.log(np.array(bounds).reshape(-1, 2)).T

    def left(logs: Array) -> Array:
        return _solved(member, data, np.exp(logs), rows)[1]

    start = np.log(near) if near is not None else _grid(left, low, high)
    if len(low):
        inner = 1e-6 * (high - low)
        start = np.clip(start, low + inner, high - inner)
        steps = STEPS if near is None else AGAIN
        start = optimize.least_squares(left, start, bounds=(low, high), diff_step=[1e-3] * len(low), max_nfev=steps).x
    weights, residual, regressor = _solved(member, data, np.exp(start), rows)
    return Fit(name, weights, np.exp(start), residual, regressor, bounds)


def plant(one: Fit, file: StageFile, slip: float) -> stage.Stage:
    """The stage model of a fit: no delay and no lag, `slip` (rad | m) where Coulomb friction would jump."""
    inertia, viscous, *weights, offset = one.weights.tolist()
    creep = one.weights[3] * one.theta[2] if one.name == "rheology" else 0.0
    return stage.Stage(
        stage.Drive(0.0, 0, file.drive.current_limit, 0.0),
        file.motor,
        stage.Mechanics(max(inertia, 1e-12), viscous + float(creep), -offset),
        one.member.plant(weights, one.theta.tolist(), slip),
        stage.Encoder(file.encoder.step or 0.0, 0),
    )


def _grid(left: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """The best point of a grid within the bounds."""
    count = GRID[len(low)]
    shares = (np.arange(count) + 0.5) / count
    points = [low + np.array(point) * (high - low) for point in itertools.product(shares, repeat=len(low))]
    return min(points, key=lambda point: float(np.sum(left(point) ** 2))) if len(low) else low


def _solved(
    member: Member, data: Sequence[Data], theta: Array, rows: NDArray[np.bool_] | None
) -> tuple[Array, Array, Array]:
    """Weights by non-negative least squares, the residual (m,) of the chosen rows, and their regressor (m, k)."""
    regressor = np.vstack([_columns(member, one, theta) for one in data])
    force = np.concatenate([one.force for one in data])
    if rows is not None:
        regressor, force = regressor[rows], force[rows]
    length = np.linalg.norm(regressor, axis=0)
    length[length == 0.0] = 1.0
    unit = regressor / length
    solution, _ = optimize.nnls(np.column_stack([unit, -unit[:, -1]]), force)  # the offset has either sign
    weights = np.append(solution[:-2], solution[-2] - solution[-1]) / length
    return weights, force - regressor @ weights, regressor


def columns_of(one: Fit, data: Sequence[Data]) -> Array:
    """Columns (m, k) of the weights, on all rows."""
    return np.vstack([_columns(one.member, each, one.theta) for each in data])


def sensitivity(one: Fit, data: Sequence[Data]) -> Array:
    """Columns (m, t): how the model's force changes with the logarithm of each searched parameter."""
    found = []
    for number in range(len(one.theta)):
        ends = []
        for factor in (1.02, 1.0 / 1.02):
            theta = one.theta.copy()
            theta[number] *= factor
            ends.append(np.vstack([_columns(one.member, each, theta) for each in data]) @ one.weights)
        found.append((ends[0] - ends[1]) / (2.0 * np.log(1.02)))
    return np.array(found).T.reshape(len(one.residual), len(one.theta))


def _columns(member: Member, one: Data, theta: Array) -> Array:
    """Columns (m, k) of a capture: acceleration, velocity, friction, one."""
    thin = thinned(member.columns(one.path, theta.tolist()), one.recipe)
    return np.column_stack([one.fixed[:, :2], thin, one.fixed[:, 2]])


def _resolution(position: Array) -> float:
    steps = np.abs(np.diff(position))
    return float(steps[steps > 0.0].min())
