"""Least squares on summed matrices ``[X r]' [X r]``, without touching the rows again."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.thresholds import FLAT, RIDGE, SINGULAR


class Fit(NamedTuple):
    """Least squares of some columns."""

    amplitude: Array  # (k,) in the order of the columns
    residual_sum_of_squares: float


def fit(g: Array, chosen: Sequence[int]) -> Fit:
    """Least squares of the columns `chosen` on a summed matrix `g` (p + 1, p + 1)."""
    chosen = list(chosen)
    a, b = g[np.ix_(chosen, chosen)], g[chosen, -1]
    a = a + ridge(np.diag(a))
    amplitude = np.asarray(np.linalg.pinv(a, hermitian=True, rcond=SINGULAR), dtype=np.float64) @ b
    return Fit(amplitude, residual_sum_of_squares(g, chosen, amplitude))


def ridge(diagonal: Array) -> Array:
    """(k, k) that is added to normal equations with this `diagonal` (k,): a trace of it."""
    return np.diag(RIDGE * diagonal + 1e-300)


def column_lengths(a: Array) -> Array:
    """(k,) lengths of the columns behind the normal equations `a` (k, k); one where the data do not have a column."""
    lengths = np.sqrt(np.diag(a))
    return np.where(lengths > 0.0, lengths, 1.0)


def inverse(a: Array) -> Array:
    """Pseudo-inverse of normal equations (k, k) whose columns differ in unit."""
    scale = column_lengths(a)
    return np.linalg.pinv(a / np.outer(scale, scale), rcond=FLAT, hermitian=True) / np.outer(scale, scale)


def bounded(g: Array, chosen: Sequence[int], low: Array, high: Array) -> Array:
    """Amplitudes (k,) of the least squares within `low` and `high` (k,), which must hold zero between them."""
    places = list(chosen)
    a, b = g[np.ix_(places, places)], g[places, -1]
    if not np.isfinite(a).all():  # a candidate has diverged: there is no step to take
        return np.zeros(len(places))
    scale = column_lengths(a)
    q, r = np.linalg.eigh(a / np.outer(scale, scale))  # columns of unit length
    root = np.sqrt(np.maximum(q, FLAT))
    bounds = (np.minimum(low * scale, -1e-12), np.maximum(high * scale, 1e-12))
    solved = lsq_linear(root[:, None] * r.T, (r.T @ (b / scale)) / root, bounds, method="bvls")
    return solved.x / scale


def residual_sum_of_squares(g: Array, chosen: Sequence[int], amplitude: Array) -> float:
    """Sum of squares that these amplitudes (k,) of the columns `chosen` leave, on the data that `g` sums up."""
    chosen = list(chosen)
    a, b = g[np.ix_(chosen, chosen)], g[chosen, -1]
    return float(g[-1, -1] - 2.0 * b @ amplitude + amplitude @ a @ amplitude)
