"""Where the fit of the time shift between current and position begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import TrackedModel, mean_residuals
from stagectl.gap.residuals.whitening import Whitener
from stagectl.gap.selection import thresholds
from stagectl.kernels.fields import put


def in_time(model: TrackedModel, runs: Sequence[Run], noise: Whitener, dt: float) -> TrackedModel:
    """The model with the time shift of a grid that leaves least of the current; with none where a slower loop does.

    From there the fit finds it.  The current follows a staircase, which has no slope at its edges to follow from afar.
    """

    def left(shifted: TrackedModel) -> float:
        pairs = zip(runs, mean_residuals(shifted, runs, noise), strict=True)
        return float(sum(np.sum((run.weight * residual[:, 1]) ** 2) for run, residual in pairs))

    def slower(share: float) -> TrackedModel:
        lag = model.stage.drive.current_lag + share * dt
        return model._replace(stage=put(model.stage, "drive.current_lag", lag))

    shifted = [model._replace(shift=share * dt) for share in thresholds.SHIFTS_TRIED]
    best = min([*shifted, *map(slower, thresholds.LAGS_TRIED)], key=left)
    return best if any(best is each for each in shifted) else model
