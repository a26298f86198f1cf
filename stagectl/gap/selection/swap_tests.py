"""Each selected effect taken out in turn: what it explains, what would replace it, how often it is found again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from stagectl.gap.residuals import gram_matrices
from stagectl.gap.selection import refine, stability_selection
from stagectl.gap.selection.candidate_scores import Library, effect_of, scored, unexplained_effort
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.cross_validation import best_of
from stagectl.gap.selection.detection_thresholds import Clarity, clarity
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.thresholds import OF_ALL


class Selection(NamedTuple):
    """The effects that the search selected, and how well each of them is established."""

    fitted: Fitted
    alternatives: Mapping[str, Mapping[str, float]]  # of each effect: gain of others in its place, relative to its own
    gains: Mapping[str, float]  # of each effect when it alone is left out
    rivals: Mapping[str, Mapping[str, EffectValues]]  # the same others, with their values
    inclusion: Mapping[str, float]  # of each effect: share of resamples in which it is found again
    clarity: Mapping[str, Clarity]  # of each effect
    unexplained: float  # sum of squares of the residual effort above the floor that no nuisance explains


class _Swap(NamedTuple):
    """What the others would explain in the place of one effect."""

    alternatives: Mapping[str, float]
    gain: float
    rivals: Mapping[str, EffectValues]
    inclusion: float
    clarity: Clarity


def swap_tests(e: Evidence, library: Library, now: Fitted) -> Selection:
    """Every effect of `now` taken out in turn."""
    swaps = {valued.effect.name: _swap(e, library, now, valued) for valued in now.effects}
    floor = float(gram_matrices.fold_sums(e.base.products, now.residuals).floor[:, 0].sum())
    return Selection(
        now,
        {name: swap.alternatives for name, swap in swaps.items()},
        {name: swap.gain for name, swap in swaps.items()},
        {name: swap.rivals for name, swap in swaps.items()},
        {name: swap.inclusion for name, swap in swaps.items()},
        {name: swap.clarity for name, swap in swaps.items()},
        unexplained_effort(e, now) - floor,
    )


def _swap(e: Evidence, library: Library, now: Fitted, valued: EffectValues) -> _Swap:
    name, rest = valued.effect.name, tuple(other for other in now.effects if other is not valued)
    every = scored(e, library, Fitted(now.model, rest, refine.residuals(e, now.model, rest), 0.0))
    best, forms = best_of(every.scores), library.forms_of(name)
    g, gain = every.half_strokes(forms), best[name].gain
    moving = g.places(every.moving)
    return _Swap(
        {other: score.gain / gain for other, score in best.items() if other != name and gain > 0.0},
        gain,
        {other: effect_of(score) for other, score in best.items() if score.gain > 0.0},
        stability_selection.inclusion(g, moving, forms, OF_ALL, library.resampled),
        clarity(g, moving, forms),
    )
