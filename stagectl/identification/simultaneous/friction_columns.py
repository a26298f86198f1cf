"""Friction along a measured path as columns that are linear in what is not known: one prior for many laws.

::

    stop operators     S_j(x)                    Maxwell slip; a dense set also has the curve of any other full reversal
    bristles           z_l(x), Dahl's exponent 1 and 2
    Stribeck           S_j(x) exp(-|v| / v_k)    friction that depends on the speed; signed sums give any fall with it
    lag                d/dt of bristles and of the Stribeck columns, and first-order lags of these: damping of a
                       bristle; friction that follows its Stribeck curve after a while (frictional memory)

Source of the lags: B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30(7), 1994, section 2.

A Maxwell slip, Dahl, LuGre, elasto-plastic or GMS axis is a sum of these up to an error of form of some thousandths of
its friction (`thresholds.FORM_ERROR`).  The scale of each group is not known; `evidence` averages over it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous.regressors import ACCELERATION, VELOCITY, Part, coarse, track
from stagectl.identification.simultaneous.windows import HALF, Rows, resolution, smoothed, window
from stagectl.kernels import friction_bristle, friction_path, presliding
from stagectl.kernels.jit import kernel


class Shapes(NamedTuple):
    """Lengths and speeds of the columns, the same for all captures."""

    slip: Array  # (j,) rad | m, of the stop operators
    length: Array  # (l,) rad | m, of the bristles
    speed: Array  # (k,) rad/s | m/s, of the Stribeck columns
    fastest: float  # rad/s | m/s, of the motion

    @property
    def graded(self) -> Array:
        """Slips of the operators that have Stribeck columns."""
        return self.slip[list(thresholds.STRIBECK_OPERATORS)]

    @property
    def remembered(self) -> Array:
        """Speeds of the Stribeck columns that friction follows after a while."""
        return self.speed[1::2]

    @property
    def groups(self) -> dict[str, slice]:
        """Places of each group in the columns."""
        lengths, speeds = len(self.length), len(self.graded) * len(self.speed)
        sizes = {
            "operators": len(self.slip),
            "bristles": 2 * lengths,
            "stribeck": speeds,
            "lag": lengths + len(self.speed) + 2 * len(self.remembered) * len(thresholds.MEMORIES),
        }
        ends = np.cumsum([0, *sizes.values()]).tolist()
        return {name: slice(first, last) for name, first, last in zip(sizes, ends, ends[1:], strict=False)}


def shapes(parts: list[Part], motion: Array) -> Shapes:
    """Slips from what sampling and encoder resolve to a share of the stroke, and speeds up to beyond the fastest.

    Where the measured path is coarse, the friction may still be stiffer than is seen: shorter slips are tried, too.

    `motion` (rows, 2 or more) has acceleration and velocity of all `parts`.
    """
    rms = float(np.sqrt(np.mean(motion[:, ACCELERATION] ** 2)))
    seen = min(_resolved(p, rms, thresholds.SLIP_STEPS, thresholds.SLIP_TIME) for p in parts)
    low = min(_resolved(p, rms, *thresholds.FOLLOWED) if coarse(p) else seen for p in parts)
    stroke = max(float(np.ptp(p.capture.position)) for p in parts)
    high = min(max(thresholds.SLIP_STROKE * stroke, 4.0 * seen), thresholds.SLIP_SPAN * seen)
    fastest = float(np.abs(motion[:, VELOCITY]).max())
    return Shapes(
        np.geomspace(low, high, thresholds.SLIPS),
        np.geomspace(low, 0.5 * high, thresholds.BRISTLES),
        fastest * np.geomspace(*thresholds.STRIBECK_SPEEDS, thresholds.STRIBECK_COLUMNS),
        fastest,
    )


def _resolved(p: Part, rms: float, steps: float, share: float) -> float:
    """Displacement (rad | m) of so many encoder steps, or of a `share` of `rms` (acceleration) times knots squared."""
    return max(steps * resolution(p.capture), share * rms * (p.q * p.capture.dt) ** 2)


class Path(NamedTuple):
    """A capture's motion at a rate that resolves its reversals."""

    position: Array  # (n,) rad | m
    velocity: Array  # (n,)
    dt: float  # s
    rows: Rows

    def head(self, rows: int) -> Path:
        """Its first `rows`."""
        places = self.rows.head(rows)
        end = places.start + (places.number - 1) * places.step + HALF * places.q + 1
        return self._replace(position=self.position[:end], velocity=self.velocity[:end], rows=places)

    def smoothed(self, states: Array, order: int = 0) -> Array:
        """`states` (..., n) filtered as all signals are, or their derivative of this `order`: (..., rows)."""
        return smoothed(states, window(self.rows.q, self.dt, order), self.rows)


def _finer(p: Part) -> int:
    """Samples of a path per sample of the capture."""
    return max(1, math.ceil(p.capture.dt / thresholds.PATH_STEP - 1e-9))


def path_rows(p: Part) -> Rows:
    """The rows of a part in samples of its path."""
    return p.places._replace(start=p.places.start * _finer(p), q=p.places.q * _finer(p))


def path(p: Part, velocity: Array) -> Path:
    """The motion of one part.

    Its speed is that of the track: a window that hides the encoder's steps in an acceleration makes a reversal so long
    that friction which falls with speed is lost (0.12 instead of 0.05 of it, 2 kHz, 20,000 counts).  Where the rows are
    far apart, the speed between them is that of `velocity` (rows,), the windowed one.
    """
    x = track(p)
    finer, rows = _finer(p), path_rows(p)
    dt = p.capture.dt / finer
    if finer > 1:
        x = np.asarray(CubicSpline(np.arange(len(x)), x)(np.arange((len(x) - 1) * finer + 1) / finer))
    speed = np.interp(np.arange(len(x)), rows.samples, velocity) if finer > 1 else np.gradient(x, dt)
    return Path(np.ascontiguousarray(x), np.asarray(speed, dtype=np.float64), dt, rows)


def followed(p: Part, along: Path, acceleration: Array) -> Path:
    """The path (n,) of a model's `acceleration` (n,) that follows the measured positions below the window's cut-off.

    Between rows, and within an encoder step, the model knows the motion better than the encoder does.  A model that
    strays from the rows by more than the path bends between them, as one of next to no inertia, is not followed.
    """
    step, measured = round(p.capture.dt / along.dt), p.capture.position - p.capture.position[0]
    model = np.cumsum(np.cumsum(acceleration)) * along.dt**2
    left = measured - model[::step]
    weights = window(p.wide, p.capture.dt)
    half = len(weights) // 2
    slow = np.convolve(np.pad(left, half, mode="reflect", reflect_type="odd"), weights, "valid")
    position = model + (CubicSpline(np.arange(len(slow)), slow)(np.arange(len(model)) / step) if step > 1 else slow)
    bend = float(np.std(np.diff(measured, 2))) / 8.0
    if float(np.std(position[::step] - measured)) > max(resolution(p.capture), bend):
        return along
    return along._replace(position=position, velocity=np.asarray(np.gradient(position, along.dt)))


def columns(p: Path, s: Shapes) -> Array:
    """Friction columns (rows, m) along one path, in the order of the groups."""
    return np.column_stack(list(_columns(p, s)))


def _columns(p: Path, s: Shapes) -> Iterator[Array]:
    for slip in s.slip:
        yield p.smoothed(operator(p.position, slip))
    bent = [_bristle(p.position, length, 1.0) for length in s.length]
    for state in (*bent, *(_bristle(p.position, length, 2.0) for length in s.length)):
        yield p.smoothed(state)
    for slip in s.graded:
        state = operator(p.position, slip)
        for speed in s.speed:
            yield p.smoothed(state * np.exp(-np.abs(p.velocity) / speed))
    for state in bent:
        yield _unit(p.smoothed(state, 1))
    state = operator(p.position, float(s.graded[0]))
    for speed in s.speed:
        yield _unit(p.smoothed(state * np.exp(-np.abs(p.velocity) / speed), 1))
    for speed, memory in itertools.product(s.remembered.tolist(), thresholds.MEMORIES):
        late = np.zeros((2, len(state)))
        _remembered(state * np.exp(-np.abs(p.velocity) / speed), math.exp(-p.dt / memory), late)
        yield from p.smoothed(late)


@kernel
def _remembered(x: Any, kept: float, out: Any) -> None:
    """Fill `out` (2, n): what first-order lags of friction `x` (n,) add to it, of all of it and of its fall alone.

    `kept` is what is left of a step after a sample.  Elements that stick again at once follow a rise at once.
    """
    late = falling = x[0]
    for k in range(1, len(x)):
        late = x[k] + kept * (late - x[k])
        falls = x[k] * falling > 0.0 and abs(x[k]) < abs(falling)
        falling = x[k] + kept * (falling - x[k]) if falls else x[k]
        out[0, k], out[1, k] = late - x[k], falling - x[k]


def _unit(column: Array) -> Array:
    """The column with an rms of 1: a rate has no size of its own."""
    size = float(np.sqrt(np.mean(column * column)))
    return column / size if size > 0.0 else column


def operator(x: Array, slip: float) -> Array:
    """State (n,) of one stop operator along `x` (n,), from rest."""
    states = np.empty(len(x))
    presliding.strain(1.0 / slip, np.concatenate([x[:1], x[:1], x, x[-1:]]), states)
    return states


def _bristle(x: Array, length: float, exponent: float) -> Array:
    """State (n,) of one bristle of Dahl's law along `x` (n,), from rest."""
    columns = np.empty((len(x), 2))
    friction_path.bristle(friction_bristle.Bristle(1.0, 1.0 / length, exponent), x, 1.0, columns)
    return columns[:, 0]
