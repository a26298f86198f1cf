"""What each effect would explain of the remaining gap, on data that did not fit it.

All nuisances are partialled out first, over all data: what they can explain is theirs.  Then the half strokes are
sorted into two folds.  Amplitudes fitted on one are judged on the other, both ways; an effect's score is the smaller
of the two relative drops.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import least_squares
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.run_products import first_fold
from stagectl.gap.selection.candidates import Form
from stagectl.gap.selection.thresholds import SINGULAR, SINGULAR_FORM

EFFORT, CURRENT = 0, 1  # the channels of a residual


def folds(g: Grams, channel: Array) -> Array:
    """(2, p + 1, p + 1) sums of the matrices (c, p + 1, p + 1) of one channel over the two folds of half strokes."""
    first = first_fold(g.stroke).astype(np.float64)
    return np.stack([np.tensordot(fold, channel, 1) for fold in (first, 1.0 - first)])


def channels_of(g: Grams) -> Array:
    """(2, 2, p + 1, p + 1): the folds of the residual effort and of the missing current."""
    return np.stack([folds(g, g.effort), folds(g, g.current)])


def against(g: Array, residual: int) -> Array:
    """`g` (..., p + 1, p + 1) with the column `residual` in the place of the residual."""
    order = [*range(g.shape[-1] - 1), residual]
    return g[..., order, :][..., :, order]


class Score(NamedTuple):
    """What one form would explain."""

    form: Form
    gain: float  # of the sum of squares, judged on the other fold; both folds together
    worst: float  # the smaller relative drop of the two
    amplitudes: tuple[float, ...]  # from all data
    before: float  # sum of squares without the form, free of what nuisances explain


def scores(
    channels: Array, nuisance: Sequence[int], places: Sequence[Sequence[int]], forms: Sequence[Form]
) -> list[Score]:
    """Every form's score on the folds of both `channels` (2, 2, p + 1, p + 1), free of what the nuisances explain.

    An effect is judged by the channel that shows it: an effect of the drive by the missing current, where a current is
    measured.
    """
    free = without_nuisances(channels, nuisance)
    return [score_of(free[channel_of(form, channels)], own, form) for form, own in zip(forms, places, strict=True)]


def without_nuisances(channels: Array, nuisance: Sequence[int]) -> Array:
    """`channels` with the nuisances partialled out of the residual effort.

    The time shift shows in both channels and belongs to the mechanics.  The missing current stays as the baseline fit
    left it; otherwise no dead time would show.
    """
    return np.stack([partialled_out(channels[EFFORT], nuisance), channels[CURRENT]])


def best_of(of_forms: Sequence[Score]) -> dict[str, Score]:
    """The best form of every effect."""
    best: dict[str, Score] = {}
    for score in of_forms:
        name = score.form.effect.name
        if name not in best or score.gain > best[name].gain:
            best[name] = score
    return best


def channel_of(form: Form, channels: Array) -> int:
    """The channel that shows the effect of `form`."""
    return CURRENT if form.effect.block == "drive" and channels[CURRENT].any() else EFFORT


def partialled_out(both: Array, nuisance: Sequence[int]) -> Array:
    """The folds (2, p + 1, p + 1) with all columns and the residual less what the nuisances explain on all data."""
    g, n = both.sum(axis=0), list(nuisance)
    a = g[np.ix_(n, n)] + least_squares.ridge(g[n, n])
    scale = least_squares.column_lengths(a)
    explained = np.linalg.pinv(a / np.outer(scale, scale), rcond=SINGULAR, hermitian=True) @ (g[n] / scale[:, None])
    explained = explained / scale[:, None]
    crossed = both[:, :, n] @ explained  # columns against what nuisances make of the others
    free: Array = both - crossed - np.swapaxes(crossed, 1, 2) + explained.T @ both[:, n][:, :, n] @ explained
    return free


def score_of(free: Array, own: Sequence[int], form: Form) -> Score:
    """The score of one form with its columns `own` on the folds (2, p + 1, p + 1) of its channel."""
    places = [*own, -1]
    small, columns = free[:, places][:, :, places], range(len(own))
    whole, before = _solved(small.sum(axis=0), form), float(small[:, -1, -1].sum())
    if not _admissible(form, whole):
        return Score(form, 0.0, 0.0, tuple(whole), before)
    drops = []
    for fitted, judged in ((0, 1), (1, 0)):
        amplitude = _solved(small[fitted], form)
        alone = float(small[judged, -1, -1])
        drops.append((alone - least_squares.residual_sum_of_squares(small[judged], columns, amplitude), alone))
    gain = sum(drop for drop, _ in drops)
    worst = min(drop / max(alone, 1e-300) for drop, alone in drops)
    return Score(form, gain, worst, tuple(whole), before)


def _solved(matrix: Array, form: Form) -> Array:
    """Amplitudes (k,) within their bounds, of the form's columns and the residual in `matrix` (k + 1, k + 1)."""
    if form.effect.nonlinear:
        return np.array(form.typical)
    a, b = matrix[:-1, :-1], matrix[:-1, -1]
    if not np.all(np.diag(a) > 0.0):
        return np.zeros(len(b))
    solved = b / a[0] if len(b) == 1 else np.linalg.lstsq(a, b, rcond=SINGULAR_FORM)[0]
    low, high = np.array([(amplitude.low, amplitude.high) for amplitude in form.effect.amplitudes]).T
    return np.asarray(np.minimum(np.maximum(solved, low), high), dtype=np.float64)


def _admissible(form: Form, values: Array) -> bool:
    """Whether the sign is physical: an amplitude at a bound of zero explains nothing."""
    bounds = zip(form.effect.amplitudes, values, strict=True)
    return all((bound.low < 0.0 or value > 0.0) and (bound.high > 0.0 or value < 0.0) for bound, value in bounds)
