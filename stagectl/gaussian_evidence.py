"""Linear Gaussian models with priors: what the data say of the parameters, and how well the model explains them.

A model is ``y = X p + e``, rows whitened (``e`` of unit variance), prior ``p ~ N(mean, precision^-1)``.  All that is
needed of the data are the sums ``X'X``, ``X'y`` and ``y'y``.  Where the rows are known to carry less than their number
says, all three are multiplied by a power in (0, 1): a tempered likelihood.

Sources: MacKay, Information Theory, Inference, and Learning Algorithms, 2003, chapters 27 and 28; P. Gruenwald and
T. van Ommen, Bayesian Analysis 12(4), 2017.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class Sums(NamedTuple):
    """Sums over the whitened rows of a record; those of several records add up."""

    gram: Matrix  # X'X, (n, n)
    right: Vector  # X'y, (n,)
    square: float | Vector  # y'y; (k,) of k left sides, with `right` (n, k)


class Prior(NamedTuple):
    """What is known of the parameters before the data; a precision of zero is no knowledge."""

    mean: Vector  # (n,)
    precision: Matrix  # (n, n), the inverse of the covariance


class Posterior(NamedTuple):
    """What is known of the parameters after the data."""

    mean: Vector  # (n,)
    log_evidence: float  # log of the integral over the parameters, less the constant of the rows' number


def independent(mean: Vector, deviation: Vector) -> Prior:
    """The prior of independent parameters with these standard deviations; one of infinity is no knowledge."""
    return Prior(mean, np.diag(np.asarray(deviation, dtype=np.float64) ** -2.0))


def posterior(sums: Sums, prior: Prior) -> Posterior:
    """Condition the prior on the data.

    Where a parameter has no prior its flat density is taken as 1: the evidence then compares only models that have the
    same such parameters.  Raises numpy.linalg.LinAlgError where neither prior nor data determine a parameter.
    """
    alone = posteriors(Sums(sums.gram, sums.right[:, None], np.atleast_1d(sums.square)), prior)
    return Posterior(alone.mean[:, 0], float(alone.log_evidence[0]))


class Posteriors(NamedTuple):
    """What is known after each of several data that share their columns."""

    mean: Matrix  # (n, k)
    factor: tuple[Matrix, bool]  # of the posterior's precision, which they share; for `scipy.linalg.cho_solve`
    log_evidence: Vector  # (k,)


def posteriors(sums: Sums, prior: Prior) -> Posteriors:
    """`posterior` for k left sides at once: ``right`` is (n, k), ``square`` (k,)."""
    factor = cho_factor(sums.gram + prior.precision, lower=True)
    pull = prior.precision @ prior.mean
    right = sums.right + pull[:, None]
    mean = cho_solve(factor, right)
    gain = np.sum(right * mean, axis=0) - pull @ prior.mean - sums.square
    volume = _log_determinant(prior.precision) - 2.0 * float(np.log(np.diag(factor[0])).sum())
    return Posteriors(mean, factor, np.asarray(0.5 * (gain + volume)))


def _log_determinant(precision: Matrix) -> float:
    """Of the part that is known: a parameter without a prior counts as 1."""
    diagonal = np.diag(precision)
    values = diagonal if np.array_equal(precision, np.diag(diagonal)) else np.linalg.eigvalsh(precision)
    return float(np.log(values[values > 0.0]).sum())
