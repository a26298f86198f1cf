"""How the rolling friction of an axis is distributed over slips: its range, and weights that are even within it.

**Range.**  It is found from the motion and not tuned to an axis.  A coarse grid reaches from what sampling and encoder
resolve to a quarter of the stroke.  Long elements that an axis does not have look like springs, which no motion
separates from inertia and delay: they are left out as long as the fit is as good without them.

**Weights.**  Least squares alone gathers the friction in a few elements with gaps between them.  Between the gaps the
reversal table would have corners that no axis has.  Of all weights that explain the data as well as the best ones,
within what their noise permits, those with the smallest second differences are taken; inertia, viscous friction, delay
and the sum of the weights keep their values.

Source: Tikhonov regularisation with the discrepancy principle, P. C. Hansen, Rank-Deficient and Discrete Ill-Posed
Problems, SIAM 1998.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import optimize

from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture
from stagectl.identification.simultaneous import delay_search as search
from stagectl.identification.simultaneous import errors_in_variables as errors
from stagectl.identification.simultaneous.regressors import FREE, acceleration, currents, knots


class SlipRange(NamedTuple):
    """Slips between which the friction lies, and delay and inertia of the fit on the coarse grid."""

    low: float  # rad | m
    high: float  # rad | m
    delay: float  # s
    inertia: float  # kg m^2 | kg
    settles: bool  # whether the friction has settled well within the stroke
    early: float = 1.0  # share of the friction below a tenth of the longest slip of the grid


def grid(captures: list[Capture]) -> Array:
    """Slips (j,) from the shortest that is resolved to the longest that the largest motion saturates."""
    shortest = []
    for capture in captures:
        q = knots(capture)
        rms = float(np.sqrt(np.mean(acceleration(capture, q) ** 2)))
        shortest.append(max(thresholds.SLIP_STEPS * capture.encoder_step, 0.25 * rms * (q * capture.dt) ** 2))
    longest = thresholds.SLIP_STROKE * max(float(np.ptp(capture.position)) for capture in captures)
    low = min(min(shortest), 0.01 * longest)
    return np.geomspace(low, longest, max(4, math.ceil(math.log(longest / low) / math.log(thresholds.SLIP_RATIO)) + 1))


def located(p: search.Problem, delay: float | None, ripple: bool) -> SlipRange:
    """SlipRange of slips on the coarse grid of `p`: the fewest elements that do as well as all at the same delay."""
    limit = search.widest(p.parts)
    span = search.moments(p, 0.0, limit, thresholds.DELAY_NODES_WIDE) if delay is None else search.moments(p, delay)
    every = len(p.slip)
    keep = search.kept(p, ripple)
    noise = search.acceleration_noise(p, search.at_delay(p, keep, span))
    whole, noise = search.with_less(search.selected(p, keep), noise)
    for count in range(thresholds.LEAST_ELEMENTS, every + 1):
        some = search.kept(p, ripple, slice(count))
        part = search.without_noise(search.selected(p, some), noise)
        place = search.best(part, some, span)
        solution = errors.solved(part, *span.at(place, some))
        full = errors.solved(whole, *span.at(place, keep))
        square = _residual_square(p, keep, full, (place, noise))
        if solution.cost - full.cost <= (thresholds.ELEMENT_GAIN + thresholds.ELEMENT_CHANCE / len(p.columns)) * square:
            break
    weight = solution.theta[len(some) - count :]
    below = np.cumsum(weight) / max(float(weight.sum()), 1e-300)
    low = max(float(p.slip[int(np.argmax(below > thresholds.SLIP_HEAD))]) / thresholds.SLIP_RATIO, float(p.slip[0]))
    early = float(weight[p.slip[:count] < thresholds.EARLY_SLIP * p.slip[-1]].sum()) / max(float(weight.sum()), 1e-300)
    return SlipRange(
        low, float(p.slip[count - 1]) * thresholds.SLIP_RATIO, place, float(full.theta[0]), count < every - 1, early
    )


def _residual_square(p: search.Problem, keep: list[int], full: errors.Solution, known: tuple[float, float]) -> float:
    """Sum of squares of the residual with its noise; the cost is what exceeds the noise and may be about zero."""
    place, noise = known
    if p.instruments is None:
        return full.cost + len(p.columns) * noise * float(full.theta[0]) ** 2
    residual = p.force_constant * currents(p.parts, place) - p.columns[:, keep] @ full.theta
    return float(residual @ residual)


def evened(p: search.Problem, fit: search.Fit) -> Array:
    """Weights (j,) as even as the data allow, with the sum of the fit's."""
    sharp = fit.theta[FREE:]
    columns = p.seen[:, FREE:]
    gram = columns.T @ columns
    size = math.sqrt(float(np.trace(gram)) / len(gram))
    gram = gram / (size * size)
    aim = gram @ sharp + columns.T @ fit.residual / (size * size)
    permitted = thresholds.EVEN_COST * thresholds.WINDOW_CORRELATION * float(np.mean(fit.residual**2)) / (size * size)
    low, high, even = 1e-12, 1e3, sharp
    for _ in range(thresholds.EVEN_HALVINGS):
        strength = math.sqrt(low * high)
        tried = _regularised(gram, aim, float(sharp.sum()), strength)
        if _cost(gram, aim, tried) - _cost(gram, aim, sharp) <= permitted:
            low, even = strength, tried
        else:
            high = strength
    return np.asarray(even * (sharp.sum() / even.sum()), dtype=np.float64)


def _cost(gram: Array, aim: Array, weight: Array) -> float:
    return float(weight @ gram @ weight - 2.0 * aim @ weight)


def _regularised(gram: Array, aim: Array, total: float, strength: float) -> Array:
    """Weights >= 0 of least cost plus `strength` times their second differences, with the sum `total`."""
    curvature = np.diff(np.eye(len(gram)), 2, axis=0)
    whole = gram + strength * curvature.T @ curvature + thresholds.SUM_WEIGHT + 1e-10 * np.eye(len(gram))
    triangle = np.linalg.cholesky(whole).T
    weight, _ = optimize.nnls(triangle, np.linalg.solve(triangle.T, aim + thresholds.SUM_WEIGHT * total))
    return np.asarray(weight, dtype=np.float64)
