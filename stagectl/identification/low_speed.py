"""The method `low-speed`: rolling friction from an ultra-slow motion there and back.

It is the force at negligible speed over the displacement since a reversal::

    force
    + T_c |            ______________        both directions alike (Masing): up is T(s) + offset,
          |       ___--                      down is -T(s) + offset, s the displacement since the reversal
          |    _--
          |  _-        T(s) = sum_j a_j clip(s/d_j - 1, -1, 1)
          | /
    - T_c |/___________________ s            rises, and bends one way only: every bend is a stop operator

The bends are what a table of second differences would be.  Fitted with weights that are not negative, the table is one
that a bundle of stop operators makes, and compensates a partial reversal or a start from rest as it does a full one.

Source: Simultaneous Identification ..., section IV.A.2 and Fig. 6 (50 um, 0.05 Hz, closed loop); `kernels.friction`.
"""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal, check_excited, each
from stagectl.identification.result import Characteristic, IdentificationResult, Note, Parameter, Progress, Topic
from stagectl.number_format import percent
from stagectl.units import unit_on


class Stroke(NamedTuple):
    """From one reversal to the next: block means."""

    direction: float  # +1 or -1
    displacement: Array  # (n,) rad | m since the reversal
    force: Array  # (n,) N m | N, along the direction
    duration: float  # s

    @property
    def length(self) -> float:
        """Displacement (rad | m) at its end."""
        return float(self.displacement[-1])


class OperatorFit(NamedTuple):
    """Stop operators and offset of all strokes."""

    weight: Array  # (j,) N m | N
    slip: Array  # (j,) rad | m
    offset: float  # N m | N
    residual: float  # N m | N, rms of the block means

    @property
    def coulomb(self) -> float:
        """Sum of the weights (N m | N)."""
        return float(np.sum(self.weight))


def identify(
    captures: list[Capture], file: StageFile, progress: Progress = lambda done, total: None
) -> IdentificationResult:
    """Characteristic of the rolling friction from all full strokes of `captures`.

    Raises IdentificationError where there are none in both directions, or they are too fast or too short to show it.
    """
    constant = file.motor.force_constant
    strokes = list(
        itertools.chain.from_iterable(each(captures, lambda capture: full_strokes(capture, constant), progress, 1))
    )
    _check(strokes, captures, file)
    fit = fitted(strokes, max(capture.encoder_step for capture in captures))
    progress(len(captures) + 1, len(captures) + 1)
    notes = _checked_fit(strokes, fit, file)
    table = characteristic(fit)
    parameters = _parameters(strokes, fit, file)
    return IdentificationResult(
        parameters, table, _details(strokes, fit, table), tuple(notes), {"friction": table.block}
    )


def full_strokes(capture: Capture, force_constant: float) -> list[Stroke]:
    """Strokes between two reversals each, the first one only after an approach that was long enough.

    Raises IdentificationError where the capture holds no motion.
    """
    check_excited(capture)
    position, force = _blocks(capture, force_constant)
    turns = _reversals(position)
    strokes: list[Stroke] = []
    before = 0
    for first, last in itertools.pairwise(turns):
        way = position[last] - position[first]
        if abs(position[first] - position[before]) >= thresholds.STROKE_APPROACH * abs(way):
            direction = math.copysign(1.0, way)
            moved = np.maximum(direction * (position[first:last] - position[first]), 0.0)
            kept = moved <= thresholds.STROKE_USED * abs(way)
            duration = (last - first) / len(position) * len(capture.time) * capture.dt
            strokes.append(Stroke(direction, moved[kept], direction * force[first:last][kept], duration))
        before = first
    return strokes


def _blocks(capture: Capture, force_constant: float) -> tuple[Array, Array]:
    """Block means of position and force, short enough for the fastest part of the motion."""
    moved = np.abs(np.diff(capture.position[:: max(1, round(thresholds.STROKE_BLOCK / capture.dt))]))
    fastest = float(np.quantile(moved, 0.99)) if len(moved) else 0.0
    share = float(np.ptp(capture.position)) / thresholds.STROKE_BLOCKS / fastest if fastest > 0.0 else 1.0
    size = max(1, round(min(1.0, share) * thresholds.STROKE_BLOCK / capture.dt))
    rows = len(capture.time) // size * size
    position = capture.position[:rows].reshape(-1, size).mean(axis=1)
    return position, force_constant * capture.current[:rows].reshape(-1, size).mean(axis=1)


def _reversals(position: Array) -> list[int]:
    """Rows of the extremes after which the axis returns by a quarter of its whole range."""
    back = thresholds.STROKE_TURN * float(np.ptp(position))
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


def fitted(strokes: list[Stroke], encoder_step: float) -> OperatorFit:
    """Weights by least squares, none negative, and the offset."""
    shortest = min(stroke.length for stroke in strokes)
    finest = max(thresholds.FINEST_SLIP * encoder_step, shortest / thresholds.STROKE_BLOCKS)
    count = math.ceil(thresholds.SLIPS_PER_DECADE * math.log10(thresholds.WIDEST_SLIP * shortest / finest)) + 1
    slip = np.geomspace(finest, thresholds.WIDEST_SLIP * shortest, count)
    displacement = np.concatenate([stroke.displacement for stroke in strokes])
    direction = np.concatenate([np.full(len(stroke.force), stroke.direction) for stroke in strokes])
    force = np.concatenate([stroke.force for stroke in strokes])
    columns = np.column_stack([np.clip(displacement[:, None] / slip - 1.0, -1.0, 1.0), direction, -direction, force])
    triangle = np.asarray(np.linalg.qr(columns, mode="r"))  # the same problem in as many rows as columns
    values, norm = optimize.nnls(triangle[:, :-1], triangle[:, -1])
    kept = values[:-2] > thresholds.CARRYING * np.sum(values[:-2])
    offset = float(values[-2] - values[-1])
    return OperatorFit(values[:-2][kept], slip[kept], offset, float(norm) / math.sqrt(len(force)))


def characteristic(fit: OperatorFit) -> Characteristic:
    """The operators with their table, a quarter further than the last bend."""
    displacement = np.linspace(0.0, 2.5 * float(fit.slip[-1]), thresholds.TABLE_POINTS)
    return Characteristic.over(displacement, fit.weight, fit.slip)


def _check(strokes: list[Stroke], captures: list[Capture], file: StageFile) -> None:
    directions = {stroke.direction for stroke in strokes}
    if len(directions) < 2:
        raise IdentificationError(
            f"{len(strokes)} full strokes between two reversals, {'all one way' if directions else 'none'}; at least "
            "one each way is needed: record one and a half periods or more of a slow sine, such as 50 um at 0.05 Hz, "
            "in closed loop",
            Refusal.ONE_DIRECTION if directions else Refusal.NO_REVERSAL,
            value=len(strokes),
            admissible="[2, inf)",
        )
    shortest = min(stroke.length for stroke in strokes)
    step, least = max(capture.encoder_step for capture in captures), thresholds.STROKE_STEPS
    unit = unit_on(file.axis.kind, "rad | m")
    if not shortest > least * step:
        raise IdentificationError(
            f"a stroke of {shortest:.4g} {unit}; must be at least {least:g} encoder steps of {step:.4g}, to resolve "
            "the bend after a reversal: record a larger amplitude",
            Refusal.TOO_SHORT,
            value=shortest,
            unit=unit,
            admissible=f"({least * step:g}, inf)",
        )


def _checked_fit(strokes: list[Stroke], fit: OperatorFit, file: StageFile) -> list[Note]:
    """Notes on what is doubtful about these strokes.

    Raises IdentificationError where they do not show the characteristic.
    """
    coulomb = fit.coulomb
    if not coulomb > 0.0:
        text = (
            "the force does not oppose the motion: it is no greater on the way up than on the way down; check the "
            "sign of the current, the force constant, and that the position is measured and not the reference"
        )
        raise IdentificationError(text, Refusal.OPPOSITE_SIGN, value=coulomb, admissible="(0, inf)")
    half_stroke = 0.5 * min(stroke.length for stroke in strokes)
    late = float(np.sum(fit.weight[2.0 * fit.slip > half_stroke]))
    fast = _fast(strokes, file) / coulomb
    _check_share(
        late / coulomb,
        thresholds.LATE_REFUSED,
        "of the friction still rises over the last half of the strokes: record a larger one",
        Refusal.FRICTION_UNSETTLED,
    )
    _check_share(
        fast,
        thresholds.FAST_REFUSED,
        "of the friction is viscous and inertial by the stage file: record a slower motion; or the units are wrong, a "
        "current a thousand times too small (A, mA) or a position a thousand times too large (mm, um)",
        Refusal.TOO_FAST,
    )
    notes = [Note(Topic.FORCE_CONSTANT, "the force constant is taken from the stage file: the table scales with it")]
    if late > thresholds.LATE_DOUBTFUL * coulomb:
        text = (
            f"{percent(late / coulomb)} of the friction still rises over the last half of the strokes; the table "
            "may go on beyond them: record a larger amplitude"
        )
        notes.append(Note(Topic.UNSETTLED, text))
    if fast > thresholds.FAST_DOUBTFUL:
        text = (
            f"by the stage file's inertia and viscous friction up to {percent(fast)} of the force is not rolling "
            "friction: record a slower motion"
        )
        notes.append(Note(Topic.TOO_FAST, text))
    return notes


def _check_share(share: float, limit: float, words: str, reason: Refusal) -> None:
    if share > limit:
        text = f"{100.0 * share:.3g} % (at most {100.0 * limit:g} %) {words}"
        raise IdentificationError(text, reason, value=share, admissible=f"[0, {limit:g}]")


def _fast(strokes: list[Stroke], file: StageFile) -> float:
    """Largest viscous plus inertial force (N m | N) of sines of these strokes and durations."""
    p = file.mechanics
    rates = [(0.5 * stroke.length, math.pi / stroke.duration) for stroke in strokes]
    return max(p.viscous * size * rate + p.inertia * size * rate * rate for size, rate in rates)


def _parameters(strokes: list[Stroke], fit: OperatorFit, file: StageFile) -> dict[str, Parameter]:
    """Coulomb friction and offset; intervals from the scatter of the strokes' ends, in batches.

    The force at negligible speed is not told from what the speed adds to it: the interval holds that, too.
    """
    settled = 2.0 * fit.slip[-1]
    batches = [
        (stroke.direction, float(np.mean(batch)))
        for stroke in strokes
        for batch in np.array_split(stroke.force[stroke.displacement > settled], thresholds.STROKE_BATCHES)
        if len(batch)
    ]
    half = math.nan
    if len(batches) > 2:
        direction, mean = np.array(batches).T
        regressor = np.column_stack([np.ones(len(batches)), direction])
        values, *_ = np.linalg.lstsq(regressor, mean, rcond=None)
        spread = float(np.linalg.norm(mean - regressor @ values)) / math.sqrt(len(batches) - 2)
        quantile = float(stats.t.ppf(thresholds.QUANTILE_95, len(batches) - 2))
        half = quantile * spread / math.sqrt(len(batches))
    found = {"coulomb": (fit.coulomb, math.hypot(half, _fast(strokes, file))), "offset": (fit.offset, half)}
    return {name: Parameter.named(name, file.axis.kind, *values) for name, values in found.items()}


def _details(strokes: list[Stroke], fit: OperatorFit, table: Characteristic) -> dict[str, Any]:
    def thinned(column: NDArray[np.float64]) -> list[float]:
        return [float(x) for x in column[:: max(1, len(column) // thresholds.STROKE_POINTS)]]

    return {
        "residual": fit.residual,
        "stiffness": float(np.sum(fit.weight / fit.slip)),
        # Displacement at 95 % of a full reversal.
        "settled": float(np.interp(0.9 * fit.coulomb, table.force, table.displacement)),
        "strokes": [
            {
                "direction": stroke.direction,
                "displacement": thinned(stroke.displacement),
                "force": thinned(stroke.force),
            }
            for stroke in strokes
        ],
    }
