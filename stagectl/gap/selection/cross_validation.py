"""What each effect would take from the gap that is left, on data that did not fit it.

All nuisances are projected out first, over all data: what they can take is theirs.  Then the half strokes are dealt
into two hands.  Amplitudes fitted on one are judged on the other, both ways; an effect's score is the smaller of the
two relative drops.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import least_squares
from stagectl.gap.residuals.gram_matrices import Grams, first_hand
from stagectl.gap.selection.candidates import Form


def hands(g: Grams, cut: Array) -> Array:
    """(2, p + 1, p + 1) of the matrices (c, p + 1, p + 1) of one cut: its half strokes, two by two in turn."""
    first = first_hand(g.stroke).astype(np.float64)
    return np.stack([np.tensordot(hand, cut, 1) for hand in (first, 1.0 - first)])


def cuts_of(g: Grams) -> Array:
    """(2, 2, p + 1, p + 1): the hands of the mechanics' cut and of the drive's."""
    return np.stack([hands(g, g.effort), hands(g, g.current)])


def against(g: Array, residual: int) -> Array:
    """`g` (..., p + 1, p + 1) with the column `residual` in the place of the residual."""
    order = [*range(g.shape[-1] - 1), residual]
    return g[..., order, :][..., :, order]


class Score(NamedTuple):
    """What one form would take."""

    form: Form
    gain: float  # of the sum of squares, judged on the other hand; both hands together
    worst: float  # the smaller relative drop of the two
    amplitudes: tuple[float, ...]  # from all data
    before: float  # sum of squares without it, free of what nuisances can take


def scores(cuts: Array, nuisance: Sequence[int], places: Sequence[Sequence[int]], forms: Sequence[Form]) -> list[Score]:
    """Every form's score on the hands of both `cuts` (2, 2, p + 1, p + 1), free of what the nuisances can take.

    An effect is judged by the cut that shows it: one of the drive by that of the drive, where a current is measured.
    """
    free = free_of(cuts, nuisance)
    return [score_of(free[cut_of(form, cuts)], at, form) for form, at in zip(forms, places, strict=True)]


def free_of(cuts: Array, nuisance: Sequence[int]) -> Array:
    """`cuts` with that of the mechanics free of what the nuisances can take.

    The time shift, which both cuts show, is the mechanics' to determine: the drive's cut stands as the base left it, or
    no dead time would be seen.
    """
    return np.stack([freed(cuts[0], nuisance), cuts[1]])


def best_of(found: Sequence[Score]) -> dict[str, Score]:
    """The best form of every effect."""
    best: dict[str, Score] = {}
    for score in found:
        name = score.form.effect.name
        if name not in best or score.gain > best[name].gain:
            best[name] = score
    return best


def cut_of(form: Form, cuts: Array) -> int:
    """Number of the cut that shows the effect of `form`."""
    return 1 if form.effect.block == "drive" and cuts[1].any() else 0


def freed(both: Array, nuisance: Sequence[int]) -> Array:
    """The hands (2, p + 1, p + 1) with every column and the residual less what nuisances explain of it on all data."""
    g, n = both.sum(axis=0), list(nuisance)
    a = g[np.ix_(n, n)] + np.diag(least_squares.RIDGE * g[n, n] + 1e-300)
    scale = np.sqrt(np.diag(a))
    scale = np.where(scale > 0.0, scale, 1.0)
    explained = np.linalg.pinv(a / np.outer(scale, scale), rcond=1e-10, hermitian=True) @ (g[n] / scale[:, None])
    explained = explained / scale[:, None]
    crossed = both[:, :, n] @ explained  # columns against what nuisances make of the others
    free: Array = both - crossed - np.swapaxes(crossed, 1, 2) + explained.T @ both[:, n][:, :, n] @ explained
    return free


def score_of(free: Array, at: Sequence[int], form: Form) -> Score:
    """The score of one form with its columns `at` on the hands (2, p + 1, p + 1) of its cut."""
    places = [*at, -1]
    hands, own = free[:, places][:, :, places], range(len(at))
    whole, before = _solved(hands.sum(axis=0), form), float(hands[:, -1, -1].sum())
    if not _admissible(form, whole):
        return Score(form, 0.0, 0.0, tuple(whole), before)
    drops = []
    for fitted, judged in ((0, 1), (1, 0)):
        amplitude = _solved(hands[fitted], form)
        alone = float(hands[judged, -1, -1])
        drops.append((alone - least_squares.misfit(hands[judged], own, amplitude), alone))
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
    found = b / a[0] if len(b) == 1 else np.linalg.lstsq(a, b, rcond=1e-12)[0]
    low, high = np.array([(one.low, one.high) for one in form.effect.amplitudes]).T
    return np.asarray(np.minimum(np.maximum(found, low), high), dtype=np.float64)


def _admissible(form: Form, amplitude: Array) -> bool:
    """Whether the sign is physical: an amplitude at a bound of zero explains nothing."""
    pairs = zip(form.effect.amplitudes, amplitude, strict=True)
    return all((one.low < 0.0 or x > 0.0) and (one.high > 0.0 or x < 0.0) for one, x in pairs)
