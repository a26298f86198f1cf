"""How well a fit of the equation of motion is known: covariance of what is reported, and what depends on what."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stagectl.identification.capture import Array
from stagectl.identification.simultaneous import errors_in_columns as errors
from stagectl.identification.simultaneous.delay_search import Fit, Problem, kept, refitted
from stagectl.identification.simultaneous.instruments import projected
from stagectl.identification.simultaneous.regressors import FREE, columns, currents

NAMES = ("inertia", "viscous", "coulomb", "offset", "delay")


class Known(NamedTuple):
    """Covariance of the parameters of NAMES, and what a given delay does to the others."""

    covariance: Array  # (5, 5); row and column of the delay are 0 where it was given
    per_delay: Array  # (5,) change of each per second of delay
    ripple: float  # how clearly there is a ripple: Wald's statistic with two degrees of freedom, 0: not asked
    ripple_bias: float | None = None  # what the inertia may change by with a ripple that is not seen; None: not asked


def known(p: Problem, fit: Fit, ripple: bool, free_delay: bool) -> Known:
    """Covariance from the residual as it is, and from what another grid of slips would have found."""
    use = _in_play(p, fit, ripple)
    curvature, scores, late = _curvature(p, fit, use)
    size = np.sqrt(np.diag(curvature)[:-1])
    size = np.append(size, late)
    curvature, scores = curvature / np.outer(size, size), scores / size
    last = len(size) if free_delay else len(size) - 1
    covariance = errors.spread(curvature[:last, :last], scores[:, :last]) / np.outer(size[:last], size[:last])
    sums = _sums(use)[:, :last]
    found = sums @ covariance @ sums.T
    per_delay = -sums[:, : len(use)] @ (
        np.linalg.pinv(curvature[:-1, :-1], rcond=errors.SAME, hermitian=True)
        @ curvature[:-1, -1]
        * size[-1]
        / size[:-1]
    )
    other = _grid_error(p, fit, ripple)
    return Known(found + np.outer(other, other), per_delay, _wald(fit, covariance) if ripple else 0.0)


def _in_play(p: Problem, fit: Fit, ripple: bool) -> list[int]:
    """Columns whose parameters the data could have moved: an element that carries may as well lie at its neighbour."""
    carrying = fit.theta[FREE:] > 0.0
    near = carrying.copy()
    near[1:] |= carrying[:-1]
    near[:-1] |= carrying[1:]
    return [index for index in kept(p, ripple) if index < FREE or near[index - FREE]]


def _curvature(p: Problem, fit: Fit, use: list[int]) -> tuple[Array, Array, float]:
    """Second derivatives (m, m) of half the cost, its gradient row by row (rows, m), the length of the delay's column.

    The delay comes last.  What instruments see of the current's derivative is few numbers and noisy: by chance the
    cost is bent too much or too little by it.  There the derivative is the model's, which the instruments see
    without noise; the gradient keeps the current's own, as that is what the delay was found from.
    """
    rows = len(fit.residual)
    scores = np.empty((rows, len(use) + 1))
    scores[:, :-1] = p.seen[:, use]
    late = p.force_constant * currents(p.parts, fit.delay, 1)
    if p.instruments is None:
        scores[:, -1] = late
        curvature = np.asarray(scores.T @ scores, dtype=np.float64)
        curvature[-1, -1] += p.force_constant * float(fit.residual @ currents(p.parts, fit.delay, 2))
    else:
        rates = np.concatenate([columns(part, p.slip, 1) @ fit.theta for part in p.parts])
        scores[:, -1] = projected(p.instruments, rates)
        curvature = np.asarray(scores.T @ scores, dtype=np.float64)
        late = projected(p.instruments, late)
    length = float(np.linalg.norm(scores[:, -1]))
    scores[:, -1] = late
    curvature[0, 0] -= rows * fit.noise
    scores *= fit.residual[:, None]
    if fit.noise > 0.0:
        scores[errors.APART : -errors.APART, 0] += (errors.noise(fit.residual) - fit.sensed) / fit.theta[0]
    return curvature, scores, length


def _sums(use: list[int]) -> Array:
    """(5, m + 1) that makes NAMES from the columns in use and the delay."""
    found = np.zeros((len(NAMES), len(use) + 1))
    found[0, 0] = found[1, 1] = found[3, 2] = found[4, -1] = 1.0
    found[2, :-1] = [float(index >= FREE) for index in use]
    return found


def _grid_error(p: Problem, fit: Fit, ripple: bool) -> Array:
    """(5,) half of what changes between every other slip and those between: the grid is not the friction's own."""
    halves = [refitted(p, kept(p, ripple, slice(first, None, 2)), fit) for first in (0, 1)]
    values = [np.array([*theta[:2], theta[FREE:].sum(), theta[2], delay]) for theta, delay in halves]
    return np.asarray(0.5 * (values[1] - values[0]), dtype=np.float64)


def _wald(fit: Fit, covariance: Array) -> float:
    pair = fit.theta[3:5]
    return float(pair @ np.linalg.solve(covariance[3:5, 3:5], pair))
