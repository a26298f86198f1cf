"""Columns of the equation of motion from captured positions: acceleration, velocity, one, ripple, stop operators.

::

    Kt i(t - tau) = J a + D w + b + c sin(theta) + d cos(theta) + sum_j alpha_j S_j(x)

theta is the angle of a rotary axis; on a linear one the pitch of its stage file is a turn.

All columns and the left side pass the same window and are kept once per knot distance.  The state of an element at
the start is not known.  It is forgotten once the axis has moved by twice the element's slip in either direction; the
rows before that are left out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture
from stagectl.identification.simultaneous.windows import (
    HALF,
    Rows,
    acceleration,
    delayed,
    margin,
    only_rounds,
    resolution,
    shortest_knots,
    smoothed,
    window,
)
from stagectl.kernels.effects import TURN
from stagectl.recording.true_rows import stretches
from stagectl.units import ROTARY

ACCELERATION, VELOCITY, ONE = 0, 1, 2
RIPPLE = slice(3, 3 + 2 * thresholds.RIPPLE_ORDERS)  # sine and cosine of one, two, ... periods a turn
BEND = slice(RIPPLE.stop, RIPPLE.stop + 2)  # velocity times its size, and times its square
FREE = BEND.stop  # columns before those of the friction


class Part(NamedTuple):
    """The rows of one capture that the regression uses."""

    capture: Capture
    places: Rows
    wide: int  # samples per knot distance at which rounding does not fill the acceleration
    turn: float = TURN  # rad | m

    @property
    def angle(self) -> Array:
        """Position (n,) as an angle (rad) within a turn."""
        return TURN / self.turn * self.capture.position

    @property
    def q(self) -> int:
        """Samples per knot distance."""
        return self.places.q

    @property
    def rows(self) -> int:
        """Number of rows."""
        return sum(self.places.counts)

    @property
    def uncut(self) -> Part:
        """The same rows with those between their spans."""
        return self._replace(places=self.places._replace(spans=()))


def repeats(file: StageFile) -> bool:
    """Whether the way after which a ripple repeats is known: not on a linear axis that states no pitch."""
    return file.axis.kind == ROTARY or file.mechanics.pitch != TURN


def part(capture: Capture, wide: int, longest: float, delay: float, turn: float = TURN) -> Part:
    """Rows on which elements up to the slip `longest` are known and a delay up to `delay` (s) has its samples."""
    q = max(1, round(thresholds.STEPPED_KNOTS / capture.dt)) if _seen(capture, wide) else wide
    room = margin(q, capture.dt, delay)
    moved = np.maximum.accumulate(capture.position) - np.minimum.accumulate(capture.position)
    known = int(np.searchsorted(moved, 2.0 * longest))
    start = max(room, known + HALF * q)
    whole = Part(capture, Rows(start, max(0, (len(capture.position) - room - start - 1) // q + 1), q), wide, turn)
    return whole._replace(places=whole.places._replace(spans=_moving(whole)))


def _moving(p: Part) -> tuple[tuple[int, int], ...]:
    """Spans of the rows between standstills; empty: all of them.

    While the encoder shows a count, or two by turns, a friction law that follows the measured path stands still, and
    the true friction does not: within a count it may go from one side to the other.  A reversal is as short as the
    rms acceleration makes it; longer, and than the window resolves, the axis stands.
    """
    x, step = p.capture.position, p.capture.encoder_step
    long = max(math.ceil(math.sqrt(8.0) * step_time(p) / p.capture.dt), 2 * p.wide)
    spread = maximum_filter1d(x, long) - minimum_filter1d(x, long)
    still = maximum_filter1d((spread < 1.5 * step).astype(np.int8), long) > 0
    last = _last(still)
    gone = _last(np.abs(x - x[last]) >= thresholds.SLIP_STEPS * step)
    unknown = still | (last > gone)
    known = stretches(~unknown[p.places.samples])
    spans = tuple((first, end) for first, end in known if end - first >= thresholds.WHITENING_ROWS)
    return () if spans == ((0, p.places.number),) else spans


def _last(events: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number (n,) of the last sample with the event, or before the first one -1."""
    return np.asarray(np.maximum.accumulate(np.where(events, np.arange(len(events)), -1)))


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
    return [p._replace(places=p.places.thinned(stride)) for p in parts]


def motion(p: Part) -> Array:
    """Columns (rows, `BEND.start`) of one capture without friction: acceleration, velocity, one, and a ripple's."""
    x, dt = p.capture.position - p.capture.position[0], p.capture.dt
    smooth = window(p.q, dt)
    return np.column_stack(
        [
            smoothed(x, window(p.q, dt, 2), p.places),
            smoothed(x, window(p.q, dt, 1), p.places),
            np.ones(p.rows),
            *(
                smoothed(wave(order * p.angle), smooth, p.places)
                for order in range(1, thresholds.RIPPLE_ORDERS + 1)
                for wave in (np.sin, np.cos)
            ),
        ]
    )


def ripple_shares(parts: list[Part]) -> Array:
    """Scale of each ripple column, relative to that of once per turn: (RIPPLE,).

    An order of which the motion sees less than `RIPPLE_PERIODS` periods would take up anything that changes with the
    position, the inertia of a sine's turning points above all; it is left out.
    """
    turns = max(float(np.ptp(p.angle)) for p in parts) / TURN
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
    """Whether rounding takes a window so `wide`; where few samples hide it, the sampling is too slow to follow it.

    Noise beyond rounding has a spectrum of its own, and no filter of rounding whitens it: time stamps that jitter are
    a noise that grows with the speed.
    """
    enough = max(thresholds.STEPPED_WIDE * shortest_knots(capture), thresholds.LEAST_KNOT_ROWS)
    return wide >= enough and only_rounds(capture)


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
