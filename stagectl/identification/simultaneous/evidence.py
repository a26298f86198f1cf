"""Parameters, friction and delay of one axis as a linear Gaussian model with priors, averaged over what is not linear.

::

    Kt i(t - tau) = J a + D v + b + ripple + sum_k f_k F_k(x) + noise

The friction is the law that explains the motion best (`laws`), with its tangent, and dense columns of other laws
(`friction_columns`) for what that law leaves.  For a given delay ``tau`` and given scales of the dense columns' groups
everything is linear, with a Gaussian prior: J, D from the stage file with their doubt, dense columns of zero mean.  The
scales are chosen by evidence, and the answer is the average over delays and scales by their evidence.  So its interval
holds what the friction law does not settle.

**The noise's spectrum** is that of the residual (`whitening`): of the best law's first, then of the best fit's.  Noise
that is slow or held weighs as little as it knows.  Above the window's cut-off nothing is whitened.

**Noise in the acceleration.**  Where noise moved the axis, or the encoder's steps are seen, the residual's noise is in
the acceleration and not in the current: then ``a`` is the answer to ``i`` and not the reverse, and the likelihood has
the Jacobian ``n log J``.  To first order that takes ``n v`` from the square of the whitened acceleration,
``v = (r^2 - s^2) / J^2``, with ``r^2`` the square of the whitened residual and ``s^2`` the current sensor's share of it
(bias-eliminating least squares; T. Soederstrom, Errors-in-Variables Methods in System Identification, Springer 2018).
Delays and scales are compared with the variance that each of them leaves.  Where the encoder's noise is seen, that of
its rounding is taken out.

**Temper.**  Rows are worth less than their number: the window correlates neighbours, and what the columns leave of the
true law repeats in every stroke.  With a residual of variance ``s^2`` of which the share ``f`` is such an error, n rows
count as ``n / (c + n f / K)``: no record is worth more than K values per unit of error, however long it is.  ``f`` is
at least that of an error of form of `FORM_ERROR` of the friction.  The scales are chosen so, too: with every row worth
one, a long record takes a law's error of form for a scale of its own, and ten logs know less than one.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve

from stagectl import gaussian_evidence as gaussian
from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous import temper, whitening
from stagectl.identification.simultaneous.model import Forces, Problem, Scales
from stagectl.identification.simultaneous.regressors import ACCELERATION, window_correlation
from stagectl.identification.simultaneous.sensor_noise import current_noise, rounding_noise


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

    problem: Problem
    fits: list[Fit]
    weights: list[Array]  # (k,) of each fit; they sum to 1
    worth: float  # rows that count as one
    form_share: float  # of the residual's variance that is an error of form

    @property
    def best(self) -> Fit:
        """The most probable scales."""
        return self.fits[int(np.argmax([weight.sum() for weight in self.weights]))]

    @property
    def power(self) -> float:
        """What a row's square weighs in the most probable fit."""
        return 1.0 / (self.worth * self.best.variance)

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


def answered(p: Problem) -> Answer:
    """The posterior of all that is not known, and the problem without the noise in its acceleration."""
    forces = p.forces(p.delay.nodes)
    p = _without_noise(p, forces, thresholds.FIRST_SCALES)
    first = _most_probable(_searched(p, forces))
    # Dense columns may take up rounding with the inertia: there the law's residual shows the noise.
    p = p.whitened(p.whitening if p.stepped else p.noise(_residual(p, first, forces)))
    forces = p.forces(p.delay.nodes)
    p = _without_noise(p, forces, first.scales)
    fits = _searched(p, forces)
    best = _most_probable(fits)
    if plain := _plain(p, best, forces):
        p, forces = plain, plain.forces(p.delay.nodes)
        fits = _searched(p, forces)
        best = _most_probable(fits)
    residual = p.whitening(_residual(p, best, forces))
    share = temper.form_share(p, residual, best.variance, best.known.mean[:, best.best])
    worth = temper.worth(residual, share)
    fits = _searched(p, forces, worth)
    best = _most_probable(fits)
    likely = [fit for fit in fits if fit.log_weight.max() > best.log_weight.max() - thresholds.UNLIKELY]

    def again(fit: Fit, at: Forces) -> Fit:
        return _fit(p, at, fit.scales, worth, fit.variance)

    forces = _narrowed(p, forces, lambda at: again(best, at).log_weight)
    fits = [again(fit, forces) for fit in likely]
    top = max(float(fit.log_weight.max()) for fit in fits)
    weights = [np.exp(fit.log_weight - top) for fit in fits]
    total = float(sum(weight.sum() for weight in weights))
    return Answer(p, fits, [weight / total for weight in weights], worth, share)


def _plain(p: Problem, best: Fit, forces: Forces) -> Problem | None:
    """The problem with its rows as they are, if they leave far less of the force than the `best` fit of whitened ones.

    Both find the same parameters where the model holds, one of them with more chance.  Where it does not, whitening
    asks frequencies of which next to nothing is motion (J. A. Hausman, Econometrica 46(6), 1978).
    """
    if p.stepped:
        return None
    plain = p.whitened(whitening.none(p.whitening.rows))
    at = plain.forces(p.delay.nodes)
    plain = _without_noise(plain, at, best.scales)
    fit = _settled(plain, at, best.scales, _rough_variance(plain, at))
    left, least = (float(np.std(one)) for one in (_residual(p, best, forces), _residual(plain, fit, at)))
    return plain if left > thresholds.WHITE_LEAVES * least else None


def _most_probable(fits: list[Fit]) -> Fit:
    return max(fits, key=lambda fit: float(fit.log_weight.max()))


def _residual(p: Problem, fit: Fit, forces: Forces) -> Array:
    """Residual (rows,) at the most probable delay."""
    return np.asarray(forces.rows[:, fit.best] - p.columns @ fit.known.mean[:, fit.best], dtype=np.float64)


def _without_noise(p: Problem, forces: Forces, scales: Scales) -> Problem:
    """The problem without the noise of its acceleration, as far as the motion still determines the inertia."""
    full, rounded = p.gram, rounding_noise(p.parts, p.whitening.response)
    sensed = p.file.motor.force_constant**2 * np.array(current_noise(p.parts, p.whitening.response))
    most = thresholds.MOST_NOISE * _alone(full, ACCELERATION)
    floor = whitening.floor(p.white[:, ACCELERATION], p.whitening.kept, window_correlation(p.parts[0]))
    for _ in range(thresholds.NOISE_ROUNDS):
        fit = _settled(p, forces, scales, _rough_variance(p, forces))
        inertia = max(
            float(fit.known.mean[ACCELERATION, fit.best]), thresholds.LEAST_INERTIA * p.file.mechanics.inertia
        )
        # A controller answers rounding with a current, which looks like the sensor's noise: rounding is the least.
        possible = min(fit.variance, floor * inertia**2)
        most_moved, least_moved = np.clip(fit.variance - sensed, min(rounded * inertia**2, possible), possible)
        moved, doubt = 0.5 * (most_moved + least_moved), (most_moved - least_moved) / math.sqrt(12.0)
        if p.stepped:
            moved, doubt = min(rounded * inertia**2, fit.variance), 0.0
        noise, gram = min(len(p.white) * moved / inertia**2, most), full.copy()
        agrees = abs(noise - p.acceleration_noise) <= thresholds.NOISE_AGREES * noise
        gram[ACCELERATION, ACCELERATION] -= noise
        p = p._replace(
            gram=gram,
            acceleration_noise=noise,
            moved_share=min(moved / max(fit.variance, 1e-300), 1.0),
            noise_doubt=doubt / max(moved, 1e-300),
        )
        if agrees:
            break
    return p


def _alone(gram: Array, place: int) -> float:
    """Square of what no other column explains of the one at `place`."""
    size = np.sqrt(np.diag(gram)) + 1e-150
    unit = gram / np.outer(size, size) + thresholds.COLUMN_RIDGE * np.eye(len(gram))
    return float(size[place] ** 2 / np.linalg.inv(unit)[place, place])


def _fit(p: Problem, forces: Forces, scales: Scales, worth: float, variance: float) -> Fit:
    independent, power = len(p.white) / worth, 1.0 / (worth * variance)
    known = gaussian.posteriors(
        gaussian.Sums(power * p.gram, power * forces.right, power * forces.square), p.prior(scales)
    )
    inertia = np.maximum(known.mean[ACCELERATION], thresholds.LEAST_INERTIA * p.file.mechanics.inertia)
    square = p.residual_square(known.mean, forces)
    log_weight = known.log_evidence + 0.5 * power * (square - p.acceleration_noise * inertia**2)
    log_weight += independent * (p.moved_share * np.log(inertia) - 0.5 * np.log(square))
    log_weight += p.delay.log_density(forces.delays)
    return Fit(scales, forces.delays, known, log_weight, variance)


def _searched(p: Problem, forces: Forces, worth: float = thresholds.WINDOW_CORRELATION) -> list[Fit]:
    """Fits of all scales that a search along one group after the other tries, from the simplest law on."""
    tried: dict[Scales, Fit] = {}
    variance = _rough_variance(p, forces)

    def evidence(scales: Scales) -> float:
        nonlocal variance
        if scales not in tried:
            tried[scales] = _settled(p, forces, scales, variance, worth)
            variance = min(variance, tried[scales].variance)
        return float(tried[scales].log_weight.max())

    scales: Scales = thresholds.FIRST_SCALES
    for _ in range(thresholds.SCALE_ROUNDS):
        for group, choice in enumerate(thresholds.STEPPED_SCALES if p.stepped else thresholds.FRICTION_SCALES):
            scales = max(((*scales[:group], size, *scales[group + 1 :]) for size in choice), key=evidence)
    return list(tried.values())


def _rough_variance(p: Problem, forces: Forces) -> float:
    """Variance of the residual that the iterations begin with."""
    return thresholds.FIRST_VARIANCE * float(forces.square.mean()) / len(p.white)


def _settled(
    p: Problem, forces: Forces, scales: Scales, variance: float, worth: float = thresholds.WINDOW_CORRELATION
) -> Fit:
    """The fit whose residual has the variance that it assumes."""
    for _ in range(thresholds.NOISE_ROUNDS):
        fit = _fit(p, forces, scales, worth, variance)
        square = p.residual_square(fit.known.mean, forces)
        before, variance = variance, float(square[fit.best]) / len(p.white)
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
