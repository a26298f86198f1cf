"""Friction around the zero crossing of the velocity: three parameters of each form by an evolutionary search.

On ``F = Kt i - M a - D v`` (zero phase), never on the raw force: near the crossing ``M a`` is as large as what is
sought.  The constant parts C1 and C2 are means over the spans of steady speed; what remains of each form - two
shapes and the force ``Cs`` at the crossing - is found by differential evolution (scipy), followed by a local
polish (L-BFGS-B).  ``Cs`` stays between the constant friction and the largest force seen.  Free of these bounds the
paper's exponential, which leaves the crossing too steeply for a spring, makes up for it by a force that no one saw,
and the symmetric curve, which jumps where the friction goes over steadily, by a dip where it is largest.

Source: the friction paper of the linear slider, section 3 (there: a genetic algorithm).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize, stats

from stagectl.compensation.legs import Array, Legs
from stagectl.compensation.zero_crossing import FORMS, Displacement, Form
from stagectl.identification.capture import IdentificationError
from stagectl.identification.reversal.reversals import Reversals

MOST_REVERSALS, MOST_ROWS = 12, 2000  # of all captures together: more would not change the answer
GENERATIONS, POPULATION, TOLERANCE = 150, 10, 1e-6
ALLOWANCE = 1.05  # on the largest force seen: the low-pass and the thinning take something from a peak
DIP = 1e-3  # times the constant friction: how low the search without the physical bounds may go
FREE = 4.0  # times the largest force seen: how high
FASTEST = 0.9  # of the largest speed: spans that tell the constant parts
AT_BOUND = 1e-3
STEP = 1e-4  # of a parameter, for derivatives
SINGULAR = 1e-6  # of the largest singular value
SURE = 0.975
SIGMAS = float(stats.norm.ppf(SURE))


class Constant(NamedTuple):
    """C1 and C2 (N m | N), each with half of its 95 % interval, and the speed they hold at."""

    positive: float
    negative: float
    spread: tuple[float, float]
    speed: float


class Data(NamedTuple):
    """The windows of all reversals, one after another."""

    cut: Legs  # two legs for each reversal; the first of them in motion for long
    friction: Array  # (n,) N m | N
    constant: Constant
    largest: float  # N m | N, median over the reversals of the largest force
    resolution: float  # s
    length: float  # rad | m, farthest from a crossing


class Fit(NamedTuple):
    """One form, fitted."""

    form: Form
    residual: Array  # (n,) N m | N
    interval: tuple[Array, Array]  # (k,) ends of the 95 % intervals of the k searched parameters, within the search
    constant: Array  # (2,) halves of the 95 % intervals of C1 and C2
    at_bound: bool  # Cs, where it is held in physical bounds, lies at one of them
    evaluations: int


def gathered(seen: list[Reversals]) -> Data:
    """The windows of all reversals in one: at most MOST_REVERSALS, thinned out to MOST_ROWS rows."""
    pairs = [(one, reversal) for one in seen for reversal in one.reversals]
    chosen = [pairs[j] for j in np.unique(np.linspace(0, len(pairs) - 1, MOST_REVERSALS).round().astype(int))]
    total = sum(reversal.last - reversal.first for _, reversal in chosen)
    stride = max(1, -(-total // MOST_ROWS))
    columns: list[list[Any]] = [[] for _ in range(6)]
    way, largest = [0.0], []
    for number, (one, reversal) in enumerate(chosen):
        rows, motion = slice(reversal.first, reversal.last + 1, stride), one.motion
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
    return Data(cut, friction, constant(seen), float(np.median(largest)), seen[0].motion.dt, length)


def constant(seen: list[Reversals]) -> Constant:
    """C1 and C2 over the fastest spans of all captures, with 95 % intervals from the spread between spans."""
    fastest = max(span.speed for one in seen for span in one.spans)
    forces: dict[float, list[float]] = {1.0: [], -1.0: []}
    for one in seen:
        for span in one.spans:
            if span.speed >= FASTEST * fastest:
                forces[float(one.motion.cut.way[span.leg])].append(span.force)
    for way, name in ((1.0, "positive"), (-1.0, "negative")):
        if not forces[way]:
            raise IdentificationError(
                f"no steady span in the {name} direction reaches {FASTEST * fastest:.4g} (axis units a second), the "
                "speed of the other direction; record the same speed both ways"
            )
    (up, above), (down, below) = (_mean(forces[way]) for way in (1.0, -1.0))
    return Constant(up, down, (above, below), fastest)


def _mean(values: list[float]) -> tuple[float, float]:
    """Mean, and half of its 95 % interval; with one value that is not known, and taken for the settling's limit."""
    mean = float(np.mean(values))
    if len(values) == 1:
        return mean, 0.1 * abs(mean)
    return mean, float(stats.t.ppf(SURE, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values)))


def fitted(name: str, data: Data, seed: int, generation: Callable[..., None], physical: bool = True) -> Fit:
    """`name` fitted to `data`; `physical` keeps Cs between the constant friction and the largest force seen."""
    low, high = _bounds(name, data, physical)

    def cost(z: Array) -> float:
        residual = _residual(name, np.exp(z), data)
        return float(residual @ residual)

    found = optimize.differential_evolution(
        cost,
        optimize.Bounds(np.log(low), np.log(high)),
        rng=seed,
        popsize=POPULATION,
        maxiter=GENERATIONS,
        tol=TOLERANCE,
        callback=generation,
        polish=True,
    )
    x = np.exp(np.asarray(found.x, dtype=np.float64))
    at_bound = not low[-1] * (1.0 + AT_BOUND) < x[-1] < high[-1] * (1.0 - AT_BOUND)
    covariance = _covariance(name, x, data)
    spread = SIGMAS * np.sqrt(np.diag(covariance))
    interval = np.clip(x - spread, low, x), np.clip(x + spread, x, np.maximum(x, high))
    constant = _constant_spread(name, x, data, covariance)
    return Fit(_form(name, x, data.constant), _residual(name, x, data), interval, constant, at_bound, int(found.nfev))


def _form(name: str, x: Array, constant: Constant) -> Form:
    values = tuple(float(value) for value in x)
    if name == "displacement":  # the spans lie on its curve, a little above its constant part
        rest = math.exp(-constant.speed / values[0])
        up, down = (max((force - values[-1] * rest) / (1.0 - rest), 0.0) for force in constant[:2])
        return Displacement._make((*values, up, down))
    return FORMS[name]._make((*values, constant.positive, constant.negative))


def _residual(name: str, x: Array, data: Data) -> Array:
    return data.friction - _form(name, x, data.constant).along(data.cut)


def _bounds(name: str, data: Data, physical: bool) -> tuple[Array, Array]:
    """Of the shapes by what the capture resolves, of Cs by what it shows."""
    longest = float(np.max(np.where(np.isfinite(data.cut.until), data.cut.until, 0.0)))
    time = (data.resolution, max(longest, 10.0 * data.resolution))
    shapes = {
        "displacement": [(1e-3 * data.constant.speed, data.constant.speed), (1e-6 * data.length, data.length)],
        "symmetric": [time],
    }.get(name, [time, time])
    least = min(data.constant.positive, data.constant.negative)
    static = (least, max(ALLOWANCE * data.largest, 1.001 * least)) if physical else (DIP * least, FREE * data.largest)
    low, high = zip(*shapes, static, strict=True)
    return np.array(low), np.array(high)


def _covariance(name: str, x: Array, data: Data) -> Array:
    """Of the searched parameters (k, k): local Jacobian, residual taken for coloured noise.

    The residual is mostly what the form cannot follow, so it is correlated along the window; the variance grows by
    ``1 + 2 sum rho`` up to the first crossing of zero.
    """
    step = STEP * x
    columns = [(_residual(name, x - d, data) - _residual(name, x + d, data)) / 2.0 for d in np.diag(step)]
    jacobian = np.column_stack(columns) / step
    residual = _residual(name, x, data)
    variance = float(residual @ residual) / max(len(residual) - len(x), 1) * _colour(residual)
    _, size, turn = np.linalg.svd(jacobian * x, full_matrices=False)
    half = turn.T / np.maximum(size, SINGULAR * size[0])  # what the residual does not feel is left wide open, not nil
    return np.asarray(variance * np.outer(x, x) * (half @ half.T), dtype=np.float64)


def _constant_spread(name: str, x: Array, data: Data, covariance: Array) -> Array:
    """Halves of the 95 % intervals of C1 and C2: what the spans leave open, and what the fit does."""
    ends = [[_form(name, x + way * d, data.constant)[-2:] for way in (1.0, -1.0)] for d in np.diag(STEP * x)]
    gradient = np.array([np.subtract(above, below) for above, below in ends]) / (2.0 * STEP * x[:, None])
    of_the_fit = np.einsum("ia,ij,ja->a", gradient, covariance, gradient)
    return np.asarray(np.hypot(data.constant.spread, SIGMAS * np.sqrt(of_the_fit)), dtype=np.float64)


def _colour(residual: Array) -> float:
    """Integrated autocorrelation ``1 + 2 sum rho_k``, up to the first lag at which it is not positive."""
    spectrum = np.abs(np.fft.rfft(residual, 2 * len(residual))) ** 2
    correlation = np.fft.irfft(spectrum)[: len(residual)]
    if correlation[0] <= 0.0:
        return 1.0
    rho = correlation / correlation[0]
    negative = np.flatnonzero(rho <= 0.0)
    return float(2.0 * np.sum(rho[: negative[0] if len(negative) else len(rho)]) - 1.0)
