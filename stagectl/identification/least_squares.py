"""Moving mass, friction and offset of an axis from one record of its position and force, by least squares.

::

    F = M a + Fv v + Fc sgn(v) + offset                                                    every axis
      + gs sin(q) + gc cos(q)                                                              `gravity`: a joint that lifts
    F = M a + Fv+ v (v > 0) + Fv- v (v < 0) + Fc+ (v > 0) - Fc- (v < 0)                    `directions`

One recipe for every column, see `recipe`: sgn(v) is filtered as all others are.  Where the axis stands, friction is
whatever holds it; those rows are left out.  The intervals take the residual as it is, neither white nor of one size
(`standard_errors`).

Source: M. Gautier, P. Poignet, Extended Kalman filtering and weighted least squares dynamic identification of
robot, Control Engineering Practice 9(12), 2001; A. Janot, M. Gautier, M. Brunot, Data Set and Reference
Models of EMPS, Workshop on Nonlinear System Identification Benchmarks, 2019.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.identification import after_reversals, standard_errors
from stagectl.identification.capture import Array, IdentificationError
from stagectl.identification.filtering import Motion, Recipe, moved, recipe, thinned
from stagectl.identification.sampling import parts

BOTH_WAYS = 0.05  # least share of the samples that move in the rarer direction
SLOW = 0.01  # of the largest speed: slower has no direction
STANDING = 0.003  # of the largest speed: slower, for long, is standing
DWELL = 10.0  # periods of the cut-off frequency that standing must last
WORST_CONDITION = 1e4  # of the regressor with columns of unit length
ALWAYS = ("inertia", "viscous", "coulomb", "offset")


class Estimate(NamedTuple):
    """A parameter and how well the record knows it."""

    value: float
    deviation: float  # standard deviation, from the residual as it is
    white: float  # the same, had the residual been white


class Model(NamedTuple):
    """Which columns there are beside the usual four."""

    gravity: bool = False
    directions: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """What is reported, the usual four first."""
        both = ("viscous_forward", "viscous_backward", "coulomb_forward", "coulomb_backward")
        return (
            *ALWAYS,
            *(both if self.directions else ()),
            *(("gravity_sine", "gravity_cosine") if self.gravity else ()),
        )

    def columns(self, motion: Motion) -> Array:
        """Columns (n, k) of the regression."""
        v, sign = motion.velocity, np.sign(motion.velocity)
        if self.directions:
            forward = v > 0.0
            found = [v * forward, v * ~forward, forward.astype(float), -(v < 0.0).astype(float)]
        else:
            found = [v, sign, np.ones(len(v))]
        if self.gravity:
            found += [np.sin(motion.position), np.cos(motion.position)]
        return np.column_stack([motion.acceleration, *found])

    def reported(self) -> Array:
        """Matrix from the regression's parameters to those of `names`; of directions, mean and half difference."""
        if not self.directions:
            return np.eye(6 if self.gravity else 4)
        rows = [[1, 0, 0, 0, 0], [0, 0.5, 0.5, 0, 0], [0, 0, 0, 0.5, 0.5], [0, 0, 0, 0.5, -0.5], *np.eye(5)[1:]]
        found = np.zeros((8 + 2 * self.gravity, 5 + 2 * self.gravity))
        found[:8, :5] = rows
        found[8:, 5:] = np.eye(2 * self.gravity)
        return found


class Result(NamedTuple):
    """Parameters in the units of force (N | N m) over those of position (m | rad)."""

    inertia: Estimate  # M, kg | kg m^2
    viscous: Estimate  # Fv, N s/m | N m s/rad
    coulomb: Estimate  # Fc, N | N m
    offset: Estimate  # N | N m, positive where standing still would need a positive force
    residual_percent: float  # norm of the force residual over norm of the force, both filtered and decimated
    condition: float  # of the regressor with columns of unit length, so that it has no units
    correlation: Array  # (4, 4) of the estimates, in the order above
    more: dict[str, Estimate]  # of the directions, of gravity
    solution: tuple[Array, Array]  # (k,) and (k, k): parameters of the regression, and their covariance
    notes: tuple[str, ...]


class _Rows(NamedTuple):
    """What is left of a record after the recipe."""

    regressor: Array  # (m, k)
    force: Array  # (m,)
    velocity: Array  # (n,) of all rows
    share: Array  # (m,) of the way from one reversal to the next
    standing: float  # share of the rows that was left out
    recipe: Recipe


def least_squares(
    time: Array,
    position: Array,
    force: Array,
    cutoff_hz: float | None = None,
    decimate: int | None = None,
    model: Model = Model(),  # noqa: B008
) -> Result:
    """Parameters of `force` (n,) that moves `position` (n,) at `time` (n,) s.

    A slight irregularity of time is resampled, gaps split the record, and `notes` says so.  Raises
    IdentificationError where samples are not finite, where the recipe does not fit them, and where the motion does not
    separate the parameters.
    """
    _check(time, position, force)
    pieces, notes = parts(time, {"position": position, "force": force}, frozenset({"position"}))
    found = [_rows(p.columns["position"], p.columns["force"], p.dt, (cutoff_hz, decimate), model) for p in pieces]
    check_directions(np.concatenate([one.velocity for one in found]))
    regressor, kept = np.vstack([one.regressor for one in found]), np.concatenate([one.force for one in found])
    notes += [piece.note for piece in pieces if piece.note]
    result = _solved(regressor, kept, model, (*notes, *_said(found)))
    share, left = np.concatenate([one.share for one in found]), kept - regressor @ result.solution[0]
    doubt = after_reversals.doubt(left, share, result.coulomb.value)
    return result._replace(notes=(*result.notes, doubt)) if doubt else result


def percent(value: float) -> str:
    """A share, as text."""
    return f"{100.0 * value:.3g} %"


def _rows(position: Array, force: Array, dt: float, wanted: tuple[float | None, int | None], model: Model) -> _Rows:
    found = recipe(position, dt, *wanted)
    motion = moved(position, found)
    standing = _standing(motion.velocity, found)
    both = thinned(np.column_stack([model.columns(motion), force]), found)
    rows = slice(found.edge, len(standing) - found.edge, found.decimate)
    kept = ~standing[rows][: len(both)]
    share = after_reversals.travelled(motion.position, motion.velocity)[rows][: len(both)][kept]
    return _Rows(both[kept, :-1], both[kept, -1], motion.velocity, share, 1.0 - float(np.mean(kept)), found)


def _standing(velocity: Array, found: Recipe) -> NDArray[np.bool_]:
    """Rows (n,) in spans of standing still that are long against the filter."""
    slow = np.abs(velocity) < STANDING * float(np.abs(velocity).max())
    edges = np.flatnonzero(np.diff(np.concatenate([[False], slow, [False]]).astype(np.int8)))
    standing: NDArray[np.bool_] = np.zeros(len(velocity), dtype=np.bool_)
    for first, last in edges.reshape(-1, 2):
        if last - first >= DWELL / (found.cutoff * found.dt):
            standing[first:last] = True
    return standing


def _said(found: list[_Rows]) -> list[str]:
    one = found[0].recipe
    notes = [
        f"low-pass at {one.cutoff:.4g} Hz, one row of {one.decimate} kept; "
        "the intervals take the residual as correlated, not as white noise"
    ]
    standing = max(rows.standing for rows in found)
    if standing > 0.0:
        notes.append(
            f"{percent(standing)} of the rows stand still and are left out: there, friction is what holds the axis"
        )
    return notes


def _solved(regressor: Array, force: Array, model: Model, notes: tuple[str, ...]) -> Result:
    """Solve with columns of unit length: neither rounding nor the condition depends on the units."""
    length = np.linalg.norm(regressor, axis=0)
    condition = float(np.linalg.cond(regressor / length)) if np.all(length > 0.0) else math.inf
    if not condition <= WORST_CONDITION:
        raise IdentificationError(
            f"condition of the regressor = {condition:.3g}; must lie in [1, {WORST_CONDITION:g}]: the motion "
            "does not separate the parameters; record accelerations and several speeds in both directions"
        )
    unit = regressor / length
    scaled, *_ = np.linalg.lstsq(unit, force, rcond=None)
    residual = force - unit @ scaled
    values, honest = scaled / length, standard_errors.covariance(unit, residual) / np.outer(length, length)
    plain = standard_errors.white(unit, residual) / np.outer(length, length)
    estimates, correlation = estimated(model, values, honest, plain)
    share = 100.0 * float(np.linalg.norm(residual) / np.linalg.norm(force))
    inertia, viscous, coulomb, offset = (estimates.pop(name) for name in ALWAYS)
    solution = (values, honest)
    return Result(inertia, viscous, coulomb, offset, share, condition, correlation, estimates, solution, notes)


def estimated(model: Model, values: Array, honest: Array, plain: Array) -> tuple[dict[str, Estimate], Array]:
    """What is reported, by name, and the correlation (4, 4) of the usual four."""
    turn = model.reported()
    spread, textbook = (np.sqrt(np.diag(turn @ one @ turn.T)) for one in (honest, plain))
    numbers = zip(model.names, (turn @ values).tolist(), spread.tolist(), textbook.tolist(), strict=True)
    whole = (turn @ honest @ turn.T)[:4, :4]
    return {name: Estimate(*rest) for name, *rest in numbers}, whole / np.outer(spread[:4], spread[:4])


def _check(time: Array, position: Array, force: Array) -> None:
    for name, column, unit in (("time", time, "s"), ("position", position, "m"), ("force", force, "N")):
        if np.shape(column) != (len(time),):
            raise IdentificationError(f"{name} has shape {np.shape(column)}; must be ({len(time)},) as time")
        if not np.all(np.isfinite(column)):
            row = int(np.argmin(np.isfinite(column)))
            raise IdentificationError(
                f"{name}[{row}] = {column[row]} {unit}; must be finite: cut the record to a part without gaps"
            )
    if len(time) < 2:
        raise IdentificationError(f"record of {len(time)} samples; must have more: record longer")


def check_directions(velocity: Array) -> None:
    """Without both directions Coulomb friction and offset are one number."""
    fastest = float(np.abs(velocity).max())
    share = min(float(np.mean(velocity > SLOW * fastest)), float(np.mean(velocity < -SLOW * fastest)))
    if share < BOTH_WAYS:
        raise IdentificationError(
            f"share of the samples in the rarer direction = {share:.3g}; must lie in [{BOTH_WAYS}, 0.5]: "
            "coulomb friction and offset are separable only in a motion there and back; record one"
        )
