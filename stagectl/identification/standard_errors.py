"""Honest standard errors of a regression: the residual need be neither white nor of one size.

    cov = (X'X)^-1 S (X'X)^-1 n/(n - k)        S = sum_l w_l (G_l + G_l')     G_l = sum_t x_t r_t r_(t-l) x_(t-l)'

with Bartlett's weights ``w_l = 1 - l/(L + 1)`` and Andrews' choice of L for scores that are first-order autoregressive.

Source: W. K. Newey, K. D. West, Econometrica 55(3), 1987; D. W. K. Andrews, Econometrica 59(3), 1991.
"""

from __future__ import annotations

import numpy as np

from stagectl.identification.capture import Array

SURE = 1.959964  # standard deviations either way hold 95 %
STIFFEST = 0.97  # correlation of neighbouring scores, beyond which a record is a trend


def covariance(regressor: Array, residual: Array) -> Array:
    """Covariance (k, k) of the least-squares estimate with `regressor` (n, k) and `residual` (n,)."""
    rows, count = regressor.shape
    scores = regressor * residual[:, None]
    lag = min(bandwidth(scores), rows // 4)
    middle = scores.T @ scores
    for shift in range(1, lag + 1):
        product = scores[shift:].T @ scores[:-shift]
        middle += (1.0 - shift / (lag + 1.0)) * (product + product.T)
    information = np.linalg.inv(regressor.T @ regressor)
    return np.asarray(information @ middle @ information * rows / (rows - count))


def white(regressor: Array, residual: Array) -> Array:
    """The textbook's covariance (k, k), which takes the residual as white."""
    rows, count = regressor.shape
    return np.asarray(np.linalg.inv(regressor.T @ regressor) * float(residual @ residual) / (rows - count))


def bandwidth(scores: Array) -> int:
    """Andrews' number of lags for `scores` (n, k): ``1.1447 (alpha n)^(1/3)``."""
    rho = np.clip([neighbours(column) for column in scores.T], -STIFFEST, STIFFEST)
    size = np.mean(scores * scores, axis=0) * (1.0 - rho * rho)
    size = (size / max(float(size.max()), 1e-300)) ** 2 if np.any(size > 0.0) else np.ones_like(size)
    above = np.sum(4.0 * rho**2 * size / ((1.0 - rho) ** 6 * (1.0 + rho) ** 2))
    alpha = above / np.sum(size / (1.0 - rho) ** 4)
    return int(np.ceil(1.1447 * (alpha * len(scores)) ** (1.0 / 3.0)))


def neighbours(column: Array) -> float:
    """Correlation of a column (n,) with itself one row later."""
    power = float(column @ column)
    return float(column[1:] @ column[:-1]) / power if power > 0.0 else 0.0


def independent(residual: Array) -> float:
    """How many independent numbers the residual (n,) is worth: ``n (1 - rho)/(1 + rho)``, at most n."""
    rho = min(max(neighbours(residual - residual.mean()), 0.0), STIFFEST)
    return len(residual) * (1.0 - rho) / (1.0 + rho)
