"""One member of the friction family fitted to captures: linear in its weights, searched in the rest.

Force, acceleration, velocity and every friction column pass one filter (`filtering`).  For given theta the weights
follow from non-negative least squares; theta and the member's own delay from a bounded search over the remaining
residual (variable projection, G. Golub, V. Pereyra, SIAM J. Numerical Analysis 10(2), 1973), begun at the best point of
a grid.  A delay that one law finds is not that of another: it takes up what the law does not explain.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.interpolate import CubicSpline

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal, each
from stagectl.identification.filtering import FilterDesign, decimated, design_filter, filtered_motion
from stagectl.identification.friction.members import FAMILY, LENGTH, SPEED, Member, Path, Searched
from stagectl.identification.least_squares.regression import check_directions
from stagectl.identification.simultaneous.model import DelayPrior
from stagectl.identification.simultaneous.refinement import tangent
from stagectl.kernels import stage


class FilteredCapture(NamedTuple):
    """One capture, filtered; columns that do not depend on the friction model are decimated already."""

    path: Path
    design: FilterDesign
    fixed: Array  # (m, 3) acceleration, velocity, and one, which the filter changes a little, too
    forces: CubicSpline  # delay (s) -> (m,) N m | N


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
    delay: float = 0.0  # s, by which the force follows the current

    @property
    def member(self) -> Member:
        """The member of the family."""
        return FAMILY[self.name]

    @property
    def residual_square(self) -> float:
        """Sum of squares of the residual."""
        return float(self.residual @ self.residual)


class Data(NamedTuple):
    """Rows that a member is fitted to."""

    captures: Sequence[FilteredCapture]
    scale: Scale
    delay: DelayPrior

    def force(self, delay: float) -> Array:
        """Force (m,) N m | N of all captures at this delay (s)."""
        return np.concatenate([capture.forces(delay) for capture in self.captures])

    def rate(self, delay: float) -> Array:
        """Change of the force (m,) with time, N m/s | N/s."""
        return -np.concatenate([capture.forces(delay, 1) for capture in self.captures])


def prepared(captures: Sequence[Capture], file: StageFile, delay: DelayPrior) -> Data:
    """The captures filtered, with their force at the delays that are looked at, and the scale of their motion.

    Raises IdentificationError where one is too short for the filter, or all go one way only.
    """
    data, velocities = [], []
    designs = each(captures, lambda capture: design_filter(capture.position, capture.dt), lambda done, total: None)
    for capture, design in zip(captures, designs, strict=True):
        motion = filtered_motion(capture.position, design)
        fixed = np.column_stack([motion.acceleration, motion.velocity, np.ones(len(capture.position))])
        forces = delayed_forces(capture, design, file.motor.force_constant, delay)
        data.append(FilteredCapture(Path(motion.position, capture.dt), design, decimated(fixed, design), forces))
        velocities.append(motion.velocity)
    velocity = np.concatenate(velocities)
    steps = [capture.encoder_step or _resolution(capture.position) for capture in captures]
    try:
        check_directions(velocity)
    except IdentificationError as error:
        raise error.within(", ".join(capture.name for capture in captures)) from error
    stroke = max(float(np.ptp(capture.position)) for capture in captures)
    return Data(data, Scale(max(steps), stroke, float(np.abs(velocity).max())), delay)


def delayed_forces(capture: Capture, design: FilterDesign, gain: float, delay: DelayPrior) -> CubicSpline:
    """The filtered force (m,) at any delay (s) near the given one, or as far as its prior reaches.

    Raises IdentificationError where a delay is longer than what the filter cuts off at the ends.
    """
    nodes = delay.nodes if delay.deviation else delay.mean + thresholds.DELAY_STEP * np.arange(-2.0, 3.0)
    longest = design.edge * capture.dt
    if abs(delay.mean) > longest:
        raise IdentificationError(
            f"{capture.name}: delay = {1e3 * delay.mean:.4g} ms; must be within ±{1e3 * longest:.4g} ms, which the "
            "filter cuts off at each end",
            Refusal.UNKNOWN_OPTION,
            capture=capture.name,
            value=delay.mean,
            unit="s",
            admissible=f"[{-longest:g}, {longest:g}]",
        )
    current = CubicSpline(capture.time, gain * capture.current)
    late = np.clip(capture.time[:, None] - nodes, 0.0, capture.time[-1])
    return CubicSpline(nodes, decimated(current(late), design), axis=1)


def fitted(
    name: str, data: Data, rows: NDArray[np.bool_] | None = None, near: FrictionFit | None = None
) -> FrictionFit:
    """The member `name` and its own delay, fitted to `rows` (m,), all if None; from a grid, or from a fit that is near.

    The last of what is searched for is the delay, in deviations of its prior, unless it is given.
    """
    member, delay = FAMILY[name], data.delay
    bounds = [data.scale.bounds(searched) for searched in member.searched]
    span = [[-thresholds.DELAY_SPAN, thresholds.DELAY_SPAN]] if delay.deviation else []
    low, high = np.vstack([np.log(np.array(bounds).reshape(-1, 2)), np.array(span).reshape(-1, 2)]).T
    count = len(bounds)

    def late(u: Array) -> float:
        return delay.mean + delay.deviation * float(u[count:].sum())

    def residual_of(u: Array) -> Array:
        return _solved(member, data, np.exp(u[:count]), late(u), rows)[1]

    if near is not None:
        shift = [(near.delay - delay.mean) / delay.deviation] if delay.deviation else []
        starts, evaluations = [np.append(np.log(near.theta), shift)], thresholds.REFIT_STEPS
    else:
        starts, evaluations = _grid(residual_of, low, high, count), thresholds.SEARCH_STEPS * (1 + len(span))
    start = _searched(residual_of, starts, (low, high), evaluations) if len(low) else starts[0]
    weights, residual, regressor = _solved(member, data, np.exp(start[:count]), late(start), rows)
    return FrictionFit(name, weights, np.exp(start[:count]), residual, regressor, bounds, late(start))


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


def _searched(
    residual_of: Callable[[Array], Array], starts: list[Array], edges: tuple[Array, Array], evaluations: int
) -> Array:
    """The best of the searches from all `starts` within the edges."""
    low, high = edges
    inner = 1e-6 * (high - low)
    steps = [thresholds.SEARCH_DERIVATIVE] * len(low)
    found = [
        optimize.least_squares(
            residual_of, np.clip(start, low + inner, high - inner), bounds=edges, diff_step=steps, max_nfev=evaluations
        )
        for start in starts
    ]
    return np.asarray(min(found, key=lambda fit: float(fit.cost)).x)


def _grid(residual_of: Callable[[Array], Array], low: Array, high: Array, searched: int) -> list[Array]:
    """The best points of a grid over the first `searched` within the bounds, the others in their middle."""
    count = thresholds.SEARCH_GRID[searched]
    shares, middle = (np.arange(count) + 0.5) / count, [0.5] * (len(low) - searched)
    grid = itertools.product(shares, repeat=searched)
    points = [low + np.array([*point, *middle]) * (high - low) for point in grid]
    if len(points) == 1:
        return points
    return sorted(points, key=lambda point: float(np.sum(residual_of(point) ** 2)))[
        : thresholds.SEARCH_STARTS if middle else 1
    ]


def _solved(
    member: Member, data: Data, theta: Array, delay: float, rows: NDArray[np.bool_] | None
) -> tuple[Array, Array, Array]:
    """Weights by non-negative least squares, the residual (m,) of the chosen rows, and their regressor (m, k)."""
    regressor = np.vstack([_columns(member, capture, theta) for capture in data.captures])
    force = data.force(delay)
    if rows is not None:
        regressor, force = regressor[rows], force[rows]
    length = np.linalg.norm(regressor, axis=0)
    length[length == 0.0] = 1.0
    unit = regressor / length
    solution, _ = optimize.nnls(np.column_stack([unit, -unit[:, -1]]), force)  # the offset has either sign
    weights = np.append(solution[:-2], solution[-2] - solution[-1]) / length
    return weights, force - regressor @ weights, regressor


def fitted_force(fit: FrictionFit, data: Data) -> Array:
    """Force (m,) N m | N of the model on all rows."""
    return np.vstack([_columns(fit.member, capture, fit.theta) for capture in data.captures]) @ fit.weights


def sensitivity(fit: FrictionFit, data: Data) -> Array:
    """Columns (m, t): how the model's force changes with the logarithm of each searched parameter."""
    return tangent(lambda theta: fitted_force(fit._replace(theta=theta), data), fit.theta, len(fit.residual))


def _columns(member: Member, capture: FilteredCapture, theta: Array) -> Array:
    """Columns (m, k) of a capture: acceleration, velocity, friction, one."""
    thin = decimated(member.columns(capture.path, theta.tolist()), capture.design)
    return np.column_stack([capture.fixed[:, :2], thin, capture.fixed[:, 2]])


def _resolution(position: Array) -> float:
    steps = np.abs(np.diff(position))
    return float(steps[steps > 0.0].min())
