"""The noise's spectrum, from the residual itself: rows are filtered until what a fit leaves of them is white.

::

    e_k = r_k + a_1 r_(k-1) + ... + a_p r_(k-p)        the prediction error of the residual r, with the least power

Columns and left side of a regression that pass the filter keep their solution; their least squares are then those of
the noise as it is, slow or fast (Gauss, Aitken).  Noise that was held, a window, and an error of form that is slow
are all correlation of the residual, and belong to the noise.

The order p is that of the least criterion of Schwarz: white noise is left as it is.

**Rounding** of the position is white noise in the position, and of two derivatives in the acceleration: no filter of
some rows whitens it, nor may a low-pass window do so.  In a closed loop the controller answers to rounding, and only
all frequencies together tell that the answer comes after it: a regression that sees none above a cut-off finds the
current late, by milliseconds.  So rows with such noise have a window that passes the controller's answers, and a filter
with the poles of a Kalman filter for noise in force and position, ``1 / (s^2 + sqrt(2) w s + w^2)``: the prediction
error of the position.

Source: prediction errors in closed loop, L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, section 13.4;
Yule's and Walker's equations, section 10.1; G. Schwarz, Annals of Statistics 6(2), 1978.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import linalg, signal

from stagectl.identification import thresholds
from stagectl.identification.capture import Array

CUBIC = np.convolve([1.0, 2.0 - math.sqrt(3.0)], [1.0, 2.0 - math.sqrt(3.0)])  # causal factor of the cubic B-spline


class Whitening(NamedTuple):
    """A filter of prediction errors, and the rows of each span, which are filtered apart."""

    weights: Array  # (p + 1,), the first is 1
    rows: tuple[int, ...]
    corner: float = math.inf  # rad per row, from which on the noise is that of rounding; inf: nowhere

    @property
    def poles(self) -> Array:
        """Denominator (1,) or (3,) of the filter: rounding's rate of rate is not amplified above the corner."""
        if math.isinf(self.corner):
            return np.ones(1)
        turn = self.corner * math.sqrt(0.5)
        rounding = np.array([1.0, -2.0 * math.exp(-turn) * math.cos(turn), math.exp(-2.0 * turn)])
        return np.convolve(rounding, CUBIC)

    @property
    def lost(self) -> int:
        """Rows at the start of a span on which the filter has not settled."""
        settling = 0 if math.isinf(self.corner) else math.ceil(thresholds.CORNER_SETTLES / self.corner)
        return len(self.weights) - 1 + settling

    @property
    def kept(self) -> tuple[int, ...]:
        """Rows that are left of each span that is long enough."""
        return tuple(rows - self.lost for rows in self.rows if rows > self.lost)

    @property
    def response(self) -> Array:
        """Answer (k,) to one row."""
        return np.asarray(signal.lfilter(self.weights, self.poles, np.eye(1, self.lost + 1)[0]))

    def __call__(self, rows: Array) -> Array:
        """The filtered `rows` (n, ...), without the first p of each span: (m, ...)."""
        if self.lost == 0:
            return rows
        parts = np.split(rows, np.cumsum(self.rows)[:-1])
        return np.concatenate([signal.lfilter(self.weights, self.poles, part, axis=0)[self.lost :] for part in parts])


def none(rows: Sequence[int]) -> Whitening:
    """The filter that leaves the rows as they are."""
    return Whitening(np.ones(1), tuple(rows))


def with_corner(rows: Sequence[int], corner: float) -> Whitening:
    """The filter with this corner (rad per row), or the nearest that spans of so many `rows` allow."""
    return none(rows)._replace(corner=float(np.clip(corner, *_corners(rows))))


def _corners(rows: Sequence[int]) -> tuple[float, float]:
    """Least and largest corner (rad per row) that are tried: the filters settle in a share of all rows."""
    low, high = thresholds.CORNERS
    return min(max(low, thresholds.CORNER_SETTLES * thresholds.CORNER_SHARE / float(np.mean(rows))), high), high


def of_rounding(residual: Array, rows: Sequence[int], window: Array) -> Whitening:
    """The filter that whitens the noise of a `residual` in which the encoder's steps are seen.

    Of the corners, that which leaves the flattest spectrum; then what is left of its colour.
    """
    corners = np.geomspace(*_corners(rows), thresholds.CORNERS_TRIED)
    tried = [none(rows)._replace(corner=corner) for corner in corners.tolist()]
    first = min(tried, key=lambda one: _unevenness(one(residual), one.kept, window))
    return of(first(residual), first.kept, window)._replace(rows=tuple(rows), corner=first.corner)


def _unevenness(residual: Array, rows: Sequence[int], window: Array) -> float:
    """Log of the power's mean less the mean of its log, below the window's cut-off, times rows (P. Whittle)."""
    total = 0.0
    for part in np.split(residual, np.cumsum(rows)[:-1]):
        power = _before(part, window)
        power = power[power > 0.0]
        total += len(part) * (math.log(power.mean()) - float(np.log(power).mean()))
    return total


def of(residual: Array, rows: Sequence[int], window: Array) -> Whitening:
    """The filter that whitens the noise of a `residual` (n,) of spans with so many `rows` each.

    `window` (k,) is the autocorrelation, from lag 0 on, of the window that all rows have passed.  It stays: beyond its
    cut-off the rows do not hold the equation of motion, so the noise is that of the residual before the window.
    """
    parts = np.split(residual, np.cumsum(rows)[:-1])
    most = min(thresholds.WHITENING_ORDER, int(np.mean(rows)) // thresholds.WHITENING_ROWS)
    products = np.sum([_products(part, most, window) for part in parts], axis=0)
    products[0] *= 1.0 + thresholds.WHITENING_RIDGE
    if products[0] <= 0.0:
        return none(rows)
    independent = len(residual) * window[0] / (2.0 * window.sum() - window[0])

    def criterion(weights: Array) -> float:
        """Schwarz': the prediction error's power, and what a filter's order costs."""
        power = float(weights @ products[: len(weights)])
        return float(independent * math.log(power) + (len(weights) - 1) * math.log(independent))

    return Whitening(min((_predictor(products[: p + 1]) for p in range(most + 1)), key=criterion), tuple(rows))


def floor(column: Array, rows: Sequence[int], window: Array) -> float:
    """Largest variance of white noise, after the window, that is in a whitened `column` (n,): at no frequency more."""
    least = 0.0
    for part in np.split(column, np.cumsum(rows)[:-1]):
        power = _before(part, window)
        bands = np.array_split(power[power > 0.0], thresholds.BANDS)
        least += min(float(band.mean()) if len(band) else 0.0 for band in bands)
    return least / len(column)


def _predictor(products: Array) -> Array:
    """Weights (p + 1,) of the prediction error by the p values before."""
    if len(products) == 1:
        return np.ones(1)
    return np.concatenate([[1.0], -linalg.solve_toeplitz(products[:-1], products[1:])])


def _products(part: Array, order: int, window: Array) -> Array:
    """Sums (order + 1,) of what a residual was before its window with itself 0, 1, ... rows later."""
    before = _before(part, window)
    inside = before > 0.0
    before[~inside] = before[inside].mean() if inside.any() else 0.0
    return np.asarray(np.fft.irfft(before)[: order + 1], dtype=np.float64)


def _before(part: Array, window: Array) -> Array:
    """Power (k,) of what a residual was before its window; 0 where the window does not pass it."""
    length = 2 * max(len(part), len(window), thresholds.WHITENING_ORDER)
    power = np.abs(np.fft.rfft(part, length)) ** 2
    passed = 2.0 * np.fft.rfft(window, length).real - window[0]
    inside = passed >= thresholds.WINDOW_PASSES * passed.max()
    return np.asarray(np.where(inside, power / np.where(inside, passed, 1.0), 0.0))
