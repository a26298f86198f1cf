"""Gram matrices free of what the nuisances can explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import least_squares
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.run_products import first_fold
from stagectl.gap.residuals.thresholds import SINGULAR_NUISANCE


def folds(g: Grams, channel: Array) -> Array:
    """(2, p + 1, p + 1) sums of the matrices (c, p + 1, p + 1) of one channel over the two folds of half strokes."""
    first = first_fold(g.stroke).astype(np.float64)
    return np.stack([np.tensordot(fold, channel, 1) for fold in (first, 1.0 - first)])


def against(g: Array, residual: int) -> Array:
    """`g` (..., p + 1, p + 1) with the column `residual` in the place of the residual."""
    order = [*range(g.shape[-1] - 1), residual]
    return g[..., order, :][..., :, order]


def partialled_out(both: Array, nuisance: Sequence[int]) -> Array:
    """The folds (2, p + 1, p + 1) with all columns and the residual less what the nuisances explain on all data."""
    g, n = both.sum(axis=0), list(nuisance)
    a = g[np.ix_(n, n)] + least_squares.ridge(g[n, n])
    scale = least_squares.column_lengths(a)
    explained = np.linalg.pinv(a / np.outer(scale, scale), rcond=SINGULAR_NUISANCE, hermitian=True) @ (
        g[n] / scale[:, None]
    )
    explained = explained / scale[:, None]
    crossed = both[:, :, n] @ explained  # columns against what nuisances make of the others
    free: Array = both - crossed - np.swapaxes(crossed, 1, 2) + explained.T @ both[:, n][:, :, n] @ explained
    return free
