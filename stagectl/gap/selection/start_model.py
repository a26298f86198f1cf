"""The model from which the baseline fit begins, where columns around the nominal one would be those of no machine."""

import math
from collections.abc import Sequence

import numpy as np

from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import TrackedModel, mean_residuals
from stagectl.gap.residuals.whitening import Whitener
from stagectl.gap.selection import thresholds
from stagectl.kernels import stage
from stagectl.kernels.fields import put

EFFORT, CURRENT = 0, 1  # places in a residual


def in_time(model: TrackedModel, runs: Sequence[Run], noise: Whitener, dt: float) -> TrackedModel:
    """The model with the time shift of a grid that leaves least of the current; with none where a slower loop does.

    From there the fit finds it.  The current follows a staircase, which has no slope at its edges to follow from afar.
    """

    def slower(share: float) -> TrackedModel:
        return put(model, "stage.drive.current_lag", model.stage.drive.current_lag + share * dt)

    shifted = [model._replace(shift=share * dt) for share in thresholds.SHIFTS_TRIED]
    best = _best([*shifted, *map(slower, thresholds.LAGS_TRIED)], runs, noise, CURRENT)
    return best if any(best is each for each in shifted) else model


def with_friction(model: TrackedModel, runs: Sequence[Run], noise: Whitener, effort: float) -> TrackedModel:
    """A model that slides freely, with the friction that leaves least of the effort: a few shares of `effort` (rms).

    What the machine's friction takes would move a model without any to and fro, and off the measured path.
    """
    friction = model.stage.friction
    if stage.sliding(friction):
        return model

    def rubbing(force: float) -> TrackedModel:
        weight = np.zeros_like(friction.operators.weight)
        weight[-1] = force
        return put(model, "stage.friction.operators.weight", weight)

    return _best([model, *(rubbing(share * effort) for share in thresholds.FRICTIONS_TRIED)], runs, noise, EFFORT)


def _best(models: Sequence[TrackedModel], runs: Sequence[Run], noise: Whitener, column: int) -> TrackedModel:
    """The first of `models` that leaves least of a `column` of the residuals."""

    def left(model: TrackedModel) -> float:
        pairs = zip(runs, mean_residuals(model, runs, noise), strict=True)
        squares = sum(float(np.sum((run.weight * residual[:, column]) ** 2)) for run, residual in pairs)
        return squares if math.isfinite(squares) else math.inf

    return min(models, key=left)
