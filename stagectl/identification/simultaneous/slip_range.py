"""Where an axis' rolling friction lies: the range of slips, found from the motion and not tuned to an axis.

A coarse grid reaches from what sampling and encoder resolve to a quarter of the stroke.  Long elements that an axis
does not have look like springs, which no motion separates from inertia and delay: they are left out as long as the
fit is as good without them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stagectl.identification.capture import Array, Capture
from stagectl.identification.simultaneous import delay_search as search
from stagectl.identification.simultaneous import errors_in_columns as errors
from stagectl.identification.simultaneous.regressors import acceleration, currents, knots

COUNTS = 8.0  # encoder steps below which no slip is looked for
STROKE = 0.25  # of a motion: the longest slip that is looked for
RATIO = 1.6  # of neighbouring slips
HEAD = 0.03  # of the friction that may lie below the range
WORSE, CHANCE = 0.002, 50.0  # rise of the cost that an element must prevent: relative, and in variances of a row
LEAST = 3  # elements
EARLY = 0.1  # of the longest slip: friction that has settled there


class Range(NamedTuple):
    """Slips between which the friction lies, and what the coarse grid thinks of the delay."""

    low: float  # rad | m
    high: float  # rad | m
    delay: float  # s
    inertia: float  # kg m^2 | kg
    settles: bool  # whether the friction has settled well within the stroke
    early: float = 1.0  # share of the friction below a tenth of the longest slip looked for


def grid(captures: list[Capture]) -> Array:
    """Slips (j,) from the shortest that is resolved to the longest that the largest motion saturates."""
    shortest = []
    for capture in captures:
        q = knots(capture)
        rms = float(np.sqrt(np.mean(acceleration(capture, q) ** 2)))
        shortest.append(max(COUNTS * capture.encoder_step, 0.25 * rms * (q * capture.dt) ** 2))
    longest = STROKE * max(float(np.ptp(capture.position)) for capture in captures)
    low = min(min(shortest), 0.01 * longest)
    return np.geomspace(low, longest, max(4, math.ceil(math.log(longest / low) / math.log(RATIO)) + 1))


def located(p: search.Problem, delay: float | None, ripple: bool) -> Range:
    """Range of slips on the coarse grid of `p`: the fewest elements that do as well as all at the same delay."""
    limit = search.widest(p.parts)
    span = search.moments(p, 0.0, limit, search.MANY) if delay is None else search.moments(p, delay)
    every = len(p.slip)
    keep = search.kept(p, ripple)
    noise = search.acceleration_noise(p, search.at_delay(p, keep, span))
    whole, noise = search.with_less(search.selected(p, keep), noise)
    for count in range(LEAST, every + 1):
        some = search.kept(p, ripple, slice(count))
        part = search.without_noise(search.selected(p, some), noise)
        place = search.best(part, some, span)
        solution = errors.solved(part, *span.at(place, some))
        full = errors.solved(whole, *span.at(place, keep))
        square = _left(p, keep, full, (place, noise))
        if solution.cost - full.cost <= (WORSE + CHANCE / len(p.columns)) * square:
            break
    weight = solution.theta[len(some) - count :]
    below = np.cumsum(weight) / max(float(weight.sum()), 1e-300)
    low = max(float(p.slip[int(np.argmax(below > HEAD))]) / RATIO, float(p.slip[0]))
    early = float(weight[p.slip[:count] < EARLY * p.slip[-1]].sum()) / max(float(weight.sum()), 1e-300)
    return Range(low, float(p.slip[count - 1]) * RATIO, place, float(full.theta[0]), count < every - 1, early)


def _left(p: search.Problem, keep: list[int], full: errors.Solution, known: tuple[float, float]) -> float:
    """Squares of the residual with its noise, of which the cost holds only what is above it: it may be about zero."""
    place, noise = known
    if p.instruments is None:
        return full.cost + len(p.columns) * noise * float(full.theta[0]) ** 2
    residual = p.force_constant * currents(p.parts, place) - p.columns[:, keep] @ full.theta
    return float(residual @ residual)
