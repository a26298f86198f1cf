"""Greedy sparse regression on the dictionary of the diagnosis, stopped by the Bayesian information criterion.

    BIC = n ln(S / n) + k ln n

with S the sum of squares left by k columns over n samples (Schwarz, Annals of Statistics 6(2), 1978).  The residual is
autocorrelated, so that n is far too large a number of independent samples: that is what this baseline shows.
"""

from collections.abc import Sequence

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, least_squares
from stagectl.gap.selection import refine
from stagectl.gap.selection.candidates import EffectValues, Form, equipped
from stagectl_studies.baselines.baseline_common import Answer, Ground, shifts

MOST = 10  # effects


def sparse(g: Ground) -> Answer:
    """The effects of the greedy path with the least BIC, and the model with their linear amplitudes."""
    e = g.evidence
    matrices = gram_matrices.fold_sums(g.library.products, e.base.after)
    whole, nuisance = matrices.both.sum(axis=0), matrices.places(refine.nuisances(e))
    n = 2.0 * sum(float(run.weight.sum()) * len(run.paths) for run in e.runs)
    chosen = greedy(whole, nuisance, [(form, matrices.places(form.names)) for form in g.library.forms], n)
    places = [place for form in chosen for place in matrices.places(form.names)]
    amplitude = least_squares.fit(whole, [*nuisance, *places]).amplitude
    moved = dict(zip(refine.nuisances(e), amplitude[: len(nuisance)].tolist(), strict=True))
    possible = {name: max(step, e.base.prior.bounds(e.base.model, name)[0]) for name, step in moved.items()}
    model = refine.moved(e, e.base.model, possible)
    rest, effects = amplitude[len(nuisance) :].tolist(), []
    for form in chosen:
        effects.append(EffectValues(form.effect, form.values([rest.pop(0) for _ in form.names])))
    return Answer(tuple(form.effect.name for form in chosen), equipped(model, effects).stage, shifts(g))


def greedy(whole: Array, nuisance: Sequence[int], forms: Sequence[tuple[Form, list[int]]], n: float) -> list[Form]:
    """Forms in the order of what they take, one of each effect, as long as the BIC falls."""
    chosen: list[Form] = []
    left = _without(whole, nuisance)
    while len(chosen) < MOST:
        taken = {form.effect.name for form in chosen}
        open_ = [(form, at) for form, at in forms if form.effect.name not in taken]
        drops = [_drop(left, at) for _, at in open_]
        best = int(np.argmax(drops))
        form, at = open_[best]
        if bic_of(left[-1, -1] - drops[best], n) + len(at) * np.log(n) >= bic_of(left[-1, -1], n):
            break
        chosen.append(form)
        left = _without(left, at)
    return chosen


def bic_of(squares: float, n: float) -> float:
    """The criterion's first term."""
    return float(n * np.log(max(squares, 1e-300) / n))


def _drop(left: Array, at: Sequence[int]) -> float:
    return (
        float(left[-1, -1] - least_squares.fit(left, at).residual_sum_of_squares)
        if np.all(np.diag(left)[list(at)] > 0.0)
        else 0.0
    )


def _without(whole: Array, at: Sequence[int]) -> Array:
    """The matrix with the columns `at` projected out."""
    places = list(at)
    inverse = least_squares.inverse(whole[np.ix_(places, places)])
    left: Array = whole - whole[:, places] @ inverse @ whole[places]
    return left
