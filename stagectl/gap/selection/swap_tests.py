"""Each selected effect taken out in turn: what it explains, what would replace it, how often it is found again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.run_products import first_fold
from stagectl.gap.selection import refine
from stagectl.gap.selection.candidate_scores import Library, effect_of, scored, unexplained_effort
from stagectl.gap.selection.candidates import EffectValues, Form
from stagectl.gap.selection.cross_validation import best_of, channel_of, scores
from stagectl.gap.selection.detection_thresholds import Clarity, clarity
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.thresholds import EXCITED, OF_ALL


class Selection(NamedTuple):
    """The effects that the search selected, and how well each of them is established."""

    fitted: Fitted
    alternatives: dict[str, dict[str, float]]  # of each effect: gain of others in its place, relative to its own
    gains: dict[str, float]  # of each effect when it alone is left out
    rivals: dict[str, dict[str, EffectValues]]  # the same others, with their values
    inclusion: dict[str, float]  # of each effect: share of resamples in which it is found again
    clarity: dict[str, Clarity]  # of each effect
    unexplained: float  # sum of squares of the residual effort above the floor that no nuisance explains


def swap_tests(e: Evidence, library: Library, now: Fitted) -> Selection:
    """Every effect of `now` taken out in turn."""
    floor = float(gram_matrices.fold_sums(e.base.products, now.residuals).floor[:, 0].sum())
    selection = Selection(now, {}, {}, {}, {}, {}, unexplained_effort(e, now) - floor)
    for valued in now.effects:
        _swap(e, library, valued, selection)
    return selection


def _swap(e: Evidence, library: Library, valued: EffectValues, selection: Selection) -> None:
    """Enter in `selection` what the others would explain in the place of one effect."""
    now, name = selection.fitted, valued.effect.name
    rest = tuple(other for other in now.effects if other is not valued)
    every = scored(e, library, Fitted(now.model, rest, refine.residuals(e, now.model, rest), 0.0))
    best, forms = best_of(every.scores), library.forms_of(name)
    g, gain = every.half_strokes(forms), best[name].gain
    moving = g.places(every.moving)
    others = {other: score for other, score in best.items() if other != name and gain > 0.0}
    selection.alternatives[name] = {other: score.gain / gain for other, score in others.items()}
    selection.gains[name] = gain
    selection.rivals[name] = {other: effect_of(score) for other, score in best.items() if score.gain > 0.0}
    selection.inclusion[name] = inclusion(g, moving, forms, OF_ALL, library.resampled)
    selection.clarity[name] = clarity(g, moving, forms)


def inclusion(g: Grams, nuisance: Sequence[int], forms: Sequence[Form], share: float, times: int) -> float:
    """Share of the resamples in which a form of one effect explains more than `share` of what the nuisances leave.

    `times` resamples for each experiment that is left out; the effect is not in the model whose residual `g` holds.
    An effect that only one experiment or a few half strokes carry is a property of these and not of the machine.
    Experiments that do not excite it at all say nothing on it.

    Source: N. Meinshausen, P. Bühlmann, Stability selection, J. R. Statist. Soc. B 72(4), 2010; here with a bootstrap.
    """
    places = [*nuisance, *sorted({place for form in forms for place in g.places(form.names)}), len(g.names)]
    small = np.stack([channel[:, places][:, :, places] for channel in (g.effort, g.current)])
    channel = channel_of(forms[0], small)
    position = {place: k for k, place in enumerate(places)}
    own = [[position[place] for place in g.places(form.names)] for form in forms]
    energy = [small[channel][:, k, k] for k in {place for columns in own for place in columns}]
    first, resamples = first_fold(g.stroke), np.array(_resamples(g, times))
    sums = np.tensordot(np.stack([resamples * first, resamples * ~first], axis=1), small, (2, 1))  # (r, fold, channel)
    included = []
    for counts, fold_sums in zip(resamples, sums, strict=True):
        if not any(counts @ column > EXCITED * column.sum() for column in energy):
            continue
        both = np.swapaxes(fold_sums, 0, 1)
        best = max(scores(both, range(len(nuisance)), own, forms), key=lambda score: score.gain)
        # Without the effect the base stays where it is with it: what the base would take back does not remain.
        included.append(best.gain > share * (best.before - float(counts @ g.floor[:, channel])))
    return float(np.mean(included)) if included else 0.0


def _resamples(g: Grams, times: int) -> list[Array]:
    """How often each half stroke (c,) counts, in each resample."""
    source = np.random.default_rng(0)
    resamples = []
    for left_out in np.unique(g.experiment):
        kept = np.flatnonzero(g.experiment != left_out) if np.ptp(g.experiment) else np.arange(len(g.experiment))
        for _ in range(times):
            drawn = source.choice(kept, len(kept))
            resamples.append(np.bincount(drawn, minlength=len(g.experiment)).astype(np.float64))
    return resamples
