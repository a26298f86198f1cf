"""The equation of motion solved for its parameters and for the delay between current and position.

For each delay the problem is convex (`errors_in_variables`), and its cost is a smooth function of the delay.  A scan
finds the valley.  Inside it the moments of the current are interpolated (Chebyshev), so that a long capture is filtered
a few times only.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from scipy import optimize

from stagectl.identification import thresholds
from stagectl.identification.capture import Array, IdentificationError, Refusal
from stagectl.identification.simultaneous import errors_in_variables as errors
from stagectl.identification.simultaneous.errors_in_variables import Instruments, seen
from stagectl.identification.simultaneous.regressors import FREE, ONE, Part, current_noise, currents, encoder_noise


class Problem(NamedTuple):
    """Captures and a grid of slips, ready to be solved for any delay."""

    parts: list[Part]
    columns: Array  # (rows, FREE + j)
    seen: Array  # the same projected on the instruments; without instruments, `columns`
    instruments: Instruments | None
    equations: errors.Equations  # of all columns
    slip: Array  # (j,) rad | m
    force_constant: float


class Moments(NamedTuple):
    """``X'y`` and ``y'y`` as polynomials of the delay around `middle`; `half` is 0 where it is given."""

    middle: float  # s
    half: float  # s
    coefficients: Array  # (nodes, p + 1)

    def at(self, delay: float, keep: list[int]) -> tuple[Array, float]:
        """Moments of the columns `keep`, and the square."""
        place = (delay - self.middle) / self.half if self.half > 0.0 else 0.0
        values = np.asarray(chebyshev.chebval(place, self.coefficients), dtype=np.float64)
        return values[:-1][keep], float(values[-1])


class Fit(NamedTuple):
    """A solution: parameters of all columns, 0 where a column was not used."""

    theta: Array  # (FREE + j,)
    delay: float  # s
    noise: float  # variance of the noise in the acceleration column
    sensed: float  # variance that the current's sensor leaves in the force
    residual: Array  # (rows,) N m | N
    span: Moments  # around the delay


def widest(parts: list[Part] | float) -> float:
    """Largest delay (s) that is searched, at the sampling time of the slowest capture."""
    dt = parts if isinstance(parts, float) else max(p.capture.dt for p in parts)
    return thresholds.DELAY_PERIODS * dt + thresholds.DELAY_SPARE


def kept(p: Problem, ripple: bool, every: slice = slice(None)) -> list[int]:
    """Columns in use: the free ones, with or without ripple, and `every` operator."""
    return [*range(FREE if ripple else ONE + 1), *range(FREE, FREE + len(p.slip))[every]]


def fitted(p: Problem, keep: list[int], delay: float | None, near: Fit | float) -> Fit:
    """Solve for the columns `keep`, and for the delay where it is None: `near` another fit of `p`, or a delay (s).

    Raises IdentificationError where the acceleration holds nothing but noise, or no delay fits.
    """
    part = selected(p, keep)
    limit = widest(p.parts)
    step = 0.0 if delay is not None else 2.0 * limit / (thresholds.DELAY_GRID - 1)
    span = near.span if isinstance(near, Fit) else moments(p, near if delay is None else delay, step)
    for _ in range(thresholds.DELAY_STEPS):
        fit = _settled(p, keep, part, at_delay(p, keep, span))
        if abs(fit.delay - span.middle) <= 0.95 * step:
            return fit
        span = moments(p, min(max(fit.delay, -limit), limit), step)
    raise IdentificationError(
        f"the search for the delay did not converge: the best is still moving at {1e3 * fit.delay:.3g} ms after "
        f"{thresholds.DELAY_STEPS} steps, within ±{1e3 * limit:.3g} ms: the motion does not determine the delay, or "
        "position and current do not belong together in all of the record; give --delay, from a capture of a position "
        "sine, or cut the record to its sound part",
        Refusal.SEARCH,
        value=fit.delay,
        unit="s",
        admissible=f"[{-limit:g}, {limit:g}]",
    )


def selected(p: Problem, keep: list[int]) -> errors.Equations:
    """Equations of the columns `keep`."""
    return errors.selected(p.equations, keep, sum(index < FREE for index in keep))


def at_delay(p: Problem, keep: list[int], span: Moments) -> Fit:
    """Plain solution for the delay in the middle of `span`, the acceleration taken as free of noise."""
    sensed = p.force_constant * p.force_constant * current_noise(p.parts)
    theta = errors.solved(selected(p, keep), *span.at(span.middle, keep)).theta
    return _answer(p, keep, theta, Fit(theta, span.middle, 0.0, sensed, theta, span))


def _answer(p: Problem, keep: list[int], values: Array, fit: Fit) -> Fit:
    """`fit` with these `values` of the columns `keep`, and their residual."""
    theta = np.zeros(p.columns.shape[1])
    theta[keep] = values
    residual = p.force_constant * currents(p.parts, fit.delay) - p.columns @ theta
    return fit._replace(theta=theta, residual=residual)


def without_noise(part: errors.Equations, noise: float) -> errors.Equations:
    """`part` without `noise` (variance) in the acceleration.

    Raises IdentificationError where nothing else is in it.
    """
    cleared = errors.cleared(part, noise)
    if cleared is None:
        raise IdentificationError(
            f"acceleration noise of {math.sqrt(noise):.3g} rad/s^2 | m/s^2 rms; the motion's own acceleration must "
            "exceed it: record a larger current or a faster motion",
            Refusal.NOISE,
            value=math.sqrt(noise),
            unit="rad/s^2 | m/s^2",
        )
    return cleared


def with_less(part: errors.Equations, noise: float) -> tuple[errors.Equations, float]:
    """`part` without the largest share of `noise` that leaves an acceleration, and that share: for the coarse grid."""
    for share in thresholds.NOISE_SHARES:
        cleared = errors.cleared(part, share * noise)
        if cleared is not None:
            return cleared, share * noise
    return part, 0.0


def _settled(p: Problem, keep: list[int], part: errors.Equations, fit: Fit) -> Fit:
    """Repeat until the noise removed from the acceleration is that of the residual."""
    for _ in range(thresholds.NOISE_ROUNDS):
        noise = acceleration_noise(p, fit)
        cleared = without_noise(part, noise)
        delay = best(cleared, keep, fit.span)
        values = errors.solved(cleared, *fit.span.at(delay, keep)).theta
        fit = _answer(p, keep, values, fit._replace(delay=delay, noise=noise))
    return fit


def acceleration_noise(p: Problem, fit: Fit) -> float:
    """Variance of the noise in the acceleration column.

    It is the residual's noise, less that of the current's sensor, as an acceleration; at least the encoder's.
    """
    if p.instruments is not None:  # their projection is free of it
        return 0.0
    inertia = float(fit.theta[0])
    least = encoder_noise(p.parts)
    if inertia == 0.0:
        return least
    return max(least, (float(np.mean(errors.noise(fit.residual))) - fit.sensed) / (inertia * inertia))


def best(part: errors.Equations, keep: list[int], span: Moments) -> float:
    """Delay of least cost within `span`."""
    if span.half == 0.0:
        return span.middle
    ends = (span.middle - span.half, span.middle + span.half)

    def cost(delay: float) -> float:
        return errors.solved(part, *span.at(float(delay), keep)).cost

    minimum = optimize.minimize_scalar(cost, bounds=ends, method="bounded", options={"xatol": 1e-8})
    return float(minimum.x)


def refitted(p: Problem, keep: list[int], fit: Fit) -> tuple[Array, float]:
    """Parameters (FREE + j,) and delay with other columns, at the noise of `fit`: the effect of the choice of slips."""
    cleared = without_noise(selected(p, keep), fit.noise)
    delay = best(cleared, keep, fit.span)
    theta = np.zeros(p.columns.shape[1])
    theta[keep] = errors.solved(cleared, *fit.span.at(delay, keep)).theta
    return theta, delay


def moments(p: Problem, middle: float, half: float = 0.0, nodes: int = thresholds.DELAY_NODES) -> Moments:
    """Moments of the force with all columns, at delays up to `half` either side of `middle` (s)."""
    count = nodes if half > 0.0 else 1
    places = np.cos(math.pi * (np.arange(count) + 0.5) / count)
    values = np.empty((count, p.columns.shape[1] + 1))
    for row, place in zip(values, places, strict=True):
        force = p.force_constant * currents(p.parts, middle + half * float(place))
        inside = force if p.instruments is None else seen(p.instruments, force)
        row[:-1], row[-1] = force @ p.seen, inside @ inside
    coefficients = np.linalg.solve(chebyshev.chebvander(places, count - 1), values)
    return Moments(middle, half, np.asarray(coefficients, dtype=np.float64))
