"""Parameters, friction and delay of one axis as a linear Gaussian model with priors, averaged over what is not linear.

::

    Kt i(t - tau) = J a + D v + b + ripple + sum_k f_k F_k(x) + noise

For a given delay ``tau`` and given scales of the friction's groups everything is linear, with a Gaussian prior: J, D
from the stage file with their doubt, friction columns (`friction_columns`) of zero mean and the group's scale.  The
scales are chosen by evidence, and the answer is the average over delays and scales by their evidence.  So its interval
holds what the friction law does not settle.

**Noise in the acceleration.**  Where noise moved the axis, or the encoder's steps are seen, the residual's noise is in
the acceleration and not in the current: then ``a`` is the answer to ``i`` and not the reverse, and the likelihood has
the Jacobian ``n log J``.  To first order that takes ``n v`` from the acceleration's square, ``v = (r^2 - s^2) / J^2``,
with ``r^2`` the noise of the residual and ``s^2`` the current sensor's share of it (bias-eliminating least squares;
T. Soederstrom, Errors-in-Variables Methods in System Identification, Springer 2018).

**Temper.**  Rows are worth less than their number: the window correlates neighbours, and what the columns leave of the
true law repeats in every stroke.  With a residual of variance ``s^2`` of which the share ``f`` is such an error, n rows
count as ``n / (c + n f / K)``: no record is worth more than K values per unit of error, however long it is.  ``f`` is
at least that of an error of form of `FORM_ERROR` of the friction, of a reversal misplaced by an encoder step, and, in
closed loop, of the noise that the controller answers to: current and acceleration then hold the same noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve

from stagectl import gaussian_evidence as gaussian
from stagectl.config.stage_blocks import StageFile
from stagectl.identification import standard_errors, thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous import friction_columns
from stagectl.identification.simultaneous.regressors import (
    ACCELERATION,
    FREE,
    ONE,
    RIPPLE,
    VELOCITY,
    Part,
    current_noise,
    currents,
    motion,
    step_time,
)

GROUPS = ("ripple", "operators", "bristles", "stribeck", "lag")
Scales = tuple[float, ...]  # of GROUPS, in units of the Coulomb friction


class DelayPrior(NamedTuple):
    """What is known of the delay before the data; a deviation of zero: it is given."""

    mean: float  # s
    deviation: float  # s

    @property
    def nodes(self) -> Array:
        """Delays that the search begins with."""
        if self.deviation == 0.0:
            return np.array([self.mean])
        span = thresholds.DELAY_SPAN * self.deviation
        return np.asarray(self.mean + np.linspace(-span, span, thresholds.DELAY_NODES), dtype=np.float64)

    def log_density(self, delays: Array) -> Array:
        """Up to a constant."""
        if self.deviation == 0.0:
            return np.zeros(len(delays))
        return np.asarray(-0.5 * ((delays - self.mean) / self.deviation) ** 2, dtype=np.float64)


class Forces(NamedTuple):
    """The left side at several delays, and its products with the columns."""

    delays: Array  # (k,) s
    rows: Array  # (rows, k) N m | N
    right: Array  # (m, k)
    square: Array  # (k,)


class Problem(NamedTuple):
    """Rows of all captures, and what is known before them."""

    parts: list[Part]
    shapes: friction_columns.Shapes
    columns: Array  # (rows, m)
    gram: Array  # (m, m)
    coulomb: float  # N m | N, about
    file: StageFile
    delay: DelayPrior
    acceleration_noise: float = 0.0  # sum of squares that `gram` lacks
    moved_share: float = 0.0  # of the residual's noise that lies in the acceleration

    @property
    def groups(self) -> dict[str, slice]:
        """Places of the groups in all columns."""
        friction = {name: slice(FREE + place.start, FREE + place.stop) for name, place in self.shapes.groups.items()}
        return {"ripple": RIPPLE, **friction}

    def forces(self, delays: Array) -> Forces:
        """Left sides at these delays (k,) s."""
        rows = self.file.motor.force_constant * currents(self.parts, delays)
        return Forces(delays, rows, self.columns.T @ rows, np.sum(rows * rows, axis=0))

    def residual_square(self, theta: Array, forces: Forces, number: int) -> float:
        """Sum of squares of the residual at one of the delays."""
        explained = theta @ self.gram @ theta + self.acceleration_noise * theta[ACCELERATION] ** 2
        return float(forces.square[number] - 2.0 * theta @ forces.right[:, number] + explained)

    def prior(self, scales: Scales) -> gaussian.Prior:
        """Of all columns, with these scales of the groups."""
        mean, deviation = np.zeros(len(self.gram)), np.full(len(self.gram), self.coulomb)
        mechanical = [ACCELERATION, VELOCITY]
        mean[mechanical], deviation[mechanical] = mechanics(self.file)
        for name, scale in zip(GROUPS, scales, strict=True):
            deviation[self.groups[name]] = max(scale, thresholds.NO_SCALE) * self.coulomb
        operators = self.groups["operators"]
        mean[operators] = self.coulomb / (operators.stop - operators.start)
        return gaussian.independent(mean, deviation)


class Fit(NamedTuple):
    """The posterior at several delays, with one choice of scales."""

    scales: Scales
    delays: Array  # (k,) s
    known: gaussian.Posteriors
    log_weight: Array  # (k,) evidence and prior of the delay
    variance: float  # of the residual, (N m)^2 | N^2

    @property
    def best(self) -> int:
        """Number of the most probable delay."""
        return int(np.argmax(self.log_weight))


class Answer(NamedTuple):
    """The average over delays and scales."""

    fits: list[Fit]
    weights: list[Array]  # (k,) of each fit; they sum to 1
    worth: float  # rows that count as one
    form_share: float  # of the residual's variance that is an error of form

    @property
    def best(self) -> Fit:
        """The most probable scales."""
        return self.fits[int(np.argmax([weight.sum() for weight in self.weights]))]

    def moments(self, sums: Array) -> tuple[Array, Array]:
        """Mean (r + 1,) and covariance of these sums (r, m) of parameters, and of the delay, which comes last."""
        values = [np.vstack([sums @ fit.known.mean, fit.delays]) for fit in self.fits]
        mean = np.sum([value @ weight for value, weight in zip(values, self.weights, strict=True)], axis=0)
        covariance = np.zeros((len(mean), len(mean)))
        for value, weight, fit in zip(values, self.weights, self.fits, strict=True):
            away = value - mean[:, None]
            covariance += (away * weight) @ away.T
            covariance[:-1, :-1] += weight.sum() * (sums @ cho_solve(fit.known.factor, sums.T))
        return np.asarray(mean), covariance


def problem(parts: list[Part], file: StageFile, delay: DelayPrior) -> Problem:
    """Columns of all `parts`."""
    free = [motion(p) for p in parts]
    shapes = friction_columns.shapes(parts, np.vstack(free))
    matrix = np.vstack(
        [
            np.column_stack([rows, friction_columns.columns(p, rows[:, VELOCITY], shapes)])
            for p, rows in zip(parts, free, strict=True)
        ]
    )
    force = file.motor.force_constant * currents(parts, np.array([delay.mean]))[:, 0]
    return Problem(parts, shapes, matrix, matrix.T @ matrix, _coulomb(matrix, force, shapes, file), file, delay)


def _coulomb(matrix: Array, force: Array, shapes: friction_columns.Shapes, file: StageFile) -> float:
    """About the Coulomb friction: one operator next to the stage file's mechanics with their doubt."""
    some = matrix[:, [ACCELERATION, VELOCITY, ONE, FREE + len(shapes.slip) // 2]]
    rms = float(np.sqrt(np.mean(force * force)))
    power = 1.0 / (thresholds.WINDOW_CORRELATION * (thresholds.ROUGH_RESIDUAL * rms) ** 2)
    sums = gaussian.Sums(power * some.T @ some, power * some.T @ force, power * float(force @ force))
    (inertia, viscous), (loose, tight) = mechanics(file)
    prior = gaussian.independent(np.array([inertia, viscous, 0.0, 0.0]), np.array([loose, tight, rms, rms]))
    return max(abs(float(gaussian.posterior(sums, prior).mean[-1])), thresholds.LEAST_FRICTION * rms)


def mechanics(file: StageFile) -> tuple[tuple[float, float], tuple[float, float]]:
    """Inertia and viscous friction of the stage file, and the standard deviations of their doubt."""
    p = file.mechanics
    viscous = thresholds.VISCOUS_DOUBT * p.viscous + thresholds.NATURAL_DAMPING * p.inertia
    return (p.inertia, p.viscous), (thresholds.INERTIA_DOUBT * p.inertia, viscous)


def answered(p: Problem) -> Answer:
    """The posterior of all that is not known, and the problem without the noise in its acceleration."""
    forces = p.forces(p.delay.nodes)
    simplest = _settled(p, forces, thresholds.FIRST_SCALES, _rough_variance(p, forces))
    first = _most_probable(_searched(_without_noise(p, simplest, forces), forces))
    p = _without_noise(p, first, forces)
    fits = _searched(p, forces)
    best = _most_probable(fits)
    residual = _residual(p, best, forces)
    share = _form_share(p, best, residual)
    worth = max(thresholds.WINDOW_CORRELATION, _near(residual)) + len(residual) * share / thresholds.FORM_VALUES
    likely = [fit for fit in fits if fit.log_weight.max() > best.log_weight.max() - thresholds.UNLIKELY]

    def again(fit: Fit, at: Forces) -> Fit:
        return _fit(p, at, fit.scales, worth, fit.variance)

    forces = _narrowed(p, forces, lambda at: again(best, at).log_weight)
    fits = [again(fit, forces) for fit in likely]
    top = max(float(fit.log_weight.max()) for fit in fits)
    weights = [np.exp(fit.log_weight - top) for fit in fits]
    total = float(sum(weight.sum() for weight in weights))
    return Answer(fits, [weight / total for weight in weights], worth, share)


def _most_probable(fits: list[Fit]) -> Fit:
    return max(fits, key=lambda fit: float(fit.log_weight.max()))


def _residual(p: Problem, fit: Fit, forces: Forces) -> Array:
    """Residual (rows,) at the most probable delay."""
    return np.asarray(forces.rows[:, fit.best] - p.columns @ fit.known.mean[:, fit.best], dtype=np.float64)


def _without_noise(p: Problem, fit: Fit, forces: Forces) -> Problem:
    """The problem without the noise of its acceleration, as far as the motion still determines the inertia."""
    residual = _residual(p, fit, forces)
    sensed = p.file.motor.force_constant**2 * current_noise(p.parts)
    inertia = float(fit.known.mean[ACCELERATION, fit.best])
    moved = max(standard_errors.noise(residual) - sensed, 0.0) / inertia**2
    noise = min(len(residual) * moved, thresholds.MOST_NOISE * _alone(p.gram, ACCELERATION))
    gram = p.gram.copy()
    gram[ACCELERATION, ACCELERATION] -= noise
    share = min(noise * inertia**2 / (len(residual) * fit.variance), 1.0)
    return p._replace(gram=gram, acceleration_noise=noise, moved_share=share)


def _alone(gram: Array, place: int) -> float:
    """Square of what no other column explains of the one at `place`."""
    size = np.sqrt(np.diag(gram)) + 1e-300
    unit = gram / np.outer(size, size) + thresholds.COLUMN_RIDGE * np.eye(len(gram))
    return float(size[place] ** 2 / np.linalg.inv(unit)[place, place])


def _fit(p: Problem, forces: Forces, scales: Scales, worth: float, variance: float) -> Fit:
    rows = len(p.columns)
    power = 1.0 / (worth * variance)
    known = gaussian.posteriors(
        gaussian.Sums(power * p.gram, power * forces.right, power * forces.square), p.prior(scales)
    )
    inertia = np.maximum(known.mean[ACCELERATION], thresholds.LEAST_INERTIA * p.file.mechanics.inertia)
    jacobian = rows / worth * p.moved_share * np.log(inertia) - 0.5 * power * p.acceleration_noise * inertia**2
    log_weight = known.log_evidence - 0.5 * rows / worth * math.log(variance) + jacobian
    log_weight += p.delay.log_density(forces.delays)
    return Fit(scales, forces.delays, known, log_weight, variance)


def _searched(p: Problem, forces: Forces) -> list[Fit]:
    """Fits of all scales that a search along one group after the other tries, from the simplest law on."""
    tried: dict[Scales, Fit] = {}
    variance = _rough_variance(p, forces)

    def evidence(scales: Scales) -> float:
        nonlocal variance
        if scales not in tried:
            tried[scales] = _settled(p, forces, scales, variance)
            variance = min(variance, tried[scales].variance)
        return float(tried[scales].log_weight.max())

    scales: Scales = thresholds.FIRST_SCALES
    for _ in range(thresholds.SCALE_ROUNDS):
        for group, choice in enumerate(thresholds.FRICTION_SCALES):
            scales = max(((*scales[:group], size, *scales[group + 1 :]) for size in choice), key=evidence)
    return list(tried.values())


def _rough_variance(p: Problem, forces: Forces) -> float:
    """Variance of the residual that the iterations begin with."""
    return thresholds.FIRST_VARIANCE * float(forces.square.mean()) / len(p.columns)


def _settled(p: Problem, forces: Forces, scales: Scales, variance: float) -> Fit:
    """The fit whose residual has the variance that it assumes."""
    for _ in range(thresholds.NOISE_ROUNDS):
        fit = _fit(p, forces, scales, thresholds.WINDOW_CORRELATION, variance)
        theta = fit.known.mean[:, fit.best]
        square = p.residual_square(theta, forces, fit.best)
        least = thresholds.LEAST_RESIDUAL**2 * float(forces.square[fit.best])
        before, variance = variance, max(square, least) / len(p.columns)
        if abs(variance / before - 1.0) < thresholds.NOISE_AGREES:
            break
    return fit._replace(variance=variance)


def _narrowed(p: Problem, forces: Forces, log_weight: Callable[[Forces], Array]) -> Forces:
    """Left sides at the delays that are not improbable, closer to each other."""
    if p.delay.deviation == 0.0:
        return forces
    for _ in range(thresholds.DELAY_ROUNDS):
        weight = log_weight(forces)
        likely = np.flatnonzero(weight > weight.max() - thresholds.UNLIKELY_DELAY)
        step = float(forces.delays[1] - forces.delays[0])
        if len(likely) > thresholds.DELAYS_ENOUGH:
            break
        low, high = forces.delays[likely[0]] - step, forces.delays[likely[-1]] + step
        forces = p.forces(np.linspace(low, high, thresholds.DELAY_NODES))
    return forces


def _form_share(p: Problem, fit: Fit, residual: Array) -> float:
    """Share of the residual's variance that is an error of form, which does not average out."""
    least = (thresholds.FORM_ERROR**2 + _misplaced(p, float(p.shapes.slip[0]))) * p.coulomb**2
    if any(rows.capture.reference is not None for rows in p.parts):
        inertia = float(fit.known.mean[ACCELERATION, fit.best])
        least += thresholds.ANSWERED_NOISE * p.acceleration_noise / len(residual) * inertia**2
    return min(max(least / fit.variance, _repeating(residual)), 1.0)


def _misplaced(p: Problem, slip: float) -> float:
    """Mean square of the friction's error where reversals are misplaced by an encoder step, over its square."""
    total = 0.0
    for rows in p.parts:
        hidden, span = step_time(rows), rows.q * rows.capture.dt
        size = min(thresholds.MISPLACED, thresholds.STEPS_MISPLACED * rows.capture.encoder_step / slip)
        speed = motion(rows)[:, VELOCITY]
        rate = float(np.sum(np.diff(np.sign(speed)) != 0.0)) / (len(speed) * rows.places.step * rows.capture.dt)
        total += rows.rows * 2.0 * size**2 * rate * hidden * min(1.0, hidden / span) ** 2
    return total / sum(rows.rows for rows in p.parts)


def _correlation(residual: Array) -> Array:
    """Autocorrelation (n,) of a residual."""
    centred = residual - residual.mean()
    product = np.fft.irfft(np.abs(np.fft.rfft(centred, 2 * len(centred))) ** 2)[: len(centred)]
    return np.asarray(product / max(float(product[0]), 1e-300), dtype=np.float64)


def _near(residual: Array) -> float:
    """Rows that count as one by the correlation of neighbours: ``1 + 2 sum rho`` up to the first that is negative."""
    rho = _correlation(residual)
    negative = np.flatnonzero(rho <= 0.0)
    return max(1.0, float(2.0 * rho[: negative[0] if len(negative) else len(rho)].sum() - 1.0))


def _repeating(residual: Array) -> float:
    """Share of the residual's variance that comes back later in the record, from the correlation of distant rows."""
    count = len(residual)
    far = np.arange(min(thresholds.FAR_ROWS, count // 3), count // 2)
    if len(far) < thresholds.FAR_ROWS:
        return thresholds.SHORT_FORM_SHARE
    rho = _correlation(residual)[far] * count / (count - far)
    chance = thresholds.WINDOW_CORRELATION / count
    return math.sqrt(max(0.0, 2.0 * float(np.mean(rho * rho)) - 2.0 * chance))
