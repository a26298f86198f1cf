"""How many rows count as one: the window correlates neighbours, and an error of form repeats in every stroke."""

import math

import numpy as np

from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous.model import Problem
from stagectl.identification.simultaneous.regressors import FREE
from stagectl.identification.standard_errors import correlations, integrated_autocorrelation


def worth(residual: Array, form_share: float) -> float:
    """Rows that count as one where this share of the `residual` (n,) is an error of form."""
    near = max(thresholds.WINDOW_CORRELATION, integrated_autocorrelation(residual - residual.mean()))
    return near + len(residual) * form_share / thresholds.FORM_VALUES


def of_sum(influence: Array, residual: Array, worth: float) -> float:
    """Variance of the sum of the `influence` (n,) times the whitened `residual` (n,), of which `worth` rows are one.

    Friction changes at a reversal, and there a law is wrong.  No time later does such an error of form come back if the
    motion does not.  So rows that are too far off for the noise of the others hold `FORM_VALUES` values together.
    """
    squares, size = (influence * residual) ** 2, np.abs(residual)
    off = size > thresholds.BEYOND_NOISE * np.median(size)
    return float(worth * squares.sum() + off.sum() / thresholds.FORM_VALUES * squares[off].sum())


def form_share(p: Problem, residual: Array, variance: float, theta: Array) -> float:
    """Share of the residual's `variance` that is an error of form, which does not average out.

    Where the encoder's steps are seen, what is not rounding is the error of a path that is known to a count: it comes
    back in every stroke.  The filter of rounding makes an error of form larger, as it does the friction of `theta`.
    """
    size, path = p.coulomb, 0.0
    if p.stepped:
        size, path = float(np.std(p.white[:, FREE:] @ theta[FREE:])), 1.0 - p.moved_share
    return min(max((thresholds.FORM_ERROR * size) ** 2 / variance, _repeating(residual), path), 1.0)


def _repeating(residual: Array) -> float:
    """Share of the residual's variance that comes back later in the record, from the correlation of distant rows."""
    count = len(residual)
    far = np.arange(min(thresholds.FAR_ROWS, count // 3), count // 2)
    if len(far) < thresholds.FAR_ROWS:
        return thresholds.SHORT_FORM_SHARE
    rho = correlations(residual - residual.mean())[far] * count / (count - far)
    chance = thresholds.WINDOW_CORRELATION / count
    return math.sqrt(max(0.0, 2.0 * float(np.mean(rho * rho)) - 2.0 * chance))
