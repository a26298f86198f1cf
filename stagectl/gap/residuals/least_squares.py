"""Least squares on summed matrices ``[X r]' [X r]``: the rows are not touched again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from stagectl.gap.logs.session import Array

FLAT = 1e-9  # smallest eigenvalue of the correlations that is believed
RIDGE = 1e-10  # of each diagonal element: columns that these data cannot tell apart stay finite


class Fit(NamedTuple):
    """Least squares of some columns."""

    amplitude: Array  # (k,) in the order asked for
    misfit: float  # sum of squares left


def fit(g: Array, chosen: Sequence[int]) -> Fit:
    """Least squares on a summed matrix `g`."""
    chosen = list(chosen)
    a, b = g[np.ix_(chosen, chosen)], g[chosen, -1]
    a = a + np.diag(RIDGE * np.diag(a) + 1e-300)
    amplitude = np.asarray(np.linalg.pinv(a, hermitian=True, rcond=1e-14), dtype=np.float64) @ b
    return Fit(amplitude, misfit(g, chosen, amplitude))


def inverse(a: Array) -> Array:
    """Pseudo-inverse of normal equations (k, k) whose columns have units of their own."""
    scale = np.sqrt(np.diag(a))
    scale = np.where(scale > 0.0, scale, 1.0)
    found: Array = np.linalg.pinv(a / np.outer(scale, scale), rcond=FLAT, hermitian=True) / np.outer(scale, scale)
    return found


def bounded(g: Array, chosen: Sequence[int], low: Array, high: Array) -> Array:
    """Amplitudes (k,) of the least squares within `low` and `high`; zero must lie between them."""
    places = list(chosen)
    a, b = g[np.ix_(places, places)], g[places, -1]
    if not np.isfinite(a).all():  # a candidate has diverged: no step can be told
        return np.zeros(len(places))
    scale = np.sqrt(np.diag(a))
    scale = np.where(scale > 0.0, scale, 1.0)  # a column that these data do not have
    q, r = np.linalg.eigh(a / np.outer(scale, scale))  # columns of unit length
    root = np.sqrt(np.maximum(q, FLAT))
    bounds = (np.minimum(low * scale, -1e-12), np.maximum(high * scale, 1e-12))
    solved = lsq_linear(root[:, None] * r.T, (r.T @ (b / scale)) / root, bounds, method="bvls")
    amplitude: Array = solved.x / scale
    return amplitude


def misfit(g: Array, chosen: Sequence[int], amplitude: Array) -> float:
    """Sum of squares left by given amplitudes, on the data that `g` sums up."""
    chosen = list(chosen)
    a, b = g[np.ix_(chosen, chosen)], g[chosen, -1]
    return float(g[-1, -1] - 2.0 * b @ amplitude + amplitude @ a @ amplitude)
