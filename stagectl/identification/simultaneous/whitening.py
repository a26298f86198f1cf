"""The noise's spectrum, from the residual itself: rows are filtered until what a fit leaves of them is white.

::

    e_k = r_k + a_1 r_(k-1) + ... + a_p r_(k-p)        the prediction error of the residual r, with the least power

Columns and left side of a regression that pass the filter keep their solution; their least squares are then those of
the noise as it is, slow or fast (Gauss, Aitken).  Noise that was held, a window, and an error of form that is slow
are all correlation of the residual, and belong to the noise.

The order p is that of the least criterion of Schwarz: white noise is left as it is.

Source: Yule's and Walker's equations, as in L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, section 10.1;
G. Schwarz, Annals of Statistics 6(2), 1978.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import linalg, signal

from stagectl.identification import thresholds
from stagectl.identification.capture import Array


class Whitening(NamedTuple):
    """A filter of prediction errors, and the rows of each capture, which are filtered apart."""

    weights: Array  # (p + 1,), the first is 1
    rows: tuple[int, ...]

    def __call__(self, rows: Array) -> Array:
        """The filtered `rows` (n, ...), without the first p of each capture: (m, ...)."""
        lost = len(self.weights) - 1
        if lost == 0:
            return rows
        parts = np.split(rows, np.cumsum(self.rows)[:-1])
        return np.concatenate([signal.lfilter(self.weights, np.ones(1), part, axis=0)[lost:] for part in parts])


def none(rows: Sequence[int]) -> Whitening:
    """The filter that leaves the rows as they are."""
    return Whitening(np.ones(1), tuple(rows))


def of(residual: Array, rows: Sequence[int], window: Array) -> Whitening:
    """The filter that whitens the noise of a `residual` (n,) of captures with so many `rows` each.

    `window` (k,) is the autocorrelation, from lag 0 on, of the window that all rows have passed.  It stays: beyond its
    cut-off the rows do not hold the equation of motion, so the noise is that of the residual before the window.
    """
    parts = np.split(residual, np.cumsum(rows)[:-1])
    most = int(min(thresholds.WHITENING_ORDER, min(rows) // thresholds.WHITENING_ROWS))
    products = np.sum([_products(part, most, window) for part in parts], axis=0)
    products[0] *= 1.0 + thresholds.WHITENING_RIDGE
    if products[0] <= 0.0:
        return none(rows)
    independent = len(residual) * window[0] / (2.0 * window.sum() - window[0])
    weights = min(
        (_predictor(products[: order + 1]) for order in range(most + 1)),
        key=_criterion(products, independent),
    )
    return Whitening(weights, tuple(rows))


def _predictor(products: Array) -> Array:
    """Weights (p + 1,) of the prediction error by the p values before."""
    if len(products) == 1:
        return np.ones(1)
    return np.concatenate([[1.0], -linalg.solve_toeplitz(products[:-1], products[1:])])


def _criterion(products: Array, independent: float) -> Callable[[Array], float]:
    """Schwarz' criterion of a filter: the prediction error's power, and what its order costs."""

    def criterion(weights: Array) -> float:
        power = float(weights @ products[: len(weights)])
        return independent * math.log(power) + (len(weights) - 1) * math.log(independent)

    return criterion


def _products(part: Array, order: int, window: Array) -> Array:
    """Sums (order + 1,) of what a residual was before its window with itself 0, 1, ... rows later."""
    length = 2 * max(len(part), len(window))
    power = np.abs(np.fft.rfft(part, length)) ** 2
    passed = 2.0 * np.fft.rfft(window, length).real - window[0]
    inside = passed >= thresholds.WINDOW_PASSES * passed.max()
    before = np.where(inside, power / np.where(inside, passed, 1.0), 0.0)
    before[~inside] = before[inside].mean()
    return np.asarray(np.fft.irfft(before)[: order + 1], dtype=np.float64)
