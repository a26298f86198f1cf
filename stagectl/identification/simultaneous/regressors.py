"""Columns of the equation of motion from captured positions: acceleration, velocity, one, ripple, stop operators.

::

    Kt i(t - tau) = J a + D w + b + c sin(theta) + d cos(theta) + sum_j alpha_j S_j(x)

All columns and the left side pass the same window and are kept once per knot distance.  The state of an element at
the start is not known.  It is forgotten once the axis has moved by twice the element's slip in either direction; the
rows before that are left out.

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
from typing import NamedTuple

import numpy as np
from scipy import interpolate, signal

from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture

KNOTS = 3  # knot distances to either side
HALF = KNOTS + 1  # the same with room for a shift by a fraction of a sample
ACCELERATION, VELOCITY, ONE = 0, 1, 2
FREE = 3 + 2 * thresholds.RIPPLE_ORDERS  # columns before those of the friction
RIPPLE = slice(3, FREE)  # sine and cosine of one, two, ... periods a revolution


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
    """Samples at which a filtered signal is kept: start, start + stride q, ..."""

    start: int
    number: int
    q: int  # samples per knot distance
    stride: int = 1  # knot distances per row: 1, 2, 4 or 8

    @property
    def step(self) -> int:
        """Samples per row."""
        return self.q * self.stride


def smoothed(x: Array, weights: Array, rows: Rows) -> Array:
    """`x` (..., n) filtered with `weights` at the samples `rows`: (..., count)."""
    half = HALF * rows.q
    part = x[..., rows.start - half : rows.start + (rows.number - 1) * rows.step + half + 1]
    full = signal.upfirdn(weights, part, up=1, down=rows.step, axis=-1)
    first = 2 * half // rows.step
    return np.asarray(full[..., first : first + rows.number], dtype=np.float64)


def delayed(x: Array, delay: float, dt: float, rows: Rows, order: int = 0) -> Array:
    """``x(t - delay)`` filtered, or its derivative of this `order`, at `rows`."""
    whole = round(delay / dt)
    return smoothed(x, window(rows.q, dt, order, delay - whole * dt), rows._replace(start=rows.start - whole))


class Part(NamedTuple):
    """The rows of one capture that the regression uses."""

    capture: Capture
    places: Rows
    wide: int  # samples per knot distance at which rounding does not fill the acceleration

    @property
    def q(self) -> int:
        """Samples per knot distance."""
        return self.places.q

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.places.number


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
    """Standard deviation of the position's noise: that of rounding, unless high differences show far more."""
    order = thresholds.NOISE_DIFFERENCES
    differences = np.abs(np.diff(capture.position, order))
    seen = float(np.median(differences)) / 0.6745 / math.sqrt(math.comb(2 * order, order)) if len(differences) else 0.0
    rounding = capture.encoder_step / math.sqrt(12.0)
    return seen if seen > thresholds.BEYOND_ROUNDING * rounding else rounding


def resolution(capture: Capture) -> float:
    """The encoder step (rad | m) whose rounding is as much as the position's noise: a log may hold more than rounding.

    Time stamps that jitter, an estimated angle, an analogue sensor: a stage file says nothing of them.
    """
    return math.sqrt(12.0) * position_noise(capture)


def part(capture: Capture, wide: int, longest: float, delay: float) -> Part:
    """Rows on which elements up to the slip `longest` are known and a delay up to `delay` (s) has its samples."""
    q = max(1, round(thresholds.STEPPED_KNOTS / capture.dt)) if _seen(capture, wide) else wide
    room = margin(q, capture.dt, delay)
    moved = np.maximum.accumulate(capture.position) - np.minimum.accumulate(capture.position)
    known = int(np.searchsorted(moved, 2.0 * longest))
    start = max(room, known + HALF * q)
    return Part(capture, Rows(start, max(0, (len(capture.position) - room - start - 1) // q + 1), q), wide)


def calm(p: Part) -> Part:
    """The same capture with rows whose window hides the encoder's steps, where they are seen."""
    if not stepped(p):
        return p
    room = HALF * (p.wide - p.q)
    number = (p.places.number - 1) * p.places.step - 2 * room
    return p._replace(places=Rows(p.places.start + room, max(1, number // p.wide + 1), p.wide))


def thinned(parts: list[Part], most: int) -> list[Part]:
    """Every second, fourth or eighth row where there are more than `most` of all parts together."""
    total = sum(p.rows for p in parts)
    stride = next((step for step in (1, 2, 4) if total <= step * most), 8)
    return [p._replace(places=p.places._replace(number=(p.rows + stride - 1) // stride, stride=stride)) for p in parts]


def motion(p: Part) -> Array:
    """Columns (rows, `FREE`) of one capture without friction: acceleration, velocity, one, and those of a ripple."""
    x, dt = p.capture.position - p.capture.position[0], p.capture.dt
    smooth = window(p.q, dt)
    return np.column_stack(
        [
            smoothed(x, window(p.q, dt, 2), p.places),
            smoothed(x, window(p.q, dt, 1), p.places),
            np.ones(p.rows),
            *(
                smoothed(wave(order * p.capture.position), smooth, p.places)
                for order in range(1, thresholds.RIPPLE_ORDERS + 1)
                for wave in (np.sin, np.cos)
            ),
        ]
    )


def ripple_shares(parts: list[Part]) -> Array:
    """Scale of each ripple column, relative to that of once per revolution: (RIPPLE,).

    An order of which the motion sees less than `RIPPLE_PERIODS` periods would take up anything that changes with the
    position, the inertia of a sine's turning points above all; it is left out.
    """
    turns = max(float(np.ptp(p.capture.position)) for p in parts) / (2.0 * math.pi)
    orders = np.repeat(np.arange(1, thresholds.RIPPLE_ORDERS + 1), 2)
    seen = np.where(orders * turns >= thresholds.RIPPLE_PERIODS, thresholds.HIGHER_RIPPLE, 0.0)
    return np.where(orders == 1, 1.0, seen)


def track(p: Part) -> Array:
    """Position (n,) that a friction law follows: lightly smoothed, more where the encoder's steps are seen.

    Without it rounding alone would move the law to and fro at standstill and around a reversal.
    """
    x = p.capture.position - p.capture.position[0]
    q = _steps_seen(p)
    if q:
        weights = window(q, p.capture.dt)
        half = len(weights) // 2
        x = np.convolve(np.pad(x, half, mode="edge"), weights, "valid")
    return _lightly_smoothed(x)


def _steps_seen(p: Part) -> int:
    """Samples over which a path is smoothed because the encoder's steps are seen at its reversals; 0: they are not."""
    return min(round(0.5 * step_time(p) / p.capture.dt), p.wide)


def stepped(p: Part) -> bool:
    """Whether the encoder's noise is seen in the acceleration, so that its filter does the work of a wide window."""
    return _seen(p.capture, p.wide)


def _seen(capture: Capture, wide: int) -> bool:
    """Whether noise takes a window so `wide`; where few samples hide it, the sampling is too slow to follow it."""
    return wide >= max(thresholds.STEPPED_WIDE * shortest_knots(capture), thresholds.LEAST_KNOT_ROWS)


def coarse(p: Part) -> bool:
    """Whether rows or encoder are too coarse for a friction law to follow the measured path."""
    return p.capture.dt > thresholds.PATH_STEP or _steps_seen(p) > 0


def step_time(p: Part) -> float:
    """Time (s) in which the axis moves by an encoder step from a reversal."""
    rms = float(np.sqrt(np.mean(acceleration(p.capture, p.wide) ** 2)))
    return math.sqrt(2.0 * resolution(p.capture) / max(rms, 1e-300))


def _lightly_smoothed(x: Array) -> Array:
    """Position (n,) after a cubic B-spline over three samples."""
    light = x.copy()
    light[1:-1] = (x[:-2] + 4.0 * x[1:-1] + x[2:]) / 6.0
    return light


def currents(parts: list[Part], delays: Array) -> Array:
    """Current (rows, k) of all captures as it was at each of the `delays` (k,) s before."""
    return np.vstack(
        [
            np.column_stack([delayed(p.capture.current, delay, p.capture.dt, p.places) for delay in delays.tolist()])
            for p in parts
        ]
    )


def window_correlation(p: Part) -> Array:
    """Autocorrelation (k,) of white noise in the rows, from lag 0 on: that of the window."""
    weights = window(p.q, p.capture.dt)
    products = np.correlate(weights, weights, "full")[len(weights) - 1 :: p.places.step]
    return np.asarray(products / products[0], dtype=np.float64)


def controlled(capture: Capture) -> bool:
    """Whether a controller may have moved the axis: it follows a reference, or nothing says what moved it."""
    if capture.reference is None:
        return capture.excitation is None
    return float(np.ptp(capture.reference)) > 0.0
