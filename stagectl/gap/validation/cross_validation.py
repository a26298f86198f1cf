"""How much better a fit is on the data that it was fitted to than on others: within-run cross-validation by blocks."""

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.least_squares import residual_sum_of_squares
from stagectl.gap.selection import priors, refine
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.validation.thresholds import BLOCKS


def optimism(e: Evidence, now: Fitted) -> float:
    """Sum of squares on blocks of half strokes that chose nothing, over that of the fit to all of them; at least 1.

    Each block in turn is predicted with the parameters that all others give, linear around the fit.
    """
    own = refine.parameters(now)
    g = gram_matrices.grams(refine.tangent(e, now, own), now.residuals)
    names = [*refine.nuisances(e), *(direction.name for direction in own)]
    strokes = np.array_split(np.arange(len(g.stroke)), min(BLOCKS, len(g.stroke)))
    if len(strokes) < 2:
        return 1.0
    predicted = sum(_left(e, now, g, names, block) for block in strokes)
    fitted = float(g.both[:, -1, -1].sum())
    return max(predicted / max(fitted, 1e-300), 1.0)


def _left(e: Evidence, now: Fitted, g: Grams, names: list[str], block: NDArray[np.int64]) -> float:
    """What is left of `block` (half strokes) with the parameters of all other half strokes."""
    others = np.setdiff1d(np.arange(len(g.stroke)), block)
    rest = g._replace(effort=g.effort[others], current=g.current[others], floor=g.floor[others])
    prior, nuisances = e.base.prior, refine.nuisances(e)
    free = np.full((len(names) - len(nuisances), 2), (-np.inf, np.inf))
    bounds = np.concatenate([prior.limits(now.model, nuisances), free])
    informed = prior.informed(now.model, nuisances)
    step = priors.bounded_step(rest, names, bounds, informed, priors.temper(rest, names, prior)).move
    return residual_sum_of_squares(g.both[block].sum(axis=0), g.places(names), np.array([step[name] for name in names]))
