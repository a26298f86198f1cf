"""Linear estimates from the Gram matrices of half strokes: bounded steps, and covariances by cluster.

The residual is not white, so the covariance is the sandwich whose clusters are the half strokes (K.-Y. Liang,
S. L. Zeger, Biometrika 73(1), 1986).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import least_squares
from stagectl.gap.residuals.gram_matrices import Grams


def bounded_step(g: Grams, names: Sequence[str], low: Array, high: Array) -> dict[str, float]:
    """Least squares of the columns `names` on all data, each amplitude within `low` and `high` (k,)."""
    step = least_squares.bounded(g.both.sum(axis=0), g.places(names), low, high)
    return dict(zip(names, step.tolist(), strict=True))


def clustered_covariance(g: Grams, names: Sequence[str]) -> Array:
    """Covariance (k, k) of the least-squares amplitudes of `names`, robust against correlation within half strokes."""
    places, summed = g.places(names), g.both.sum(axis=0)
    inverse = least_squares.inverse(summed[np.ix_(places, places)])
    best = inverse @ summed[places, -1]
    scores = np.array([stroke[places, -1] - stroke[np.ix_(places, places)] @ best for stroke in g.both])
    covariance: Array = inverse @ (scores.T @ scores) @ inverse
    return covariance


def standard_deviations(g: Grams, names: Sequence[str]) -> dict[str, float]:
    """Standard deviations of the same amplitudes."""
    variances = np.diag(clustered_covariance(g, names))
    return dict(zip(names, np.sqrt(np.maximum(variances, 0.0)).tolist(), strict=True))
