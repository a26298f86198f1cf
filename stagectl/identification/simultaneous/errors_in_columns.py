"""Least squares with weights that are not negative, and with a column that is itself noisy.

The acceleration is measured with noise: the encoder's rounding twice differentiated, and what currents that no
column shows have really moved.  Plain least squares takes it for too small an inertia, and where the motion barely
separates inertia and delay it follows that noise far off.  With the noise's variance ``v`` in that one column ``a``

    (X'X - N v e_a e_a') theta = X'y            v = (r^2 - s^2) / J^2

is free of it; ``r^2`` is the variance of the residual's noise and ``s^2`` the current sensor's share of it.

Intervals come from the residual as it is (heteroscedastic and autocorrelated: W. K. Newey, K. D. West, Econometrica
55(3), 1987), not from a variance taken as white.

Source: T. Soederstrom, Errors-in-Variables Methods in System Identification, Springer 2018 (bias-eliminating least
squares); C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, 1974 (NNLS).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize

from stagectl.identification.capture import Array

RIDGE = 1e-12  # of a column's squared length: two elements that never differed share their weight
APART = 4  # rows: the window's noise is uncorrelated over so many knot distances
SAME = 1e-9  # of the largest eigenvalue: below it two columns are one
MEMORY = 30  # rows over which the residual may be correlated; its window alone makes it six
BLOCK = 16384  # rows at a time


class Equations(NamedTuple):
    """``X'X`` of columns of unit length, and its Cholesky factor; the first `free` parameters may have any sign."""

    gram: Array  # (p, p)
    triangle: Array  # (p, p), upper
    length: Array  # (p,) of the columns
    rows: int
    free: int


class Solution(NamedTuple):
    """Parameters and what is left of the squares."""

    theta: Array  # (p,)
    cost: float


def equations(columns: Array, free: int) -> Equations:
    """Normal equations of `columns` (n, p)."""
    gram = np.zeros((columns.shape[1], columns.shape[1]))
    for first in range(0, len(columns), BLOCK):
        block = columns[first : first + BLOCK]
        gram += block.T @ block
    length = np.sqrt(np.diag(gram))
    length[length == 0.0] = 1.0
    gram = gram / np.outer(length, length) + RIDGE * np.eye(len(length))
    return Equations(gram, _triangle(gram), length, len(columns), free)


def _triangle(gram: Array) -> Array:
    return np.asarray(np.linalg.cholesky(gram).T, dtype=np.float64)


def selected(p: Equations, keep: list[int], free: int) -> Equations:
    """The same rows with only the columns `keep`."""
    gram = p.gram[np.ix_(keep, keep)]
    return Equations(gram, _triangle(gram), p.length[keep], p.rows, free)


def cleared(p: Equations, variance: float) -> Equations | None:
    """`p` without the noise of this `variance` in its first column; None where nothing but noise would be left."""
    gram = p.gram.copy()
    gram[0, 0] -= p.rows * variance / (p.length[0] * p.length[0])
    try:
        return p._replace(gram=gram, triangle=_triangle(gram))
    except np.linalg.LinAlgError:
        return None


def solved(p: Equations, moments: Array, square: float) -> Solution:
    """Least squares from ``moments = X'y`` (p,) and ``square = y'y``; weights behind the free columns are >= 0."""
    z = linalg.solve_triangular(p.triangle, moments / p.length, trans="T", check_finite=False)
    upper, lower = p.triangle[: p.free], p.triangle[p.free :, p.free :]
    weights, _ = optimize.nnls(lower, z[p.free :])
    left = lower @ weights - z[p.free :]
    right = z[: p.free] - upper[:, p.free :] @ weights
    free = linalg.solve_triangular(upper[:, : p.free], right, check_finite=False)
    return Solution(np.concatenate([free, weights]) / p.length, square - float(z @ z) + float(left @ left))


def noise(residual: Array) -> Array:
    """Squares (n - 2 APART,) whose mean is the variance of the residual's noise: what is slower than it cancels."""
    second = residual[2 * APART :] - 2.0 * residual[APART:-APART] + residual[: -2 * APART]
    return np.asarray(second * second / 6.0, dtype=np.float64)


def long_run(scores: Array) -> Array:
    """Covariance (p, p) of the sum of `scores` (n, p), correlated over up to MEMORY rows (Bartlett's weights).

    ``sum_l (1 - |l|/L) g_k g_k+l'`` is the mean product of the sums over all stretches of L rows, also those that
    reach over an end: no estimate of a variance can come out negative.
    """
    rows = len(scores)
    sums = np.vstack([np.zeros((1, scores.shape[1])), np.cumsum(scores, axis=0)])
    ends = np.arange(1, rows + MEMORY)
    stretches = sums[np.minimum(ends, rows)] - sums[np.maximum(ends - MEMORY, 0)]
    return np.asarray(stretches.T @ stretches / MEMORY, dtype=np.float64)


def spread(curvature: Array, scores: Array) -> Array:
    """Covariance (p, p) of the solution of ``sum of scores = 0`` with this `curvature` (p, p)."""
    inverse = np.linalg.pinv(curvature, rcond=SAME, hermitian=True)
    rows, width = scores.shape
    left = max(rows - width - 2 * MEMORY, rows // 4)  # the parameters and the weights of the lags take their share
    return np.asarray(inverse @ long_run(scores) @ inverse * (rows / left), dtype=np.float64)
