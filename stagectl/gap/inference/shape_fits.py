"""What a function of one coordinate predicts of the residual, judged on data that it was not fitted to.

The same function predicts something on machines with nothing but another friction law.  That is its limit: a function
that gains no more shows an error in the form of the friction, and no unknown.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.inference import basis_functions, coordinates
from stagectl.gap.inference.basis_functions import ALL, EVEN, INERTIAL, LOOP, ODD, BasisColumns, CoordinateBasis
from stagectl.gap.inference.coordinates import means, predicted_of, ridge_fit
from stagectl.gap.inference.patch_fields import table_fields
from stagectl.gap.inference.thresholds import (
    ENSEMBLE_QUANTILE,
    NEARLY_BEST_SHAPE,
    TABLE_ROWS,
    UNKNOWN_PREDICTED,
    UNKNOWN_SHARE,
)
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.residuals.gram_matrices import Columns, Products, folds, partialled_out
from stagectl.gap.result.diagnosis import UnknownTerm
from stagectl.gap.selection import null_ensemble, refine
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels import effects, jit
from stagectl.kernels.fields import put
from stagectl.number_format import NORMAL

SINGLE = ((EVEN,), (ODD,), (EVEN, ODD))  # parts of a function of one coordinate and the direction
WITH_ACCELERATION = ((EVEN, ODD, INERTIAL), (EVEN, ODD, LOOP))  # tried where no single coordinate is enough
COMBINED = ("speed", "position")  # coordinates that are combined with the acceleration


class ShapeFit(NamedTuple):
    """What one function predicts of the residual."""

    basis: CoordinateBasis
    parts: tuple[str, ...]
    gain: float  # of the sum of squares
    share: float  # of the residual above the repeats' floor, as far up as that may be with 97.5 %
    limit: float  # gain that the ensemble of friction laws gives it
    ridge: float  # by which it predicts most

    def clear(self, least: float) -> bool:
        """Whether it predicts enough, and gains more than `least` and than any friction law gives."""
        return self.share >= UNKNOWN_PREDICTED and self.gain > max(least, self.limit)


def own_columns(e: Evidence, now: Fitted) -> Columns:
    """The columns of the effects' parameters at their present values."""
    return sensitivities.all_columns(now.equipped, e.runs, refine.parameters(now), e.base.noise)


def single_coordinate(e: Evidence, now: Fitted, own: Columns, functions: BasisColumns) -> list[ShapeFit]:
    """What each function of one coordinate predicts of the residual of `now`."""
    return [
        fit
        for basis in functions.bases
        for fit in _fits(e, now, gram_matrices.with_columns(functions.products[basis.coordinate], own), basis, SINGLE)
    ]


def with_acceleration(
    e: Evidence, now: Fitted, known: Products, functions: BasisColumns
) -> tuple[Products, list[ShapeFit]]:
    """The same of functions of speed or position and what the axis does there, with all their columns."""
    bases = [basis for basis in functions.bases if basis.coordinate in COMBINED]
    refiltered = functions._replace(filter=basis_functions.ResidualFilter(now.model, e.base.noise))
    products = gram_matrices.with_columns(known, basis_functions.columns_of(refiltered, dict.fromkeys(ALL, bases)))
    return products, [fit for basis in bases for fit in _fits(e, now, products, basis, WITH_ACCELERATION)]


def _fits(
    e: Evidence, now: Fitted, products: Products, basis: CoordinateBasis, variants: Sequence[tuple[str, ...]]
) -> list[ShapeFit]:
    """What variants of one function predict; `products` hold its columns, and those of all free parameters."""
    own = (direction.name for direction in refine.parameters(now))
    nuisances = [*refine.moving(e), *own, *refine.free_names(e)]
    g = gram_matrices.fold_sums(products, means(now.residuals))
    free, floor = partialled_out(folds(g, g.effort), g.places(nuisances)), floor_of(e)
    floor -= _unsure(e, floor)
    machines = g.places(null_ensemble.member_names(products.names))
    fits = []
    for parts in variants:
        columns = g.places([name for part in parts for name in basis_functions.names(basis, part)])
        fits.append(ShapeFit(basis, parts, *_predicted(free, columns, machines, floor)))
    return fits


def _predicted(
    free: Array, columns: Sequence[int], machines: Sequence[int], floor: float
) -> tuple[float, float, float, float]:
    """Gain of the `columns` of the folds, its share of the residual above the `floor`, their gain on `machines`, ridge.

    Those are columns of the null ensemble, each in the place of the residual; 0 without any.
    """
    before, after, ridges = predicted_of(free, columns, [-1, *machines])
    gain, *of_laws = (before - after).tolist()
    share = gain / float(before[0] - floor) if before[0] > floor else 0.0
    limit = float(np.quantile(of_laws, ENSEMBLE_QUANTILE)) if of_laws else 0.0
    return gain, share, limit, float(ridges[0])


def _unsure(e: Evidence, floor: float) -> float:
    """By how much less noise there may be than the `floor` (sums of squares), and so more above it: 97.5 %.

    Without this, noise that leaves as much as the floor would be predicted whole by any function.  The sums of squares
    of the residual and of the repeats' differences each have the variance of a chi-square.
    """
    rows = sum(float(np.sum(run.weight * run.weight)) for run in e.runs)
    return NORMAL * floor * math.sqrt(2.0 / rows * (1.0 + 1.0 / max(repeats_of(e) - 1.0, 1.0))) if floor else 0.0


def least_gain(e: Evidence) -> float:
    """Gain that an unknown must have: a share of what the base refit left to be closed."""
    return UNKNOWN_SHARE * (squares(e, means(e.base.after)) - floor_of(e))


def floor_of(e: Evidence) -> float:
    """Sum of squares of the effort that the repeats' noise leaves in their means."""
    return float(coordinates.floor_of_means(e)[0])


def repeats_of(e: Evidence) -> float:
    """Mean number of repeats of an experiment."""
    return sum(len(run.paths) for run in e.runs) / len(e.runs)


def squares(e: Evidence, residuals: Sequence[list[Array]]) -> float:
    """Weighted sum of squares of the effort."""
    pairs = zip(e.runs, residuals, strict=True)
    return float(sum(np.sum((run.weight * residual[:, 0]) ** 2) for run, repeats in pairs for residual in repeats))


# The parts of a function that the stage model's table can hold, by coordinate; an odd one over both directions.
TABLES = {
    "speed": (EVEN, ODD),
    "displacement_since_reversal": (EVEN, ODD),
    "position": (EVEN,),
    "position_mod_pitch": (EVEN,),
    "current": (EVEN,),
}


def best_of(fits: list[ShapeFit]) -> ShapeFit:
    """The fit with the largest gain, or one nearly as good that the stage model's table can hold.

    A little more gain is no reason for a richer function: a table can only be written where the model has one.  Nor is
    it one for the current, with which a controller answers whatever is missing.
    """
    largest = max(fit.gain for fit in fits)
    near = [fit for fit in fits if fit.gain >= NEARLY_BEST_SHAPE * largest]
    return min(near, key=lambda fit: (fit.basis.coordinate == "current", not _tabled(fit), -fit.gain))


def _tabled(fit: ShapeFit) -> bool:
    return set(fit.parts) <= set(TABLES.get(fit.basis.coordinate, ()))


def shape_of(e: Evidence, now: Fitted, products: Products, fit: ShapeFit) -> UnknownTerm:
    """Force over the coordinate, fitted together with the base's parameters, which have absorbed a part of it.

    `products` hold the columns of the function, of these parameters and of those of the effects.
    """
    columns = [name for part in fit.parts for name in basis_functions.names(fit.basis, part)]
    g = gram_matrices.fold_sums(products, means(now.residuals))
    nuisances = g.places(refine.nuisances(e))
    amplitudes = ridge_fit(g.effort.sum(axis=0), g.places(columns), fit.ridge, nuisances)[len(nuisances) :]
    by_part = dict(zip(fit.parts, np.split(amplitudes, len(fit.parts)), strict=True))
    grid, force = _force(fit.basis, by_part)
    shape = UnknownTerm(fit.basis.coordinate, grid, force, min(fit.share, 1.0))
    return shape._replace(fields=tuple(table_fields(as_table(shape)))) if _tabled(fit) else shape


def _force(basis: CoordinateBasis, amplitudes: dict[str, Array]) -> tuple[Array, Array]:
    """Grid and force (n,) each; over both directions where the coordinate has no sign but the function is odd.

    Over any other coordinate, it is the force of the direction in which there is more of it.
    """
    signed = ODD in amplitudes and ODD in TABLES.get(basis.coordinate, ())
    grid = np.linspace(-basis.high if signed else basis.low, basis.high, TABLE_ROWS)
    values = basis.basis(np.abs(grid) if signed else grid)
    none = np.zeros(len(values))
    even, odd = (amplitudes.get(part, none) @ values for part in (EVEN, ODD))
    if signed:
        return grid, even + np.sign(grid) * odd
    return grid, max(even + odd, even - odd, key=lambda force: float(force @ force))


def with_shape(e: Evidence, now: Fitted, shape: UnknownTerm) -> Fitted:
    """`now` with the table of `shape` in its model, and all other parameters refitted.

    Without that refit the gap may widen: the base has bent towards the unknown, and must bend back.
    """
    return refine.refine(e, put(now.model, "stage.residual", as_table(shape)), now.effects)


def as_table(shape: UnknownTerm) -> effects.Table:
    """`shape` as the stage model's data-based term, over one of its coordinates.

    The table opposes the motor, so it is the missing force with its sign turned.
    """
    both_ways = shape.coordinate == "speed" and shape.grid[0] < 0.0
    code = effects.COORDINATES.index("velocity" if both_ways else shape.coordinate)
    start, step = float(shape.grid[0]), float(shape.grid[1] - shape.grid[0])
    return effects.Table(code, start, step, jit.table((-shape.force).tolist()))
