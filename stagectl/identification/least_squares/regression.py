"""Moving mass, friction and offset of an axis from records of its position and force, by least squares.

::

    F = M a + Fv v + Fc sgn(v) + offset                                                    every axis
      + gs sin(q) + gc cos(q)                                                              `gravity`: a joint that lifts
    F = M a + Fv+ v (v > 0) + Fv- v (v < 0) + Fc+ (v > 0) - Fc- (v < 0)                    `directions`

All columns pass one filter (`filtering`), sgn(v) too.  Rows at standstill are left out: there, friction is whatever
holds the axis.  Several records are one regression, so that what one does not excite another may: each counts by the
size of its residual.  The intervals allow for a residual that is neither white nor of one size (`standard_errors`).

Whether the residual is concentrated after reversals is checked: there, friction builds up over a distance, which
sgn(v) cannot describe.

Source: M. Gautier, P. Poignet, Extended Kalman filtering and weighted least squares dynamic identification of
robot, Control Engineering Practice 9(12), 2001; A. Janot, M. Gautier, M. Brunot, Data Set and Reference
Models of EMPS, Workshop on Nonlinear System Identification Benchmarks, 2019; Simultaneous Identification of Linear
Parameters and Nonlinear Rolling Friction for Ball Screw Driven Stage, section II (friction after a reversal).
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.identification import standard_errors, thresholds
from stagectl.identification.capture import Array, IdentificationError, Refusal
from stagectl.identification.filtering import (
    FilterDesign,
    FilteredMotion,
    decimated,
    design_filter,
    filtered_motion,
    slope,
)
from stagectl.identification.least_squares.same_instant import not_same_instant
from stagectl.identification.result import Note, Topic
from stagectl.number_format import duration
from stagectl.recording.true_rows import stretches


class Estimate(NamedTuple):
    """A parameter and how well the record determines it."""

    value: float
    deviation: float  # standard deviation, for the residual as it is


class RegressionModel(NamedTuple):
    """Which columns the regression has beyond the usual four."""

    gravity: bool = False
    directions: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Reported parameters, the usual four first."""
        both = ("viscous_forward", "viscous_backward", "coulomb_forward", "coulomb_backward")
        return (
            *("inertia", "viscous", "coulomb", "offset"),
            *(both if self.directions else ()),
            *(("gravity_sine", "gravity_cosine") if self.gravity else ()),
        )

    def columns(self, motion: FilteredMotion) -> Array:
        """Columns (n, k) of the regression."""
        v, sign = motion.velocity, np.sign(motion.velocity)
        if self.directions:
            forward = v > 0.0
            friction = [v * forward, v * ~forward, forward.astype(float), -(v < 0.0).astype(float)]
        else:
            friction = [v, sign, np.ones(len(v))]
        gravity = [np.sin(motion.position), np.cos(motion.position)] if self.gravity else []
        return np.column_stack([motion.acceleration, *friction, *gravity])

    def reported(self) -> Array:
        """Matrix from the regression's parameters to those of `names`; of directions, mean and half difference."""
        if not self.directions:
            return np.eye(6 if self.gravity else 4)
        rows = [[1, 0, 0, 0, 0], [0, 0.5, 0.5, 0, 0], [0, 0, 0, 0.5, 0.5], [0, 0, 0, 0.5, -0.5], *np.eye(5)[1:]]
        matrix = np.zeros((8 + 2 * self.gravity, 5 + 2 * self.gravity))
        matrix[:8, :5] = rows
        matrix[8:, 5:] = np.eye(2 * self.gravity)
        return matrix


class RegressionResult(NamedTuple):
    """Parameters in the units of force (N | N m) over those of position (m | rad)."""

    estimates: dict[str, Estimate]  # by the model's names; an offset above 0: standing still needs a positive force
    residual_percent: float  # norm of the force residual over norm of the force, both filtered and decimated
    condition: float  # of the regressor with columns of unit length, so that it has no units
    correlation: Array  # of all parameters; of the usual four where the others are their parts, by direction
    residual: Array  # (m,) N m | N
    notes: tuple[str, ...] = ()


class FilteredRecord(NamedTuple):
    """One record as rows of the regression."""

    regressor: Array  # (m, k)
    force: Array  # (m,) N m | N
    slopes: Array  # (m, k) of the regressor's columns, 1/s of their units
    share: Array  # (m,) of the way since the last reversal, see `travelled`
    velocity: Array  # (n,) of all rows
    notes: list[str]


def filtered(position: Array, force: Array, dt: float, model: RegressionModel, cutoff: float = 1.0) -> FilteredRecord:
    """The rows of one record, with this share `cutoff` of that which suits its encoder.

    Raises IdentificationError where it is too short for the filter.
    """
    design = design_filter(position, dt, cutoff)
    motion = filtered_motion(position, design)
    terms = model.columns(motion)
    columns = decimated(np.column_stack([terms, slope(terms, dt), force]), design)
    rows = slice(design.edge, len(position) - design.edge, design.decimate)
    moving = ~_standing(motion.velocity, design)[rows][: len(columns)]
    share = travelled(motion.position, motion.velocity)[rows][: len(columns)]
    notes = _treatment(design, 1.0 - float(np.mean(moving)))
    regressor, slopes = np.hsplit(columns[moving, :-1], 2)
    return FilteredRecord(regressor, columns[moving, -1], slopes, share[moving], motion.velocity, notes)


def solved(records: Sequence[FilteredRecord], model: RegressionModel) -> RegressionResult:
    """The parameters of all `records` together.

    Raises IdentificationError where the motions do not separate them.
    """
    check_directions(np.concatenate([record.velocity for record in records]))
    regressor = np.vstack([record.regressor for record in records])
    force = np.concatenate([record.force for record in records])
    ends = np.cumsum([len(record.force) for record in records])[:-1]
    weight = _weight(regressor, force, ends) if len(records) > 1 else np.ones(len(force))
    result = _solved(model, regressor, force, weight, ends)
    share = np.concatenate([record.share for record in records])
    doubt = after_reversals(result.residual, share, result.estimates["coulomb"].value)
    if not doubt:  # friction that builds up looks late, too
        slopes = np.vstack([record.slopes for record in records])
        doubt = not_same_instant(weight[:, None] * regressor, weight[:, None] * slopes, weight * force, ends)
    notes = dict.fromkeys(note for record in records for note in record.notes)  # each once
    return result._replace(notes=(*notes, doubt) if doubt else tuple(notes))


def _weight(regressor: Array, force: Array, ends: NDArray[np.int64]) -> Array:
    """Weight (m,) of each row: one over the rms of its record's residual, that of the best record being 1."""
    size = np.linalg.norm(regressor, axis=0) + 1e-300
    solution, *_ = np.linalg.lstsq(regressor / size, force, rcond=None)
    parts = np.split(force - regressor / size @ solution, ends)
    rms = np.concatenate([np.full(len(part), np.sqrt(np.mean(part * part)) + 1e-300) for part in parts])
    return np.asarray(rms.min() / rms, dtype=np.float64)


def _standing(velocity: Array, design: FilterDesign) -> NDArray[np.bool_]:
    """Rows (n,) in spans of standstill that are long against the filter."""
    slow = np.abs(velocity) < thresholds.STANDING_SPEED * float(np.abs(velocity).max())
    standing: NDArray[np.bool_] = np.zeros(len(velocity), dtype=np.bool_)
    for first, last in stretches(slow):
        if last - first >= thresholds.STANDING_PERIODS / (design.cutoff * design.dt):
            standing[first:last] = True
    return standing


def travelled(position: Array, velocity: Array) -> Array:
    """Share (n,) of the way to the next reversal that is behind each row; NaN before the first and after the last."""
    edges = np.flatnonzero(np.diff(np.sign(velocity))) + 1
    share = np.full(len(position), math.nan)
    ways = [(first, last, float(abs(position[last] - position[first]))) for first, last in itertools.pairwise(edges)]
    longest = max((way for *_, way in ways), default=0.0)
    for first, last, way in ways:
        if way > thresholds.STROKE_LEAST_SHARE * longest:
            share[first:last] = np.abs(position[first:last] - position[first]) / way
    return share


def after_reversals(residual: Array, share: Array, coulomb: float) -> str:
    """A note where the force `residual` (m,) N | N m is concentrated after reversals; empty where it is not.

    `share` (m,) is that of the way since the last reversal (`travelled`), `coulomb` the Coulomb friction (N | N m).
    """
    early = residual[share < thresholds.AFTER_REVERSAL]
    late = residual[share >= thresholds.AFTER_REVERSAL]
    if min(len(early), len(late)) < thresholds.AFTER_REVERSAL_ROWS:
        return ""
    there, elsewhere = math.sqrt(float(np.mean(early * early))), math.sqrt(float(np.mean(late * late)))
    if there <= max(thresholds.CONCENTRATED * elsewhere, thresholds.VISIBLE_RESIDUAL * abs(coulomb)):
        return ""
    times = f"{there / max(elsewhere, 1e-12 * there):.2g} times"
    return Note(
        Topic.AFTER_REVERSALS,
        f"in the first tenth of the way after each reversal the residual's rms is {times} that of the rest: friction "
        "builds up over a distance there, which sgn(v) cannot describe. Inertia, viscous and Coulomb friction are "
        "biased by more than their intervals show: identify with `simultaneous` instead, which needs a record sampled "
        f"every {duration(thresholds.FAST_SAMPLING)} or faster",
    )


def _treatment(design: FilterDesign, standing: float) -> list[str]:
    """Notes on the filter, and on the share of the rows that stand still."""
    notes: list[str] = [
        Note(
            Topic.METHOD,
            f"low-pass at {design.cutoff:.4g} Hz, one row of {design.decimate} kept; "
            "the intervals take the residual as correlated, not as white noise",
        )
    ]
    if standing > 0.0:
        text = (
            f"{100.0 * standing:.3g} % of the rows stand still and are left out: there, friction is what holds the axis"
        )
        notes.append(Note(Topic.STANDSTILL, text))
    return notes


def _solved(
    model: RegressionModel, regressor: Array, force: Array, weight: Array, ends: NDArray[np.int64]
) -> RegressionResult:
    """Solve for rows (m,) with columns of unit length: neither rounding nor the condition depends on the units.

    `ends` are the rows at which one record ends and the next begins.
    """
    length = np.linalg.norm(regressor, axis=0)
    condition = float(np.linalg.cond(regressor / length)) if np.all(length > 0.0) else math.inf
    if not condition <= thresholds.WORST_CONDITION:
        raise IdentificationError(
            f"condition of the regressor = {condition:.3g}; must lie in [1, {thresholds.WORST_CONDITION:g}]: the "
            "motion does not separate the parameters; record accelerations and several speeds in both directions",
            Refusal.ILL_CONDITIONED,
            value=condition,
            admissible=f"[1, {thresholds.WORST_CONDITION:g}]",
        )
    values, covariance, residual = standard_errors.solved(weight[:, None] * regressor, weight * force, ends)
    matrix = model.reported()
    reported = matrix @ covariance @ matrix.T
    deviation = np.sqrt(np.diag(reported))
    correlated = 4 if model.directions else len(deviation)
    estimates = map(Estimate, (matrix @ values).tolist(), deviation.tolist())
    return RegressionResult(
        dict(zip(model.names, estimates, strict=True)),
        100.0 * float(np.linalg.norm(residual / weight) / np.linalg.norm(force)),
        condition,
        reported[:correlated, :correlated] / np.outer(deviation[:correlated], deviation[:correlated]),
        force - regressor @ values,
    )


def check_directions(velocity: Array) -> None:
    """Check that `velocity` (n,) of all captures has both directions: else Coulomb friction and offset are one number.

    Raises IdentificationError where it has not.
    """
    slow = thresholds.DIRECTION_SPEED * float(np.abs(velocity).max())
    share = min(float(np.mean(velocity > slow)), float(np.mean(velocity < -slow)))
    if share < thresholds.BOTH_DIRECTIONS:
        raise IdentificationError(
            f"share of the samples in the rarer direction = {share:.3g}; must lie in "
            f"[{thresholds.BOTH_DIRECTIONS}, 0.5]: Coulomb friction and offset can only be separated in a motion "
            "there and back; record one, or give captures of both directions together",
            Refusal.ONE_DIRECTION,
            value=share,
            admissible=f"[{thresholds.BOTH_DIRECTIONS}, 0.5]",
        )
