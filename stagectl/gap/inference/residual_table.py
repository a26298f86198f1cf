"""The shape of an unknown as a data-based term of the stage model: a force over one coordinate, as a table."""

from __future__ import annotations

import numpy as np

from stagectl.gap.inference import basis_functions
from stagectl.gap.inference.basis_functions import EVEN, ODD, CoordinateBasis
from stagectl.gap.inference.coordinates import means, ridge_fit
from stagectl.gap.inference.shape_fits import ShapeFit
from stagectl.gap.inference.thresholds import NEARLY_BEST_SHAPE, TABLE_ROWS
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.gram_matrices import Products
from stagectl.gap.result.diagnosis import Fields, UnknownTerm
from stagectl.gap.selection import refine
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels import effects, jit

# Coordinate of a shape: that of the stage model's table, and the parts that it can hold.
TABLES = {
    "speed": ("velocity", (EVEN, ODD)),
    "displacement_since_reversal": ("displacement_since_reversal", (EVEN, ODD)),
    "position": ("position", (EVEN,)),
    "position_mod_pitch": ("position_mod_pitch", (EVEN,)),
    "current": ("current", (EVEN,)),
}
SIGNED = ("speed", "displacement_since_reversal")  # coordinates whose table goes over both directions


def best_of(fits: list[ShapeFit]) -> ShapeFit:
    """The fit with the largest gain, or one nearly as good that the stage model's table can hold.

    A little more gain is no reason for a richer function: a table can only be written where the model has one.
    """
    largest = max(fit.gain for fit in fits)
    near = [fit for fit in fits if fit.gain >= NEARLY_BEST_SHAPE * largest]
    return min(near, key=lambda fit: (not _tabled(fit), -fit.gain))


def _tabled(fit: ShapeFit) -> bool:
    return fit.basis.coordinate in TABLES and set(fit.parts) <= set(TABLES[fit.basis.coordinate][1])


def shape_of(e: Evidence, now: Fitted, products: Products, fit: ShapeFit) -> UnknownTerm:
    """Force over the coordinate, fitted together with the base's parameters, which have absorbed a part of it.

    `products` hold the columns of the function and of these parameters.
    """
    columns = [name for part in fit.parts for name in basis_functions.names(fit.basis, part)]
    g = gram_matrices.fold_sums(products, means(now.residuals))
    nuisances = g.places(refine.nuisances(e))
    amplitudes = ridge_fit(g.effort.sum(axis=0), g.places(columns), nuisances)[len(nuisances) :]
    by_part = dict(zip(fit.parts, np.split(amplitudes, len(fit.parts)), strict=True))
    grid, force = _force(fit.basis, by_part)
    shape = UnknownTerm(fit.basis.coordinate, grid, force, min(fit.share, 1.0))
    return shape._replace(fields=_fields(shape)) if _tabled(fit) else shape


def _force(basis: CoordinateBasis, amplitudes: dict[str, Array]) -> tuple[Array, Array]:
    """Grid and force (n,) each; over both directions where the coordinate has no sign but the function is odd."""
    signed = basis.coordinate in SIGNED and ODD in amplitudes
    grid = np.linspace(-basis.high if signed else basis.low, basis.high, TABLE_ROWS)
    values = basis.basis(np.abs(grid) if signed else grid)
    side, none = np.sign(grid) if signed else np.ones(TABLE_ROWS), np.zeros(len(values))
    return grid, amplitudes.get(EVEN, none) @ values + side * (amplitudes.get(ODD, none) @ values)


def _fields(shape: UnknownTerm) -> Fields:
    p = _table(shape)
    return (
        ("residual.coordinate", effects.COORDINATES[p.coordinate]),
        ("residual.start", p.start),
        ("residual.step", p.step),
        ("residual.values", tuple(float(value) for value in p.values)),
    )


def with_shape(e: Evidence, now: Fitted, shape: UnknownTerm) -> Fitted:
    """`now` with the table of `shape` in its model, and all other parameters refitted.

    Without that refit the gap may widen: the base has bent towards the unknown, and must bend back.
    """
    stage = now.model.stage._replace(residual=as_table(shape))
    return refine.refine(e, now.model._replace(stage=stage), now.effects)


def as_table(shape: UnknownTerm) -> effects.Table:
    """`shape` as the stage model's data-based term; neutral where no coordinate of the model can hold it.

    The table opposes the motor, so it is the missing force with its sign turned.
    """
    return _table(shape) if shape.fields else effects.NO_TABLE


def _table(shape: UnknownTerm) -> effects.Table:
    name = TABLES[shape.coordinate][0]
    if name == "velocity" and shape.grid[0] >= 0.0:
        name = "speed"
    code = effects.COORDINATES.index(name)
    start, step = float(shape.grid[0]), float(shape.grid[1] - shape.grid[0])
    return effects.Table(code, start, step, jit.table((-shape.force).tolist()))
