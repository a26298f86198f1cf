"""How well a fit of the equation of motion is known: covariance, sampling, and whether instruments are needed.

**Covariance** of what is reported, from the residual as it is and from another grid of slips.

**Sampling** does not resolve friction that reverses within the window of a reversal.  There its sign is not known, and
the viscous friction gains what the Coulomb friction loses: the share of rows in which the shortest element is on its
way gives the error, in the force and over the rms velocity in the viscous friction.

**Plain least squares or instruments.**  The plain fit is the sharper one, and wrong where a controller responded to
noise.  Without that, both find the same up to chance, and the difference of the two has the variance of the one less
that of the other, ``V = V_instruments - V_plain``.  Parameters that differ by more show that noise has gone round the
loop, and only the instruments are free of it.

Source: J. A. Hausman, Specification Tests in Econometrics, Econometrica 46(6), 1978.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stagectl.identification import standard_errors, thresholds
from stagectl.identification.capture import Array
from stagectl.identification.result import Note, Parameter, Topic
from stagectl.identification.simultaneous import errors_in_variables as errors
from stagectl.identification.simultaneous.delay_search import Fit, Problem, kept, refitted
from stagectl.identification.simultaneous.errors_in_variables import projected
from stagectl.identification.simultaneous.regressors import ACCELERATION, FREE, ONE, VELOCITY, columns, currents

NAMES = ("inertia", "viscous", "coulomb", "offset", "delay")
STAGE_KEYS = {"inertia": "mechanics.inertia", "viscous": "mechanics.viscous", "coulomb": "friction"}


class Uncertainty(NamedTuple):
    """Covariance of the parameters of NAMES, and what a given delay does to the others."""

    covariance: Array  # (5, 5); row and column of the delay are 0 where it was given
    per_delay: Array  # (5,) change of each per second of delay
    ripple: float  # how clearly there is a ripple: Wald's statistic with two degrees of freedom, 0: not tested
    ripple_bias: float | None = None  # change of the inertia by a ripple too small to be seen; None: not tested


def assess(p: Problem, fit: Fit, ripple: bool, free_delay: bool) -> Uncertainty:
    """Covariance from the residual as it is, and from what another grid of slips would have reported."""
    active = _active_columns(p, fit, ripple)
    curvature, scores, late = _curvature(p, fit, active)
    size = np.sqrt(np.diag(curvature)[:-1])
    size = np.append(size, late)
    curvature, scores = curvature / np.outer(size, size), scores / size
    last = len(size) if free_delay else len(size) - 1
    covariance = standard_errors.sandwich(curvature[:last, :last], scores[:, :last]) / np.outer(
        size[:last], size[:last]
    )
    sums = _sums(active)[:, :last]
    reported = sums @ covariance @ sums.T
    per_delay = -sums[:, : len(active)] @ (
        np.linalg.pinv(curvature[:-1, :-1], rcond=thresholds.SAME_COLUMN, hermitian=True)
        @ curvature[:-1, -1]
        * size[-1]
        / size[:-1]
    )
    other = _grid_error(p, fit, ripple)
    return Uncertainty(reported + np.outer(other, other), per_delay, _wald(fit, covariance) if ripple else 0.0)


def _active_columns(p: Problem, fit: Fit, ripple: bool) -> list[int]:
    """Columns whose parameters the data may change: an element with weight may as well lie at its neighbour's slip."""
    carrying = fit.theta[FREE:] > 0.0
    possible = carrying.copy()
    possible[1:] |= carrying[:-1]
    possible[:-1] |= carrying[1:]
    return [index for index in kept(p, ripple) if index < FREE or possible[index - FREE]]


def _curvature(p: Problem, fit: Fit, active: list[int]) -> tuple[Array, Array, float]:
    """Second derivatives (m, m) of half the cost, its gradient row by row (rows, m), the length of the delay's column.

    The delay comes last.  The projection of the current's derivative on the instruments is few numbers and noisy: by
    chance the cost is curved too much or too little by it.  With instruments the derivative is the model's, which is
    projected without noise; the gradient keeps the current's own, as the delay was reported from that.
    """
    rows = len(fit.residual)
    scores = np.empty((rows, len(active) + 1))
    scores[:, :-1] = p.seen[:, active]
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
        scores[thresholds.NOISE_LAG : -thresholds.NOISE_LAG, 0] += (
            errors.noise(fit.residual) - fit.sensed
        ) / fit.theta[0]
    return curvature, scores, length


def _sums(active: list[int]) -> Array:
    """(5, m + 1) from the columns in active and the delay to NAMES."""
    matrix = np.zeros((len(NAMES), len(active) + 1))
    matrix[0, 0] = matrix[1, 1] = matrix[3, 2] = matrix[4, -1] = 1.0
    matrix[2, :-1] = [float(index >= FREE) for index in active]
    return matrix


def _grid_error(p: Problem, fit: Fit, ripple: bool) -> Array:
    """(5,) half of the change between the odd slips of the grid and the even ones: the grid is arbitrary."""
    even, odd = (values(*refitted(p, kept(p, ripple, slice(first, None, 2)), fit)) for first in (0, 1))
    return np.asarray(0.5 * (odd - even), dtype=np.float64)


def _wald(fit: Fit, covariance: Array) -> float:
    pair = fit.theta[3:5]
    return float(pair @ np.linalg.solve(covariance[3:5, 3:5], pair))


class Unresolved(NamedTuple):
    """How much of the friction lies in the shortest element that carries weight, and the error this may cause."""

    share: float  # of the friction; 0 where the grid goes on below that element
    slip: float  # rad | m
    error: Array  # (5,) of NAMES: viscous and Coulomb friction, of one another


def unresolved(p: Problem, fit: Fit) -> Unresolved:
    """Friction in the shortest element, and the error where most of the friction reverses between two rows."""
    weight = fit.theta[FREE:]
    first, total, error = int(np.argmax(weight > 0.0)), float(weight.sum()), np.zeros(5)
    share = float(weight[first]) / total if total > 0.0 and first <= 1 else 0.0
    hidden = p.slip <= thresholds.HIDDEN_SLIP * _skipped(p)
    if float(weight[hidden].sum()) > thresholds.HIDDEN_SHARE * total:
        state = np.abs(p.columns[:, FREE:][:, hidden])
        turning = np.mean(state < thresholds.SLIPPING * state.max(axis=0), axis=0)
        error[2] = -float(turning @ weight[hidden])
        error[1] = -error[2] / float(np.sqrt(np.mean(p.columns[:, VELOCITY] ** 2)))
    return Unresolved(share, float(p.slip[first]), error)


def _skipped(p: Problem) -> float:
    """Travel (rad | m) within half a sampling time either side of a reversal, twice: to it and back."""
    dt = max(part.capture.dt for part in p.parts)
    return 0.25 * dt * dt * float(np.sqrt(np.mean(p.columns[:, ACCELERATION] ** 2)))


def withheld(parameters: dict[str, Parameter], short: Unresolved) -> dict[str, Note]:
    """Parameters that are not known well enough for a stage file, by their key there, with a note on the reason."""
    notes: dict[str, Note] = {}
    for name, key in STAGE_KEYS.items():
        value, low, half = parameters[name].value, parameters[name].low, parameters[name].half
        mixed = name == "viscous" and short.error[1] != 0.0 and half > thresholds.UNSURE * abs(value)
        left_out = f"{name}: {value:.3g} ± {half:.2g} is left out of the stage file's changes"
        if low <= 0.0 or half > thresholds.USELESS * abs(value):
            reason = f"; its interval must lie above 0 and within ±{100.0 * thresholds.USELESS:.0f} %"
        elif name == "viscous" and STAGE_KEYS["inertia"] in notes:
            reason = (
                ", as the inertia found with it is not known: a slow log determines neither; sample faster, or give "
                "--delay"
            )
        elif mixed:
            reason = ", as this sampling does not separate it from Coulomb friction"
        else:
            continue
        notes[key] = Note(Topic.WITHHELD, left_out + reason)
    return notes


class Preference(NamedTuple):
    """Whether the plain fit is taken, how it differs from that by instruments, and a note on it."""

    plain: bool
    difference: Array  # (5,) of NAMES
    note: Note


def preferred(plain: tuple[Fit, Uncertainty], instrumental: tuple[Fit, Uncertainty]) -> Preference:
    """Which of the two fits is taken; an undecided difference is to be added to the interval of the plain one."""
    difference = values(plain[0].theta, plain[0].delay) - values(instrumental[0].theta, instrumental[0].delay)
    own, other = (np.diag(uncertainty.covariance) for _, uncertainty in (plain, instrumental))
    variance = np.where(other > own, other - own, other)
    apart = [
        f"{name} by {abs(step) / math.sqrt(size):.2g} standard deviations"
        for name, step, size in zip(NAMES, difference, variance, strict=True)
        if name not in ("coulomb", "offset") and size > 0.0 and abs(step) > thresholds.HAUSMAN * math.sqrt(size)
    ]
    if apart:
        text = (
            "reference: used as an instrument (two-stage least squares), as the fit without it differs by more than "
            f"chance ({', '.join(apart)}): the controller responded to noise"
        )
        return Preference(False, difference, Note(Topic.REFERENCE, text))
    text = (
        "reference: instruments made from it (two-stage least squares) find the same up to chance, so they are not "
        "used; the intervals include the difference"
    )
    return Preference(True, difference, Note(Topic.REFERENCE, text))


def values(theta: Array, delay: float) -> Array:
    """Parameters (5,) of NAMES, from those of all columns and the delay (s)."""
    return np.array([theta[0], theta[1], theta[FREE:].sum(), theta[ONE], delay])
