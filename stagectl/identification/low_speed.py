"""Rolling friction from an ultra-slow motion to and fro: the force at negligible speed over the way since a reversal.

::

    force
    + T_c |            ______________        both directions alike (Masing): up is T(s) + offset,
          |       ___--                      down is -T(s) + offset, s the displacement since the reversal
          |    _--
          |  _-        T(s) = sum_j a_j clip(s/d_j - 1, -1, 1)
          | /
    - T_c |/___________________ s            rises, and bends one way only: every bend is a stop operator

The bends are what a table of second differences would be; fitted with weights that are not negative, the table is one
that a bundle of stop operators makes, and compensates a partial reversal or a start from rest as it does a full one.

Source: Simultaneous Identification ..., section IV.A.2 and Fig. 6 (50 um, 0.05 Hz, closed loop); `kernels.friction`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.response.sampling import check
from stagectl.identification.result import Characteristic, Found, Parameter
from stagectl.units import ROTARY

BLOCK = 0.01  # s, over which position and force are averaged, at most
FINE = 1000.0  # blocks of a stroke, at least
TURN = 0.25  # of the whole range: way back that makes a reversal
APPROACH = 0.45  # of a stroke: way before its first reversal that has brought the friction into its direction
ALMOST = 0.95  # of a stroke that is used: so slow as the axis is at its end, noise shakes the friction loose
LEAST_STEPS = 100.0  # encoder steps of a stroke
FINEST = 8.0  # encoder steps: slip of the stiffest element
WIDEST = 0.4  # of a stroke: slip of the softest element; its bend is at twice that
PER_DECADE = 10
UNSETTLED, OPEN = 0.05, 0.3  # of the force still rising over the last half of the stroke: doubtful, refused
QUICK, TOO_QUICK = 0.01, 0.2  # of the force: viscous and inertial part, doubtful, refused
BATCHES = 5  # of a stroke's end, for the intervals
ROWS = 256  # of the table
_TOO_QUICK = (
    "record a slower motion; or the units are wrong, a current a thousand times too small (A, mA) or a position a "
    "thousand times too large (mm, um)"
)


class Stroke(NamedTuple):
    """From one reversal to the next: block means."""

    direction: float  # +1 or -1
    displacement: Array  # (n,) rad | m since the reversal
    force: Array  # (n,) N m | N, along the direction
    duration: float  # s


class Fit(NamedTuple):
    """Stop operators and offset of all strokes."""

    weight: Array  # (j,) N m | N
    slip: Array  # (j,) rad | m
    offset: float  # N m | N
    residual: float  # N m | N, rms of the block means


def identify(
    captures: list[Capture], file: StageFile, progress: Callable[[int, int], None] = lambda done, total: None
) -> Found:
    """Characteristic of the rolling friction from all full strokes of `captures`.

    Raises IdentificationError where there are none both ways, or they are too fast or too short to show it.
    """
    strokes: list[Stroke] = []
    for k, capture in enumerate(captures):
        check(capture)
        strokes += full_strokes(capture, file.motor.force_constant)
        progress(k + 1, len(captures) + 1)
    _check(strokes, captures, file)
    fit = fitted(strokes, max(one.encoder_step for one in captures))
    progress(len(captures) + 1, len(captures) + 1)
    notes = _judged(strokes, fit, file)
    table = characteristic(fit)
    parameters = _parameters(strokes, fit, file)
    changes = {"friction": {"law": "stop-operators", "weight": fit.weight.tolist(), "slip": fit.slip.tolist()}}
    return Found(parameters, table, _details(strokes, fit, table), tuple(notes), changes)


def full_strokes(capture: Capture, force_constant: float) -> list[Stroke]:
    """Strokes between two reversals each, the first one only after an approach that was long enough."""
    position, force = _blocks(capture, force_constant)
    turns = _reversals(position)
    strokes: list[Stroke] = []
    before = 0
    for first, last in itertools.pairwise(turns):
        way = position[last] - position[first]
        if abs(position[first] - position[before]) >= APPROACH * abs(way):
            direction = math.copysign(1.0, way)
            moved = np.maximum(direction * (position[first:last] - position[first]), 0.0)
            kept = moved <= ALMOST * abs(way)
            duration = (last - first) / len(position) * len(capture.time) * capture.dt
            strokes.append(Stroke(direction, moved[kept], direction * force[first:last][kept], duration))
        before = first
    return strokes


def _blocks(capture: Capture, force_constant: float) -> tuple[Array, Array]:
    """Block means of position and force, short enough for the fastest part of the motion."""
    moved = np.abs(np.diff(capture.position[:: max(1, round(BLOCK / capture.dt))]))
    fastest = float(np.quantile(moved, 0.99)) if len(moved) else 0.0
    share = float(np.ptp(capture.position)) / FINE / fastest if fastest > 0.0 else 1.0
    size = max(1, round(min(1.0, share) * BLOCK / capture.dt))
    rows = len(capture.time) // size * size
    position = capture.position[:rows].reshape(-1, size).mean(axis=1)
    return position, force_constant * capture.current[:rows].reshape(-1, size).mean(axis=1)


def _reversals(position: Array) -> list[int]:
    """Rows of the extremes after which the axis goes back by a quarter of its whole range."""
    back = TURN * float(np.ptp(position))
    turns: list[int] = []
    low = high = 0
    direction = 0
    for k, x in enumerate(position.tolist()):
        if x > position[high]:
            high = k
        if x < position[low]:
            low = k
        if direction >= 0 and position[high] - x > back:
            turns, direction, low = turns + [high] * (direction > 0 or high > 0), -1, k
        elif direction <= 0 and x - position[low] > back:
            turns, direction, high = turns + [low] * (direction < 0 or low > 0), 1, k
    return turns


def fitted(strokes: list[Stroke], encoder_step: float) -> Fit:
    """Weights by least squares, none negative, and the offset."""
    shortest = min(float(one.displacement[-1]) for one in strokes)
    finest = max(FINEST * encoder_step, shortest / FINE)
    count = math.ceil(PER_DECADE * math.log10(WIDEST * shortest / finest)) + 1
    slip = np.geomspace(finest, WIDEST * shortest, count)
    displacement = np.concatenate([one.displacement for one in strokes])
    direction = np.concatenate([np.full(len(one.force), one.direction) for one in strokes])
    force = np.concatenate([one.force for one in strokes])
    columns = np.column_stack([np.clip(displacement[:, None] / slip - 1.0, -1.0, 1.0), direction, -direction, force])
    triangle = np.asarray(np.linalg.qr(columns, mode="r"))  # the same problem in as many rows as columns
    values, norm = optimize.nnls(triangle[:, :-1], triangle[:, -1])
    kept = values[:-2] > 1e-6 * np.sum(values[:-2])
    offset = float(values[-2] - values[-1])
    return Fit(values[:-2][kept], slip[kept], offset, float(norm) / math.sqrt(len(force)))


def table_force(fit: Fit, displacement: Array) -> Array:
    """``T(s)`` (n,) of the operators at displacements (n,) since a reversal."""
    return np.asarray(np.clip(displacement[:, None] / fit.slip - 1.0, -1.0, 1.0) @ fit.weight, dtype=np.float64)


def characteristic(fit: Fit) -> Characteristic:
    """The operators with their table, a quarter further than the last bend."""
    displacement = np.linspace(0.0, 2.5 * float(fit.slip[-1]), ROWS)
    return Characteristic(displacement, table_force(fit, displacement), fit.weight, fit.slip)


def _check(strokes: list[Stroke], captures: list[Capture], file: StageFile) -> None:
    ways = {one.direction for one in strokes}
    if len(ways) < 2:
        raise IdentificationError(
            f"{len(strokes)} full strokes between two reversals, {'all one way' if ways else 'none'}; at least one "
            "each way is needed: record one and a half periods or more of a slow sine, such as 50 um at 0.05 Hz, in "
            "closed loop"
        )
    shortest = min(float(one.displacement[-1]) for one in strokes)
    step = max(one.encoder_step for one in captures)
    unit = "rad" if file.axis.kind == ROTARY else "m"
    if not shortest > LEAST_STEPS * step:
        raise IdentificationError(
            f"a stroke of {shortest:.4g} {unit}; must be at least {LEAST_STEPS:g} encoder steps of {step:.4g}, so "
            "that the bend after a reversal can be seen: record a larger amplitude"
        )


def _judged(strokes: list[Stroke], fit: Fit, file: StageFile) -> list[str]:
    """What is doubtful about these strokes.

    Raises IdentificationError where they do not show the characteristic.
    """
    coulomb = float(np.sum(fit.weight))
    if not coulomb > 0.0:
        raise IdentificationError(
            "the force does not oppose the motion: it is no greater on the way up than on the way down; check the "
            "sign of the current, the force constant, and that the position is measured and not the reference"
        )
    late = float(np.sum(fit.weight[2.0 * fit.slip > 0.5 * min(float(one.displacement[-1]) for one in strokes)]))
    quick = _quick(strokes, file) / coulomb
    for share, limit, words in (
        (late / coulomb, OPEN, "of the friction still rises over the last half of the strokes: record a larger one"),
        (quick, TOO_QUICK, f"of the friction is viscous and inertial by the stage file: {_TOO_QUICK}"),
    ):
        if share > limit:
            raise IdentificationError(f"{100.0 * share:.3g} % (at most {100.0 * limit:g} %) {words}")
    notes = ["the force constant is taken from the stage file: the table scales with it"]
    if late > UNSETTLED * coulomb:
        notes.append(
            f"{100.0 * late / coulomb:.2g} % of the friction still rises over the last half of the strokes; the table "
            "may go on beyond them: record a larger amplitude"
        )
    if quick > QUICK:
        notes.append(
            f"by the stage file's inertia and viscous friction up to {100.0 * quick:.2g} % of the force is not rolling "
            "friction: record a slower motion"
        )
    return notes


def _quick(strokes: list[Stroke], file: StageFile) -> float:
    """Largest viscous plus inertial force (N m | N) of sines of these strokes and durations."""
    p = file.mechanics
    rates = [(0.5 * float(one.displacement[-1]), math.pi / one.duration) for one in strokes]
    return max(p.viscous * size * rate + p.inertia * size * rate * rate for size, rate in rates)


def _parameters(strokes: list[Stroke], fit: Fit, file: StageFile) -> dict[str, Parameter]:
    """Coulomb friction and offset; intervals from how the ends of the strokes scatter, in batches."""
    ends = [np.array_split(one.force[one.displacement > 2.0 * fit.slip[-1]], BATCHES) for one in strokes]
    pairs = zip(strokes, ends, strict=True)
    rows = [(one.direction, float(np.mean(batch))) for one, parts in pairs for batch in parts if len(batch)]
    half = math.nan
    if len(rows) > 2:
        direction, mean = np.array(rows).T
        regressor = np.column_stack([np.ones(len(rows)), direction])
        values, *_ = np.linalg.lstsq(regressor, mean, rcond=None)
        spread = float(np.linalg.norm(mean - regressor @ values)) / math.sqrt(len(rows) - 2)
        half = float(stats.t.ppf(0.975, len(rows) - 2)) * spread / math.sqrt(len(rows))
    unit = "N m" if file.axis.kind == ROTARY else "N"
    coulomb = float(np.sum(fit.weight))
    return {
        "coulomb": Parameter(coulomb, coulomb - half, coulomb + half, unit),
        "offset": Parameter(fit.offset, fit.offset - half, fit.offset + half, unit),
    }


def _details(strokes: list[Stroke], fit: Fit, table: Characteristic) -> dict[str, Any]:
    def thinned(column: NDArray[np.float64]) -> list[float]:
        return [float(x) for x in column[:: max(1, len(column) // 500)]]

    coulomb = float(np.sum(fit.weight))
    return {
        "residual": fit.residual,
        "stiffness": float(np.sum(fit.weight / fit.slip)),
        "settled": float(np.interp(0.9 * coulomb, table.force, table.displacement)),  # 95 % of a full reversal
        "strokes": [
            {"direction": one.direction, "displacement": thinned(one.displacement), "force": thinned(one.force)}
            for one in strokes
        ],
    }
