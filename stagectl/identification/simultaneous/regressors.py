"""Columns of the equation of motion from captured positions: acceleration, velocity, one, ripple, stop operators.

::

    Kt i(t - tau) = J a + D w + b + c sin(theta) + d cos(theta) + sum_j alpha_j S_j(x)

All columns and the left side pass the same window (`identification.smoothing`) and are kept once per knot distance.
What an element carries at the start is not known; it is forgotten once the axis has moved by twice the element's slip
in either direction, and the rows before that are left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from stagectl.identification.capture import Array, Capture
from stagectl.identification.simultaneous.smoothing import HALF, Rows, delayed, margin, smoothed, window
from stagectl.kernels import presliding

SHORTEST_KNOTS = 1.5e-3  # s, knot distance: the window passes 125 Hz
LONGEST_KNOTS = 0.03  # s
QUIET = 0.003  # noise that the encoder may leave in the acceleration, relative to its rms
BLOCK = 4096  # rows at a time, which keeps the memory of a long capture small
ACCELERATION, VELOCITY, ONE = 0, 1, 2
FREE = 5  # columns before the operators: the two of the ripple come after `ONE`


class Part(NamedTuple):
    """One capture, and the rows that are taken of it."""

    capture: Capture
    places: Rows

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
    return max(1, round(SHORTEST_KNOTS / capture.dt))


def knots(capture: Capture) -> int:
    """Samples per knot distance: short, to see a reversal, unless the encoder's noise would fill the acceleration."""
    q = shortest_knots(capture)
    while (q + 1) * capture.dt <= LONGEST_KNOTS and 2 * HALF * (q + 1) < len(capture.position) // 4:
        weights = window(q, capture.dt, 2)
        rms = acceleration(capture, q).std()
        if position_noise(capture) * math.sqrt(float(weights @ weights)) <= QUIET * float(rms):
            break
        q += 1
    return q


def acceleration(capture: Capture, q: int, order: int = 2) -> Array:
    """Acceleration of the whole capture (order 2), or its velocity (order 1), once per knot distance."""
    count = (len(capture.position) - 2 * HALF * q - 1) // q + 1
    x = capture.position - capture.position[0]
    return smoothed(x, window(q, capture.dt, order), Rows(HALF * q, count, q))


def position_noise(capture: Capture) -> float:
    """Standard deviation of the measured position: of rounding, or what fourth differences show above it."""
    differences = np.abs(np.diff(capture.position, 4))
    seen = float(np.median(differences)) / 0.6745 / math.sqrt(70.0) if len(differences) else 0.0
    return max(capture.encoder_step / math.sqrt(12.0), seen)


def part(capture: Capture, q: int, longest: float, delay: float) -> Part:
    """Rows on which elements up to the slip `longest` are known and a delay up to `delay` (s) has its samples."""
    room = margin(q, capture.dt, delay)
    moved = np.maximum.accumulate(capture.position) - np.minimum.accumulate(capture.position)
    known = int(np.searchsorted(moved, 2.0 * longest))
    start = max(room, known + HALF * q)
    return Part(capture, Rows(start, max(0, (len(capture.position) - room - start - 1) // q + 1), q))


def thinned(parts: list[Part], most: int) -> list[Part]:
    """Every second, fourth or eighth row where there are more than `most` of all parts together."""
    total = sum(p.rows for p in parts)
    stride = next((one for one in (1, 2, 4) if total <= one * most), 8)
    return [p._replace(places=p.places._replace(number=(p.rows + stride - 1) // stride, stride=stride)) for p in parts]


def columns(p: Part, slip: Array, order: int = 0) -> Array:
    """Regressor (rows, FREE + j) of one capture for elements of these slips (j,), or its derivative of this `order`."""
    x = p.capture.position - p.capture.position[0]
    smooth = window(p.q, p.capture.dt, order)
    found = np.full((p.rows, FREE + len(slip)), 1.0 if order == 0 else 0.0)
    found[:, ACCELERATION] = smoothed(x, window(p.q, p.capture.dt, order + 2), p.places)
    found[:, VELOCITY] = smoothed(x, window(p.q, p.capture.dt, order + 1), p.places)
    found[:, ONE + 1] = smoothed(np.sin(p.capture.position), smooth, p.places)
    found[:, ONE + 2] = smoothed(np.cos(p.capture.position), smooth, p.places)
    for first, block in _operators(p, x, slip, smooth):
        found[first : first + block.shape[1], FREE:] = block.T
    return found


def _operators(p: Part, x: Array, slip: Array, smooth: Array) -> Iterator[tuple[int, Array]]:
    """First row and smoothed states (j, rows) of the operators, block by block along the motion `x` (n,)."""
    half = HALF * p.q
    track, rate, states = _track(x), 1.0 / slip, np.zeros(len(slip))
    done = p.places.start - half
    _strained(track[: done + 3], rate, states)
    tail = _strained(track[done : done + 2 * half + 3], rate, states)
    done += 2 * half
    for first in range(0, p.rows, BLOCK):
        count = min(BLOCK, p.rows - first)
        more = min(count * p.places.step, len(x) - done)
        tail = np.hstack([tail, _strained(track[done : done + more + 3], rate, states)])
        done += more
        yield first, smoothed(tail, smooth, p.places._replace(start=half, number=count))
        tail = tail[:, count * p.places.step :]


def _track(x: Array) -> Array:
    """Position (n + 3,) that the operators follow, lightly smoothed (cubic B-spline); two more samples lead, one ends.

    Rounding alone would move them to and fro at standstill.
    """
    light = x.copy()
    light[1:-1] = (x[:-2] + 4.0 * x[1:-1] + x[2:]) / 6.0
    return np.concatenate([x[:1], x[:1], light, light[-1:]])


def _strained(track: Array, rate: Array, states: Array) -> Array:
    found = np.zeros((len(rate), max(len(track) - 3, 0)))
    presliding.strains(rate, states, np.ascontiguousarray(track), found)
    return found


def currents(parts: list[Part], delay: float, order: int = 0) -> Array:
    """Current (rows,) of all captures as it was `delay` (s) before, or its derivative in time of this `order`."""
    return np.concatenate([delayed(p.capture.current, delay, p.capture.dt, p.places, order) for p in parts])


def current_noise(parts: list[Part]) -> float:
    """Variance (A^2) that a current sensor's white noise leaves in the filtered current, as fourth differences show it.

    A commanded current has none; what a controller answers to the encoder's rounding counts as such noise, too.
    """
    total = 0.0
    for p in parts:
        weights, differences = window(p.q, p.capture.dt), np.diff(p.capture.current, 4)
        total += p.rows * float(weights @ weights) * float(np.mean(differences * differences)) / 70.0
    return total / sum(p.rows for p in parts)


def encoder_noise(parts: list[Part]) -> float:
    """Variance (rad^2/s^4 | m^2/s^4) that the encoder's rounding leaves in the acceleration."""
    total = 0.0
    for p in parts:
        weights = window(p.q, p.capture.dt, 2)
        total += p.rows * float(weights @ weights) * p.capture.encoder_step**2 / 12.0
    return total / sum(p.rows for p in parts)
