"""Least squares with non-negative weights, where noise in a column would bias it: two ways to remove the bias.

**One noisy column.**  The acceleration is measured with noise: the encoder's rounding twice differentiated, and
motion by currents that no column shows.  Plain least squares then finds too small an inertia, and where the motion
barely separates inertia and delay it follows that noise far off.  With the noise's variance ``v`` in that column ``a``

    (X'X - N v e_a e_a') theta = X'y            v = (r^2 - s^2) / J^2

is free of it; ``r^2`` is the variance of the residual's noise and ``s^2`` the current sensor's share of it.

**Instruments.**  In closed loop the controller responds to the noise, so current and position hold the same noise and
no least squares is free of it.  The reference is: columns ``Z`` made from it know the motion, but not the noise.
Position and current are projected on them, ``P = Z (Z'Z)^-1 Z'``, and the equation of motion is solved there
(two-stage least squares)::

    minimise |P (y - X theta)|^2        X'P (y - X theta) = 0

Source: T. Soederstrom, Errors-in-Variables Methods in System Identification, Springer 2018 (bias-eliminating least
squares); C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, 1974 (NNLS); P. C. Young, Recursive Estimation
and Time-Series Analysis, Springer 2011, and A. Janot, P.-O. Vandanjon, M. Gautier, IEEE Trans. Control Systems
Technology 22(1), 2014 (instruments).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize

from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture
from stagectl.identification.simultaneous.regressors import FREE, Part, columns

BLOCK = 16384  # rows at a time


class Equations(NamedTuple):
    """``X'X`` of columns of unit length, and its Cholesky factor; the first `free` parameters may have any sign."""

    gram: Array  # (p, p)
    triangle: Array  # (p, p), upper
    length: Array  # (p,) of the columns
    rows: int
    free: int


class Solution(NamedTuple):
    """Parameters and the remaining sum of squares."""

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
    gram = gram / np.outer(length, length) + thresholds.COLUMN_RIDGE * np.eye(len(length))
    return Equations(gram, _triangle(gram), length, len(columns), free)


def _triangle(gram: Array) -> Array:
    return np.asarray(np.linalg.cholesky(gram).T, dtype=np.float64)


def selected(p: Equations, keep: list[int], free: int) -> Equations:
    """The same rows with only the columns `keep`."""
    gram = p.gram[np.ix_(keep, keep)]
    return Equations(gram, _triangle(gram), p.length[keep], p.rows, free)


def cleared(p: Equations, variance: float) -> Equations | None:
    """`p` without the noise of this `variance` in its first column; None where only noise would remain."""
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
    remainder = lower @ weights - z[p.free :]
    right = z[: p.free] - upper[:, p.free :] @ weights
    free = linalg.solve_triangular(upper[:, : p.free], right, check_finite=False)
    return Solution(np.concatenate([free, weights]) / p.length, square - float(z @ z) + float(remainder @ remainder))


def noise(residual: Array) -> Array:
    """Squares (n - 2 lag,) whose mean is the variance of the residual's noise: slower parts of the residual cancel."""
    second = (
        residual[2 * thresholds.NOISE_LAG :]
        - 2.0 * residual[thresholds.NOISE_LAG : -thresholds.NOISE_LAG]
        + residual[: -2 * thresholds.NOISE_LAG]
    )
    return np.asarray(second * second / 6.0, dtype=np.float64)


class Instruments(NamedTuple):
    """Columns of unit length, and the Cholesky factor of their products."""

    columns: Array  # (rows, m)
    triangle: Array  # (m, m), upper


def follows_reference(capture: Capture) -> bool:
    """Whether the capture holds a reference that its position follows."""
    if capture.reference is None or not np.all(np.isfinite(capture.reference)):
        return False
    error = float(np.std(capture.reference - capture.position))
    close = error <= thresholds.FOLLOWED_REFERENCE * float(np.ptp(capture.position))
    return close and float(np.ptp(capture.reference)) > 0.0


def instruments(parts: list[Part], slip: Array) -> Instruments:
    """Instruments from the reference on the same rows, and those that a change of the delay would add."""
    stacked = np.vstack([_instrument_columns(part, slip) for part in parts])
    length = np.sqrt(np.einsum("ij,ij->j", stacked, stacked))
    stacked = stacked[:, length > 0.0] / length[length > 0.0]
    gram = stacked.T @ stacked + thresholds.INSTRUMENT_RIDGE * np.eye(stacked.shape[1])
    return Instruments(stacked, np.asarray(np.linalg.cholesky(gram).T, dtype=np.float64))


def _instrument_columns(part: Part, slip: Array) -> Array:
    reference = part._replace(capture=part.capture._replace(position=np.asarray(part.capture.reference)))
    rates = columns(reference, slip[:: thresholds.INSTRUMENT_RATES], 1)
    return np.hstack([columns(reference, slip), rates[:, :1], rates[:, FREE:]])


def seen(p: Instruments, signal: Array) -> Array:
    """Coordinates (m, ...) of `signal` (rows, ...) in the space of the instruments; their squares are its length."""
    stacked = linalg.solve_triangular(p.triangle, p.columns.T @ signal, trans="T", check_finite=False)
    return np.asarray(stacked, dtype=np.float64)


def projected(p: Instruments, signal: Array) -> Array:
    """`signal` (rows, ...) projected on the space of the instruments."""
    projection = p.columns @ linalg.solve_triangular(p.triangle, seen(p, signal), check_finite=False)
    return np.asarray(projection, dtype=np.float64)
