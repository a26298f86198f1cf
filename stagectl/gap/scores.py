"""What each effect would take from the gap that is left, on data that did not fit it.

The half strokes are dealt into two hands.  Amplitudes fitted on one are judged on the other, both ways, with all
nuisances refitted each time; an effect's score is the smaller of the two relative drops.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap import grams
from stagectl.gap.candidates import Form
from stagectl.gap.grams import Grams
from stagectl.gap.session import Array


def hands(g: Grams) -> Array:
    """(2, p + 1, p + 1): even and odd half strokes of every experiment; repeats go with their half stroke."""
    both, even = g.both, g.stroke % 4 < 2  # two by two: there and back stay together
    return np.stack([both[even].sum(axis=0), both[~even].sum(axis=0)])


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


def scores(both: Array, nuisance: Sequence[int], places: Sequence[Sequence[int]], forms: Sequence[Form]) -> list[Score]:
    """Every form's score on the two hands `both`, the nuisances refitted beside it."""
    whole = both.sum(axis=0)
    reduced = [_reduced(hand, nuisance) for hand in (both[0], both[1], whole)]
    return [_score(both, reduced, (list(nuisance), list(at)), form) for form, at in zip(forms, places, strict=True)]


class _Reduced(NamedTuple):
    """A summed matrix with the nuisances projected out (Schur complement)."""

    matrix: Array  # (p + 1, p + 1)
    coefficients: Array  # (n, p + 1) of the nuisances for every column


def _reduced(g: Array, nuisance: Sequence[int]) -> _Reduced:
    n = list(nuisance)
    a = g[np.ix_(n, n)] + np.diag(grams.RIDGE * g[n, n] + 1e-300)
    scale = np.sqrt(np.diag(a))
    scale = np.where(scale > 0.0, scale, 1.0)
    coefficients = np.linalg.pinv(a / np.outer(scale, scale), rcond=1e-10, hermitian=True) @ (g[n] / scale[:, None])
    coefficients = coefficients / scale[:, None]
    return _Reduced(g - g[:, n] @ coefficients, coefficients)


def _score(both: Array, reduced: Sequence[_Reduced], places: tuple[list[int], list[int]], form: Form) -> Score:
    nuisance, at = places
    whole = _solved(reduced[2].matrix, at, form)
    if not _admissible(form, whole):
        return Score(form, 0.0, 0.0, tuple(whole))
    drops = []
    for fitted, judged in ((0, 1), (1, 0)):
        amplitude = _solved(reduced[fitted].matrix, at, form)
        # Nuisances as the fitted hand has them, with and without the effect.
        plain = -reduced[fitted].coefficients[:, -1]
        beside = plain + reduced[fitted].coefficients[:, at] @ amplitude
        before = grams.misfit(both[judged], nuisance, -plain)
        after = grams.misfit(both[judged], [*nuisance, *at], np.concatenate([-beside, amplitude]))
        drops.append((before - after, before))
    gain = sum(drop for drop, _ in drops)
    worst = min(drop / before for drop, before in drops)
    return Score(form, gain, worst, tuple(whole))


def _solved(matrix: Array, at: Sequence[int], form: Form) -> Array:
    if form.effect.bent:
        return np.array(form.typical)
    a = matrix[np.ix_(list(at), list(at))]
    if not np.all(np.diag(a) > 0.0):
        return np.zeros(len(at))
    return np.asarray(np.linalg.lstsq(a, matrix[list(at), -1], rcond=1e-12)[0], dtype=np.float64)


def _admissible(form: Form, amplitude: Array) -> bool:
    """Whether the sign and the size are physical: an amplitude against its bound explains nothing."""
    pairs = zip(form.effect.amplitudes, amplitude, strict=True)
    return all((one.low < 0.0 or x > 0.0) and (one.high > 0.0 or x < 0.0) for one, x in pairs)
