"""What a function of one coordinate predicts of the residual, judged on data that it was not fitted to.

The same function predicts something on machines with nothing but another friction law.  That is its limit: a function
that gains no more shows an error in the form of the friction, and no unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.inference import basis_functions, coordinates
from stagectl.gap.inference.basis_functions import ALL, EVEN, INERTIAL, LOOP, ODD, BasisColumns, CoordinateBasis
from stagectl.gap.inference.coordinates import means, predicted_squares
from stagectl.gap.inference.thresholds import ENSEMBLE_QUANTILE, UNKNOWN_PREDICTED, UNKNOWN_SHARE
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.residuals.gram_matrices import Columns, Products
from stagectl.gap.selection import candidate_scores, null_ensemble, refine
from stagectl.gap.selection.cross_validation import against, folds, partialled_out
from stagectl.gap.selection.refine import Evidence, Fitted

SINGLE = ((EVEN,), (ODD,), (EVEN, ODD))  # parts of a function of one coordinate and the direction
WITH_ACCELERATION = ((EVEN, ODD, INERTIAL), (EVEN, ODD, LOOP))  # tried where no single coordinate is enough
COMBINED = ("speed", "position")  # coordinates that are combined with the acceleration


class ShapeFit(NamedTuple):
    """What one function predicts of the residual."""

    basis: CoordinateBasis
    parts: tuple[str, ...]
    gain: float  # of the sum of squares
    share: float  # of the residual above the repeats' floor
    limit: float  # gain that the ensemble of friction laws gives it

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
    nuisances = [*candidate_scores.nuisances(e), *(direction.name for direction in refine.parameters(now))]
    g = gram_matrices.fold_sums(products, means(now.residuals))
    free, floor = partialled_out(folds(g, g.effort), g.places(nuisances)), floor_of(e)
    machines = [against(free, place) for place in g.places(null_ensemble.member_names(products.names))]
    fits = []
    for parts in variants:
        columns = g.places([name for part in parts for name in basis_functions.names(basis, part)])
        gain, share = _predicted(free, columns, floor)
        fits.append(ShapeFit(basis, parts, gain, share, _limit(machines, columns)))
    return fits


def _predicted(free: Array, columns: Sequence[int], floor: float) -> tuple[float, float]:
    """Gain, and share of the residual above the `floor`, of the `columns` of the folds."""
    before, after = predicted_squares(free, columns)
    return before - after, (before - after) / (before - floor) if before > floor else 0.0


def _limit(machines: Sequence[Array], columns: Sequence[int]) -> float:
    """Gain of the `columns` on the machines of the null ensemble; 0 without one."""
    gains = [before - after for before, after in (predicted_squares(machine, columns) for machine in machines)]
    return float(np.quantile(gains, ENSEMBLE_QUANTILE)) if gains else 0.0


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
