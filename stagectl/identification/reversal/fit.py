"""Friction around the zero crossing of the velocity: three parameters of each form by an evolutionary search.

The fit uses ``F = Kt i - M a - D v`` (zero phase), never the raw force: near the crossing ``M a`` is as large as the
friction.  The constant parts C1 and C2 are means over the spans of steady speed.  The remaining parameters of each
form, two shapes and the force ``Cs`` at the crossing, are found by differential evolution (scipy), followed by a local
polish (L-BFGS-B).  ``Cs`` stays between the constant friction and the largest force seen.  Without these bounds two
forms leave that range.  The paper's exponential leaves the crossing too steeply for a spring and compensates by a force
that was never seen.  The symmetric curve jumps where the friction changes steadily, and compensates by a dip where the
friction is largest.

Source: the friction paper of the linear slider, section 3 (there: a genetic algorithm).
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize, stats

from stagectl.compensation.legs import Array, Legs
from stagectl.compensation.zero_crossing import FORMS, Displacement, Form
from stagectl.identification import thresholds
from stagectl.identification.capture import IdentificationError, Refusal
from stagectl.identification.reversal.reversals import Reversals
from stagectl.identification.standard_errors import integrated_autocorrelation

SIGMAS = float(stats.norm.ppf(thresholds.QUANTILE_95))


class ConstantFriction(NamedTuple):
    """C1 and C2 (N m | N), each with half of its 95 % interval, and the speed they hold at."""

    positive: float
    negative: float
    spread: tuple[float, float]
    speed: float


class ReversalData(NamedTuple):
    """The windows of all reversals, one after another."""

    cut: Legs  # two legs for each reversal; the first of them in motion for long
    friction: Array  # (n,) N m | N
    constant: ConstantFriction
    largest: float  # N m | N, median over the reversals of the largest force
    resolution: float  # s
    length: float  # rad | m, farthest from a crossing


class FormFit(NamedTuple):
    """One form, fitted."""

    form: Form
    residual: Array  # (n,) N m | N
    interval: tuple[Array, Array]  # (k,) ends of the 95 % intervals of the k searched parameters, within the search
    constant: Array  # (2,) halves of the 95 % intervals of C1 and C2
    at_bound: bool  # Cs, where it is held in physical bounds, lies at one of them
    evaluations: int


def gathered(captures: list[Reversals]) -> ReversalData:
    """The windows of all reversals: at most MOST_REVERSALS, thinned to MOST_REVERSAL_ROWS rows."""
    pairs = [(capture, reversal) for capture in captures for reversal in capture.reversals]
    chosen = [
        pairs[j] for j in np.unique(np.linspace(0, len(pairs) - 1, thresholds.MOST_REVERSALS).round().astype(int))
    ]
    total = sum(reversal.last - reversal.first for _, reversal in chosen)
    stride = max(1, -(-total // thresholds.MOST_REVERSAL_ROWS))
    columns: list[list[Any]] = [[] for _ in range(6)]
    way, largest = [0.0], []
    for number, (capture, reversal) in enumerate(chosen):
        rows, motion = slice(reversal.first, reversal.last + 1, stride), capture.motion
        cut = motion.cut
        leg = 1 + 2 * number + (cut.leg[rows] == reversal.leg)
        parts = (leg, cut.since[rows], cut.until[rows], cut.covered[rows], cut.speed[rows], motion.friction[rows])
        for column, part in zip(columns, parts, strict=True):
            column.append(part)
        way.extend((float(cut.way[reversal.leg - 1]), float(cut.way[reversal.leg])))
        largest.append(float(np.max(np.abs(motion.friction[reversal.first : reversal.last + 1]))))
    leg, since, until, covered, speed, friction = (np.concatenate(column) for column in columns)
    start = np.array([0.0, *[edge for _ in chosen for edge in (-np.inf, 0.0)]])
    end = np.array([0.0, *[edge for _ in chosen for edge in (0.0, np.inf)]])
    cut = Legs(leg.astype(np.intp), since, until, covered, speed, np.array(way), start, end, np.full(len(way), np.inf))
    length = float(np.max(covered[np.isfinite(covered)]))
    return ReversalData(cut, friction, constant(captures), float(np.median(largest)), captures[0].motion.dt, length)


def constant(captures: list[Reversals]) -> ConstantFriction:
    """C1 and C2 over the fastest spans of all captures, with 95 % intervals from the spread between spans.

    Raises IdentificationError where one direction has no span of that speed.
    """
    fastest = max(span.speed for capture in captures for span in capture.spans)
    forces: dict[float, list[float]] = {1.0: [], -1.0: []}
    for capture in captures:
        for span in capture.spans:
            if span.speed >= thresholds.FASTEST_SPANS * fastest:
                forces[float(capture.motion.cut.way[span.leg])].append(span.force)
    for way, name in ((1.0, "positive"), (-1.0, "negative")):
        if not forces[way]:
            least = thresholds.FASTEST_SPANS * fastest
            raise IdentificationError(
                f"no steady span in the {name} direction reaches {least:.4g} (axis units a second), the speed of the "
                "other direction; record the same speed both ways",
                Refusal.NO_STEADY_SPEED,
                value=name,
                unit="rad/s | m/s",
                admissible=f"[{least:.4g}, inf)",
            )
    (up, above), (down, below) = (_mean(forces[way]) for way in (1.0, -1.0))
    return ConstantFriction(up, down, (above, below), fastest)


def _mean(values: list[float]) -> tuple[float, float]:
    """Mean, and half of its 95 % interval; with one value it is not known and taken as the limit of the settling."""
    mean = float(np.mean(values))
    if len(values) == 1:
        return mean, thresholds.SETTLED_SPAN * abs(mean)
    return mean, float(
        stats.t.ppf(thresholds.QUANTILE_95, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values))
    )


def fitted(
    name: str, data: ReversalData, seed: int, generation: Callable[..., None] | None = None, physical: bool = True
) -> FormFit:
    """`name` fitted to `data`; `physical` keeps Cs between the constant friction and the largest force seen."""
    low, high = bounds(name, data, physical)

    def cost(z: Array) -> float:
        return misfit(name, z, data)

    minimum = optimize.differential_evolution(
        cost,
        optimize.Bounds(np.log(low), np.log(high)),
        rng=seed,
        popsize=thresholds.POPULATION,
        maxiter=thresholds.GENERATIONS,
        tol=thresholds.SEARCH_TOLERANCE,
        callback=generation,
        polish=True,
    )
    x = np.exp(np.asarray(minimum.x, dtype=np.float64))
    at_bound = not low[-1] * (1.0 + thresholds.AT_BOUND) < x[-1] < high[-1] * (1.0 - thresholds.AT_BOUND)
    covariance = _covariance(name, x, data)
    spread = SIGMAS * np.sqrt(np.diag(covariance))
    interval = np.clip(x - spread, low, x), np.clip(x + spread, x, np.maximum(x, high))
    constant = _constant_spread(name, x, data, covariance)
    return FormFit(
        _form(name, x, data.constant), _residual(name, x, data), interval, constant, at_bound, int(minimum.nfev)
    )


def _form(name: str, x: Array, constant: ConstantFriction) -> Form:
    values = tuple(float(value) for value in x)
    if name == "displacement":  # the spans lie on its curve, a little above its constant part
        rest = math.exp(-constant.speed / values[0])
        up, down = (max((force - values[-1] * rest) / (1.0 - rest), 0.0) for force in constant[:2])
        return Displacement._make((*values, up, down))
    return FORMS[name]._make((*values, constant.positive, constant.negative))


def _residual(name: str, x: Array, data: ReversalData) -> Array:
    return data.friction - _form(name, x, data.constant).along(data.cut)


def misfit(name: str, z: Array, data: ReversalData) -> float:
    """Sum of squares (N^2 m^2 | N^2) that the search makes small; `z` (k,) are logarithms of shapes and Cs."""
    residual = _residual(name, np.exp(z), data)
    return float(residual @ residual)


def bounds(name: str, data: ReversalData, physical: bool) -> tuple[Array, Array]:
    """Lowest and highest shapes and Cs (k,): of the shapes by the resolution of the capture, of Cs by its forces."""
    longest = float(np.max(np.where(np.isfinite(data.cut.until), data.cut.until, 0.0)))
    time = (data.resolution, max(longest, 10.0 * data.resolution))
    shapes = {
        "displacement": [(1e-3 * data.constant.speed, data.constant.speed), (1e-6 * data.length, data.length)],
        "symmetric": [time],
    }.get(name, [time, time])
    least = min(data.constant.positive, data.constant.negative)
    static = (
        (least, max(thresholds.STATIC_ALLOWANCE * data.largest, 1.001 * least))
        if physical
        else (thresholds.STATIC_DIP * least, thresholds.STATIC_FREE * data.largest)
    )
    low, high = zip(*shapes, static, strict=True)
    return np.array(low), np.array(high)


def _covariance(name: str, x: Array, data: ReversalData) -> Array:
    """Of the searched parameters (k, k): local Jacobian, residual taken as coloured noise.

    The residual is mostly model error, so it is correlated along the window; the variance grows by the integrated
    autocorrelation.
    """
    step = thresholds.DERIVATIVE_STEP * x
    columns = [(_residual(name, x - d, data) - _residual(name, x + d, data)) / 2.0 for d in np.diag(step)]
    jacobian = np.column_stack(columns) / step
    residual = _residual(name, x, data)
    variance = float(residual @ residual) / max(len(residual) - len(x), 1) * integrated_autocorrelation(residual)
    _, size, turn = np.linalg.svd(jacobian * x, full_matrices=False)
    half = turn.T / np.maximum(size, thresholds.SINGULAR * size[0])  # insensitive directions get a wide interval
    return np.asarray(variance * np.outer(x, x) * (half @ half.T), dtype=np.float64)


def _constant_spread(name: str, x: Array, data: ReversalData, covariance: Array) -> Array:
    """Halves of the 95 % intervals of C1 and C2: from the spans and from the fit."""
    ends = [
        [_form(name, x + way * d, data.constant)[-2:] for way in (1.0, -1.0)]
        for d in np.diag(thresholds.DERIVATIVE_STEP * x)
    ]
    gradient = np.array([np.subtract(above, below) for above, below in ends]) / (
        2.0 * thresholds.DERIVATIVE_STEP * x[:, None]
    )
    of_the_fit = np.einsum("ia,ij,ja->a", gradient, covariance, gradient)
    return np.asarray(np.hypot(data.constant.spread, SIGMAS * np.sqrt(of_the_fit)), dtype=np.float64)
