"""The gap of the effort along the measured path, for sessions whose loop cannot be simulated."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import sensitivities
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.residuals.thresholds import BAND
from stagectl.gap.residuals.whitening import Whitener
from stagectl.gap.validation.held_out_gap import StrokeSums


def effort(p: TrackedModel, runs: Sequence[Run], noise: Whitener, dt: float) -> StrokeSums:
    """Missing effort of the model along the runs, in the band of the cuts, over half strokes (N m | N)."""
    scale = math.sqrt(BAND / dt)  # back from unit density to the signal's own size
    residuals = _residuals(p, runs, noise)
    return _by_stroke(runs, [[scale * residual for residual in repeats] for repeats in residuals])


def effort_floor(p: TrackedModel, runs: Sequence[Run], noise: Whitener, dt: float) -> StrokeSums:
    """What repeats differ by in that effort; zeros where nothing was repeated."""
    deviations = []
    for repeats in _residuals(p, runs, noise):
        mean, count = np.mean(repeats, axis=0), len(repeats)
        scale = math.sqrt(BAND / dt * count / max(count - 1, 1))
        deviations.append([scale * (residual - mean) for residual in repeats])
    return _by_stroke(runs, deviations)


def _residuals(p: TrackedModel, runs: Sequence[Run], noise: Whitener) -> list[list[Array]]:
    """Effort (m,) of each run and repeat, not weighted by frequency."""
    flat = Whitener(noise.frequency, np.ones_like(noise.effort), np.zeros_like(noise.current))
    return [[residual[:, 0] for residual in repeats] for repeats in sensitivities.residuals_of(p, runs, flat)]


def _by_stroke(runs: Sequence[Run], signals: Sequence[Sequence[Array]]) -> StrokeSums:
    squares, samples = [], []
    for run, repeats in zip(runs, signals, strict=True):
        strokes = [run.cluster == number for number in np.unique(run.cluster)]
        for signal in repeats:
            squares += [float(((signal * run.weight)[stroke] ** 2).sum()) for stroke in strokes]
            samples += [float(run.weight[stroke].sum()) for stroke in strokes]
    return StrokeSums(np.array(squares), np.array(samples))
