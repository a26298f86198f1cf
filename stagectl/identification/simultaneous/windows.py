"""The window that all signals of a regression pass, and how wide a capture needs it.

The window is the quintic B-spline ``B`` of knot distance ``h = q dt``: 6 h long, -3 dB at 0.187/h, zero phase.  As it
is smooth itself, the derivative of the filtered signal is the signal filtered with the window's derivative, and a delay
is the window shifted, without interpolation between samples::

    y(t_k)        = sum_m x_m B(t_k - t_m) dt
    y'(t_k)       = sum_m x_m B'(t_k - t_m) dt
    y(t_k - tau)  = sum_m x_m B(t_k - t_m - tau) dt

The sampled window has a sum of exactly 1 at any shift.  Filtering both sides of a linear equation keeps its solution.

Source: modulating functions, M. Shinbrot, Trans. ASME 79, 1957; the paper's zero-phase low-pass (Simultaneous
Identification ..., section IV.B).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, signal

from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture

KNOTS = 3  # knot distances to either side
HALF = KNOTS + 1  # the same with room for a shift by a fraction of a sample


def window(q: int, dt: float, order: int = 0, shift: float = 0.0) -> Array:
    """Weights (2 HALF q + 1,) of the window's derivative of this `order`, late by `shift` (s) of at most a sample."""
    knots = q * dt * (np.arange(2 * KNOTS + 1) - KNOTS)
    spline = interpolate.BSpline.basis_element(knots, extrapolate=False)
    offsets = np.arange(-HALF * q, HALF * q + 1) * dt - shift
    weights = np.nan_to_num(spline.derivative(order)(offsets) if order else spline(offsets))
    return np.asarray(weights / q, dtype=np.float64)


def margin(q: int, dt: float, delay: float) -> int:
    """Samples that the window needs to either side of its middle at delays up to `delay` (s)."""
    return HALF * q + math.ceil(delay / dt)


class Rows(NamedTuple):
    """Samples at which a filtered signal is kept: of start, start + stride q, ... those of the spans."""

    start: int
    number: int  # with those between the spans
    q: int  # samples per knot distance
    stride: int = 1  # knot distances per row: 1, 2, 4 or 8
    spans: tuple[tuple[int, int], ...] = ()  # first row and end of each; empty: one of all rows

    @property
    def step(self) -> int:
        """Samples per row."""
        return self.q * self.stride

    @property
    def counts(self) -> tuple[int, ...]:
        """Rows of each span."""
        return tuple(end - first for first, end in self.spans or ((0, self.number),))

    @property
    def samples(self) -> NDArray[np.int64]:
        """Sample (count,) of each row that is kept."""
        return self.kept(self.start + self.step * np.arange(self.number))

    def kept(self, full: NDArray[Any]) -> NDArray[Any]:
        """The rows (..., count) of the spans, of all (..., number)."""
        return np.concatenate([full[..., first:end] for first, end in self.spans], axis=-1) if self.spans else full

    def thinned(self, stride: int) -> Rows:
        """Every row of so many."""
        spans = tuple((-(-first // stride), -(-end // stride)) for first, end in self.spans)
        return self._replace(number=-(-self.number // stride), stride=stride, spans=spans)

    def head(self, most: int) -> Rows:
        """The first so many of the rows that are kept."""
        ends = np.cumsum([0, *self.counts]).tolist()
        pairs = zip(self.spans, ends, strict=False)
        spans = tuple((first, min(end, first + most - before)) for (first, end), before in pairs if before < most)
        return self._replace(number=spans[-1][1] if spans else min(most, self.number), spans=spans)


def smoothed(x: Array, weights: Array, rows: Rows) -> Array:
    """`x` (..., n) filtered with `weights` at the samples `rows`: (..., count)."""
    half = HALF * rows.q
    part = x[..., rows.start - half : rows.start + (rows.number - 1) * rows.step + half + 1]
    full = signal.upfirdn(weights, part, up=1, down=rows.step, axis=-1)
    first = 2 * half // rows.step
    return np.asarray(rows.kept(full[..., first : first + rows.number]), dtype=np.float64)


def delayed(x: Array, delay: float, dt: float, rows: Rows) -> Array:
    """``x(t - delay)`` filtered at `rows`."""
    whole = round(delay / dt)
    return smoothed(x, window(rows.q, dt, shift=delay - whole * dt), rows._replace(start=rows.start - whole))


def shortest_knots(capture: Capture) -> int:
    """Samples per knot distance where noise does not matter."""
    return max(1, round(thresholds.SHORTEST_KNOTS / capture.dt))


def knots(capture: Capture) -> int:
    """Samples per knot distance: few, to resolve a reversal, unless the encoder's noise would fill the acceleration."""
    q = shortest_knots(capture)
    while (q + 1) * capture.dt <= thresholds.LONGEST_KNOTS and 2 * HALF * (q + 1) < len(capture.position) // 4:
        weights = window(q, capture.dt, 2)
        rms = acceleration(capture, q).std()
        if position_noise(capture) * math.sqrt(float(weights @ weights)) <= thresholds.WINDOWED_NOISE * float(rms):
            break
        q += 1
    return q


def acceleration(capture: Capture, q: int, order: int = 2) -> Array:
    """Acceleration of the whole capture (order 2), or its velocity (order 1), once per knot distance."""
    count = (len(capture.position) - 2 * HALF * q - 1) // q + 1
    x = capture.position - capture.position[0]
    return smoothed(x, window(q, capture.dt, order), Rows(HALF * q, count, q))


def position_noise(capture: Capture) -> float:
    """Standard deviation of the position's noise: that of rounding, or of high differences where it is larger."""
    return max(capture.encoder_step / math.sqrt(12.0), _seen(_differences(capture)[0]))


def only_rounds(capture: Capture) -> bool:
    """Whether the position shows no more noise than its encoder's rounding."""
    return position_noise(capture) <= thresholds.BEYOND_ROUNDING * capture.encoder_step / math.sqrt(12.0)


def resolution(capture: Capture) -> float:
    """The encoder step (rad | m), or that whose rounding would be as much as the noise where the position has far more.

    Time stamps that jitter, an estimated angle, an analogue sensor: a stage file says nothing of them.  What counts is
    how well a reversal is seen, so the noise is that of the slowest rows where it is less: that of jitter grows with
    the speed.  Where it is more, it is the friction that reverses there.
    """
    differences, travel = _differences(capture)
    slow = travel <= np.quantile(travel, thresholds.SLOWEST_ROWS) if len(travel) else travel > 0.0
    seen = math.sqrt(12.0) * min(_seen(differences), _seen(differences[slow]))
    return seen if seen > thresholds.BEYOND_ROUNDING * capture.encoder_step else capture.encoder_step


def _differences(capture: Capture) -> tuple[Array, Array]:
    """High differences (n,) of the position, of which white noise keeps its variance, and the travel meanwhile."""
    order = thresholds.NOISE_DIFFERENCES
    size = math.sqrt(math.comb(2 * order, order))
    travel = np.abs(capture.position[order:] - capture.position[:-order])
    return np.diff(capture.position, order) / size, travel


def _seen(differences: Array) -> float:
    """Standard deviation that normal differences of this median have."""
    return float(np.median(np.abs(differences))) / 0.6745 if len(differences) else 0.0
