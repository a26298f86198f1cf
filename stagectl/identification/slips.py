"""Where an axis' rolling friction lies: the range of slips, found from the motion and not tuned to an axis.

A coarse grid reaches from what sampling and encoder resolve to a quarter of the stroke.  Long elements that an axis
does not have look like springs, which no motion separates from inertia and delay: they are left out as long as the
fit is as good without them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stagectl.identification import delay_search as search
from stagectl.identification import errors_in_columns as errors
from stagectl.identification.capture import Array, Capture
from stagectl.identification.regressors import FREE, ONE, acceleration, knots

COUNTS = 8.0  # encoder steps below which no slip is looked for
STROKE = 0.25  # of a motion: the longest slip that is looked for
RATIO = 1.6  # of neighbouring slips
HEAD = 0.03  # of the friction that may lie below the range
WORSE, CHANCE = 0.002, 50.0  # rise of the cost that an element must prevent: relative, and in variances of a row
LEAST = 3  # elements


class Range(NamedTuple):
    """Slips between which the friction lies, and what the coarse grid thinks of the delay."""

    low: float  # rad | m
    high: float  # rad | m
    delay: float  # s
    settles: bool  # whether the friction has settled well within the stroke


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


def located(p: search.Problem, delay: float | None) -> Range:
    """Range of slips on the coarse grid of `p`: the fewest elements that do as well as all at the same delay."""
    limit = search.widest(p.parts)
    span = search.moments(p, 0.0, limit, search.MANY) if delay is None else search.moments(p, delay)
    every = len(p.slip)
    noise = search.acceleration_noise(p, search.at_delay(p, _columns(every), span.middle))
    enough = 1.0 + WORSE + CHANCE / len(p.columns)
    for count in range(LEAST, every + 1):
        cost, place, weight = _tried(p, span, count, noise)
        if cost <= enough * _cost(p, span, place, noise):
            break
    below = np.cumsum(weight) / max(float(weight.sum()), 1e-300)
    first = int(np.argmax(below > HEAD))
    low = max(float(p.slip[first]) / RATIO, float(p.slip[0]))
    return Range(low, float(p.slip[count - 1]) * RATIO, place, count < every - 1)


def _columns(count: int) -> list[int]:
    return [*range(ONE + 1), *range(FREE, FREE + count)]


def _tried(p: search.Problem, span: search.Moments, count: int, noise: float) -> tuple[float, float, Array]:
    """Cost, delay and weights with the `count` shortest elements."""
    keep = _columns(count)
    part = search.without_noise(search.selected(p, keep), noise)
    place = search.best(part, keep, span)
    solution = errors.solved(part, *span.at(place, keep))
    return solution.cost, place, solution.theta[ONE + 1 :]


def _cost(p: search.Problem, span: search.Moments, place: float, noise: float) -> float:
    """Cost with all elements at the delay `place`."""
    keep = _columns(len(p.slip))
    part = search.without_noise(search.selected(p, keep), noise)
    return errors.solved(part, *span.at(place, keep)).cost
