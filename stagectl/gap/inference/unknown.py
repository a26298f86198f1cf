"""The shape of what no effect explains: in which coordinate it repeats, and its force there as a data-based term.

It is reported where it is large, repeats, and can be foretold on data that it was not fitted on.  A function that
foretells as much on machines with nothing but another law of friction is form error, and stays silent.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.effect import Scales
from stagectl.gap.inference import basis_functions, coordinates, unstructured_residual
from stagectl.gap.inference.basis_functions import ALL, EVEN, INERTIAL, LOOP, ODD, Functions, Smoother
from stagectl.gap.inference.coordinates import drawn, foretold, means
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.residuals.gram_matrices import Columns, Grams, Products
from stagectl.gap.result.diagnosis import UNORDERED, UnknownTerm
from stagectl.gap.selection import candidate_scores, null_ensemble, refine, swap_tests
from stagectl.gap.selection.cross_validation import against, folds, partialled_out
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.thresholds import OF_KIN
from stagectl.kernels import effects, jit

LARGE = 0.1  # of what the base refit left to be closed
FORETOLD = 0.5  # of what is left, on data that the function has not seen
NO_LAW = 10.0  # times what the worst law of the ensemble leaves: no law of friction is so far from all others
FORM = 0.95  # quantile of the ensemble of friction laws
ROWS = 241  # of a table
# Coordinate of a shape: that of the stage model's table, and the parts that it can hold.
TABLES = {
    "speed": ("velocity", (EVEN, ODD)),
    "displacement_since_reversal": ("displacement_since_reversal", (EVEN, ODD)),
    "position": ("position", (EVEN,)),
    "position_mod_pitch": ("position_mod_pitch", (EVEN,)),
    "current": ("current", (EVEN,)),
}
OF_ONE = ((EVEN,), (ODD,), (EVEN, ODD))
BOTH = ((EVEN, ODD, INERTIAL), (EVEN, ODD, LOOP))  # of two coordinates at once, where one does not do
ALIKE = {"position": "position_mod_pitch", "position_mod_pitch": "position"}
OF_TWO = ("speed", "position")


class Foretold(NamedTuple):
    """What one function foretells of what is left."""

    smoother: Smoother
    parts: tuple[str, ...]
    gain: float  # of the sum of squares
    share: float  # of what is left above the repeats' floor
    limit: float  # gain that the ensemble of friction laws gives it


def functions(e: Evidence, size: Scales, library: candidate_scores.Library) -> Functions:
    """Functions of single coordinates along the runs, beside the base and the null ensemble."""
    known = gram_matrices.selected(
        library.products, [*e.base.products.names, *null_ensemble.member_names(library.products.names)]
    )
    return basis_functions.functions(basis_functions.Ground(e.base.model, e.base.noise), e.runs, size, known)


def unknown(e: Evidence, selected: swap_tests.Selection, smooth: Functions) -> UnknownTerm | None:
    """What is left over the coordinate that orders it best, or where else it is found; None where it is nowhere."""
    now = selected.fitted
    own = _own(e, now)
    known = gram_matrices.with_columns(smooth.known, own)
    largest = max((gain for block, _, gain in _taken(e, selected) if block != "drive"), default=0.0)
    found = _ordered(e, selected, (known, own), smooth)
    if found or not refine.repeated(e):  # noise has no order either: what is not repeated cannot be told from it
        return found
    left = unstructured_residual.left_of(now, known)
    rows = unstructured_residual.freed(e, left, 0)
    return (
        unstructured_residual.in_a_band(e, rows, max(_least(e), OF_KIN * largest))
        or unstructured_residual.over_the_clock(e, now, smooth, _least(e) * _repeats(e))
        or unstructured_residual.in_the_drive(e, left)
        or _without_order(e, left, rows, largest)
    )


def _ordered(
    e: Evidence, selected: swap_tests.Selection, beside: tuple[Products, Columns], smooth: Functions
) -> UnknownTerm | None:
    """The effort that is left as a function of one coordinate, or of one and what the axis does there."""
    (known, own), now, taken, least = beside, selected.fitted, _taken(e, selected), _least(e)
    if _squares(e, means(now.residuals)) - _floor(e) <= max(least, 0.0):
        return None

    def clear(found: Sequence[Foretold]) -> list[Foretold]:
        return [one for one in found if one.gain > _kin(one, taken) and _clear(one, least)]

    if good := clear(_of_one(e, now, own, smooth)):
        best = _best(good)
        return _shape(e, now, smooth.products[best.smoother.coordinate], best)
    chosen = [one for one in smooth.tried if one.coordinate in OF_TWO]
    ground = basis_functions.Ground(now.model, e.base.noise)
    new = basis_functions.columns_of(ground, e.runs, (smooth.motions, smooth.size), dict.fromkeys(ALL, chosen))
    both = gram_matrices.with_columns(known, new)
    good = clear([each for one in chosen for each in _foretold(e, now, both, (one, BOTH))])
    return _shape(e, now, both, _best(good)) if good else None


def _of_one(e: Evidence, now: Fitted, own: Columns, smooth: Functions) -> list[Foretold]:
    """What each function of one coordinate foretells of what is left under `now`."""
    each = ((one, gram_matrices.with_columns(smooth.products[one.coordinate], own)) for one in smooth.tried)
    return [found for one, products in each for found in _foretold(e, now, products, (one, OF_ONE))]


def _without_order(
    e: Evidence, all_: unstructured_residual.Left, rows: unstructured_residual.Freed, named: float
) -> UnknownTerm | None:
    """What repeats and is too much for any law of friction, though nothing orders it; no term of the model.

    `named` is the largest gain of an effect that was named.
    """
    left = sum(float(np.sum(one * one)) for one in rows.left) - _floor(e)
    if left < max(_least(e), NO_LAW * _form(e, all_.grams), OF_KIN * named):
        return None
    return UNORDERED


def _form(e: Evidence, g: Grams) -> float:
    """Largest sum of squares that the base leaves on a machine of the null ensemble."""
    free = partialled_out(folds(g, g.effort), g.places(candidate_scores.nuisances(e)))
    return max(
        (float(free[:, place, place].sum()) for place in g.places(null_ensemble.member_names(g.names))), default=0.0
    )


def largest(e: Evidence, now: Fitted, smooth: Functions) -> float:
    """The most that a function of one coordinate foretells of what is left under `now`, all repeats together.

    0 where none foretells as much as an unknown effect must.
    """
    least = _least(e)
    return max(
        (one.gain * _repeats(e) for one in _of_one(e, now, _own(e, now), smooth) if _clear(one, least)), default=0.0
    )


def _clear(one: Foretold, least: float) -> bool:
    return one.share >= FORETOLD and one.gain > max(least, one.limit)


def _least(e: Evidence) -> float:
    return LARGE * (_squares(e, means(e.base.after)) - _floor(e))


def _floor(e: Evidence) -> float:
    return float(coordinates.floor_of_means(e)[0])


def _repeats(e: Evidence) -> float:
    return sum(len(run.paths) for run in e.runs) / len(e.runs)


def _own(e: Evidence, now: Fitted) -> Columns:
    """The columns of the effects' parameters where they stand."""
    return sensitivities.all_columns(now.equipped, e.runs, refine.parameters(now), e.base.noise)


def _taken(e: Evidence, selected: swap_tests.Selection) -> list[tuple[str, str, float]]:
    """Block, coordinate and gain of each effect, of the mean of the repeats."""
    gains, repeats = selected.gains, _repeats(e)
    return [(x.effect.block, x.effect.coordinate, gains[x.effect.name] / repeats) for x in selected.fitted.effects]


def _kin(one: Foretold, taken: Sequence[tuple[str, str, float]]) -> float:
    """What an error of form of the effects of the same coordinate may leave."""
    alike = {one.smoother.coordinate, ALIKE.get(one.smoother.coordinate)}
    return max((OF_KIN * gain for _, name, gain in taken if name in alike), default=0.0)


def _best(good: Sequence[Foretold]) -> Foretold:
    # A little more from a richer function is no reason to take it: the table must hold what it can.
    largest = max(one.gain for one in good)
    near = [one for one in good if one.gain >= 0.9 * largest]
    return min(near, key=lambda one: (not _tabled(one), -one.gain))


def _squares(e: Evidence, residuals: Sequence[list[Array]]) -> float:
    pairs = zip(e.runs, residuals, strict=True)
    return float(sum(np.sum((run.weight * one[:, 0]) ** 2) for run, repeats in pairs for one in repeats))


def _foretold(
    e: Evidence, now: Fitted, products: Products, what: tuple[Smoother, Sequence[tuple[str, ...]]]
) -> list[Foretold]:
    """What variants of one function foretell; `products` hold its columns, and those that move beside it."""
    one, variants = what
    beside = [direction.name for direction in refine.parameters(now)]
    g = gram_matrices.fold_sums(products, means(now.residuals))
    free, floor = partialled_out(folds(g, g.effort), g.places([*candidate_scores.nuisances(e), *beside])), _floor(e)
    machines = [against(free, place) for place in g.places(null_ensemble.member_names(products.names))]
    owns = [g.places([name for part in parts for name in basis_functions.names(one, part)]) for parts in variants]
    return [_judged((free, machines), own, (one, chosen), floor) for own, chosen in zip(owns, variants, strict=True)]


def _judged(
    data: tuple[Array, list[Array]], own: Sequence[int], what: tuple[Smoother, tuple[str, ...]], floor: float
) -> Foretold:
    """Functions in the columns `own` of the hands, and of those of each machine of the null ensemble."""
    (free, machines), (one, parts) = data, what
    before, after = foretold(free, own)
    form = [foretold(machine, own) for machine in machines]
    limit = float(np.quantile([x - y for x, y in form], FORM)) if form else 0.0
    share = (before - after) / (before - floor) if before > floor else 0.0
    return Foretold(one, parts, before - after, share, limit)


def _tabled(one: Foretold) -> bool:
    return one.smoother.coordinate in TABLES and set(one.parts) <= set(TABLES[one.smoother.coordinate][1])


def _shape(e: Evidence, now: Fitted, products: Products, best: Foretold) -> UnknownTerm:
    """Force over the coordinate, fitted beside the base's parameters: those have taken a part of it upon themselves."""
    one = best.smoother
    own = [name for part in best.parts for name in basis_functions.names(one, part)]
    g = gram_matrices.fold_sums(products, means(now.residuals))
    beside = g.places(refine.nuisances(e))
    amplitude = drawn(g.effort.sum(axis=0), g.places(own), beside)[len(beside) :]
    split = dict(zip(best.parts, np.split(amplitude, len(best.parts)), strict=True))
    grid, force = _force(one, split)
    shape = UnknownTerm(one.coordinate, grid, force, min(best.share, 1.0))
    return shape._replace(fields=_fields(shape)) if _tabled(best) else shape


def _force(one: Smoother, split: dict[str, Array]) -> tuple[Array, Array]:
    """Grid and force; over both directions where speed or the way since a reversal is the coordinate."""
    signed = one.coordinate in ("speed", "displacement_since_reversal") and ODD in split
    grid = np.linspace(-one.high if signed else one.low, one.high, ROWS)
    basis = one.basis(np.abs(grid) if signed else grid)
    side = np.sign(grid) if signed else np.ones(ROWS)
    force = split.get(EVEN, np.zeros(len(basis))) @ basis + side * (split.get(ODD, np.zeros(len(basis))) @ basis)
    return grid, force


def _fields(shape: UnknownTerm) -> tuple[tuple[str, str | float | tuple[float, ...]], ...]:
    p = _table(shape)
    return (
        ("residual.coordinate", effects.COORDINATES[p.coordinate]),
        ("residual.start", p.start),
        ("residual.step", p.step),
        ("residual.values", tuple(float(one) for one in p.values)),
    )


def with_shape(e: Evidence, now: Fitted, shape: UnknownTerm) -> Fitted:
    """`now` with the table of `shape` in its model, and all other parameters refitted beside it.

    Without that refit the gap may widen: a base that had bent towards the unknown must bend back.
    """
    stage = now.model.stage._replace(residual=as_table(shape))
    return refine.refine(e, now.model._replace(stage=stage), now.effects)


def as_table(shape: UnknownTerm) -> effects.Table:
    """`shape` as the stage model's data-based term; neutral where no coordinate of the model can hold it.

    The table opposes the motor, so it is the force that the model lacks with its sign turned.
    """
    return _table(shape) if shape.fields else effects.NO_TABLE


def _table(shape: UnknownTerm) -> effects.Table:
    name = TABLES[shape.coordinate][0]
    if name == "velocity" and shape.grid[0] >= 0.0:
        name = "speed"
    code = effects.COORDINATES.index(name)
    start, step = float(shape.grid[0]), float(shape.grid[1] - shape.grid[0])
    return effects.Table(code, start, step, jit.table((-shape.force).tolist()))
