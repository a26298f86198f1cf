"""Standard errors of a regression whose residual need be neither white nor of one size.

    cov = (X'X)^-1 S (X'X)^-1 n/(n - k)        S = sum_l w_l (G_l + G_l')     G_l = sum_t x_t r_t r_(t-l) x_(t-l)'

with Bartlett's weights ``w_l = 1 - l/(L + 1)``.  `covariance` takes Andrews' choice of L for scores that are
first-order autoregressive.

Source: W. K. Newey, K. D. West, Econometrica 55(3), 1987; D. W. K. Andrews, Econometrica 59(3), 1991.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.identification.capture import Array
from stagectl.identification.thresholds import STIFFEST_SCORES


class Solution(NamedTuple):
    """A least-squares estimate."""

    values: Array  # (k,)
    covariance: Array  # (k, k)
    residual: Array  # (n,)


def solved(columns: Array, force: Array, ends: Sequence[int] | NDArray[np.int64] = ()) -> Solution:
    """Least squares of `force` (n,) over `columns` (n, k), scaled to unit length so that units do not matter."""
    length = np.linalg.norm(columns, axis=0) + 1e-300
    unit = columns / length
    scaled, *_ = np.linalg.lstsq(unit, force, rcond=None)
    residual = force - unit @ scaled
    return Solution(scaled / length, covariance(unit, residual, ends) / np.outer(length, length), residual)


def covariance(regressor: Array, residual: Array, ends: Sequence[int] | NDArray[np.int64] = ()) -> Array:
    """Covariance (k, k) of the least-squares estimate with `regressor` (n, k) and `residual` (n,).

    `ends` are the rows at which one record ends and the next begins: two records are not correlated.
    """
    information = np.linalg.inv(regressor.T @ regressor)
    return np.asarray(information @ of_sum(regressor * residual[:, None], ends) @ information)


def of_sum(scores: Array, ends: Sequence[int] | NDArray[np.int64] = ()) -> Array:
    """Covariance (k, k) of the sum over the rows of `scores` (n, k): S, times ``n/(n - k)`` of each record."""
    return np.asarray(sum(_middle(part) for part in np.split(scores, ends)))


def _middle(scores: Array) -> Array:
    """The sum S (k, k) of one record's scores (n, k), times ``n/(n - k)``."""
    rows, count = scores.shape
    lag = min(bandwidth(scores), rows // 4)
    middle = scores.T @ scores
    for shift in range(1, lag + 1):
        product = scores[shift:].T @ scores[:-shift]
        middle += (1.0 - shift / (lag + 1.0)) * (product + product.T)
    return np.asarray(middle * (rows / (rows - count)))


def bandwidth(scores: Array) -> int:
    """Andrews' number of lags for `scores` (n, k): ``1.1447 (alpha n)^(1/3)``."""
    rho = np.clip([autocorrelation(column) for column in scores.T], -STIFFEST_SCORES, STIFFEST_SCORES)
    size = np.mean(scores * scores, axis=0) * (1.0 - rho * rho)
    size = (size / max(float(size.max()), 1e-300)) ** 2 if np.any(size > 0.0) else np.ones_like(size)
    above = np.sum(4.0 * rho**2 * size / ((1.0 - rho) ** 6 * (1.0 + rho) ** 2))
    alpha = above / np.sum(size / (1.0 - rho) ** 4)
    return int(np.ceil(1.1447 * (alpha * len(scores)) ** (1.0 / 3.0)))


def autocorrelation(column: Array) -> float:
    """Correlation of a column (n,) with itself one row later."""
    power = float(column @ column)
    return float(column[1:] @ column[:-1]) / power if power > 0.0 else 0.0


def independent(residual: Array) -> float:
    """Number of independent values that the residual (n,) is worth: ``n (1 - rho)/(1 + rho)``, at most n."""
    rho = min(max(autocorrelation(residual - residual.mean()), 0.0), STIFFEST_SCORES)
    return len(residual) * (1.0 - rho) / (1.0 + rho)


def integrated_autocorrelation(residual: Array) -> float:
    """``1 + 2 sum rho_k`` of a `residual` (n,), up to the first lag k at which rho is not positive; at least 1."""
    rho = correlations(residual)
    negative = np.flatnonzero(rho <= 0.0)
    return max(1.0, float(2.0 * np.sum(rho[: negative[0] if len(negative) else len(rho)]) - 1.0))


def correlations(residual: Array) -> Array:
    """Correlation (n,) of a residual (n,) with itself k rows later."""
    products = np.fft.irfft(np.abs(np.fft.rfft(residual, 2 * len(residual))) ** 2)[: len(residual)]
    return np.asarray(products / max(float(products[0]), 1e-300), dtype=np.float64)
