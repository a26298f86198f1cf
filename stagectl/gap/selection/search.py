"""The search: floating forward selection, each addition refitted together with everything else.

::

    score all effects on the residuals --> add the largest gain --> refine all values --> drop what is superfluous
            ^                                                                                   |
            +-----------------------------------------------------------------------------------+

Effects are ranked by gain, never by the ratio to a threshold.  The search stops where no candidate exceeds the
ensemble of machines without an effect, or none is material for what is left.

Source: P. Pudil, J. Novovičová, J. Kittler, Floating search methods in feature selection, Pattern Recognition Letters
15(11), 1994.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from stagectl.gap.effects.library import EFFECTS, generalisations, kin
from stagectl.gap.selection import candidates, refine, thresholds
from stagectl.gap.selection.candidate_scores import (
    CandidateScores,
    Library,
    effect_of,
    name_of,
    scored,
    unexplained_effort,
)
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.cross_validation import CURRENT, Score, best_of
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.swap_tests import Selection, swap_tests
from stagectl.gap.selection.thresholds import ADEQUATE, MOST_EFFECTS, RIVAL, SMALLEST_GAIN, VANISHING

Say = Callable[[str], None]
Predictable = Callable[[Fitted], float]  # sum of squares that the best function of one coordinate predicts


def search(e: Evidence, library: Library, say: Say, predictable: Predictable) -> Selection:
    """The effects that are in the data; `say` reports what is added and dropped.

    Mechanical effects end where a function of one coordinate predicts far more of the residuals than the best of them
    explains: the cause is not in the library then.
    """
    now, forms = refine.start(e), library.forms
    gains: dict[str, float] = {}
    while len(now.effects) < MOST_EFFECTS:
        best = _next(e, library._replace(forms=forms), now, gains)
        if best is None:
            break
        effect = best.effects[-1].effect
        mechanical = library.channel(effect) != CURRENT
        if mechanical and unexplained_effort(e, now) - unexplained_effort(e, best) < ADEQUATE * predictable(now):
            forms = tuple(form for form in forms if library.channel(form.effect) == CURRENT)
            continue
        say(f"added {effect.name}")
        gains[effect.name] = now.residual_sum_of_squares - best.residual_sum_of_squares
        now = _pruned(e, library, best, say)
    return _stable(e, library, now, say)


def _stable(e: Evidence, library: Library, now: Fitted, say: Say) -> Selection:
    """The selection without effects that vanish when the data are resampled, and without one that adds nothing.

    Such an effect explains nothing next to the others, and hides what they explain.
    """
    selection = swap_tests(e, library, now)
    dropped = [name for name, share in selection.inclusion.items() if share < VANISHING]
    why = "in too few resamples"
    if not dropped and len(now.effects) > 1:
        weakest = min(selection.gains, key=selection.gains.__getitem__)
        dropped, why = [weakest] if selection.gains[weakest] < SMALLEST_GAIN else [], "adds nothing to the others"
    if not dropped:
        return selection
    say(f"dropped {', '.join(dropped)}: {why}")
    kept = [valued for valued in now.effects if valued.effect.name not in dropped]
    return _stable(e, library, refine.refine(e, now.model, kept), say)


def _next(e: Evidence, library: Library, now: Fitted, gains: Mapping[str, float]) -> Fitted | None:
    """The model with one effect more, or None where no candidate is good enough.

    `gains` holds what each effect explained when it was added.  An effect that was dropped does not return, and
    similar effects must explain more than an error of its form would.
    """
    ranked = scored(e, library, now)
    possible = [score for score in eligible(e, ranked, library, now) if name_of(score) not in gains]
    good = [score for score in possible if stands_out(score, gains)]
    if not good:
        return None
    rivals = [score for score in good if score.gain >= RIVAL * good[0].gain]
    special = [score for score in rivals[2:] if name_of(rivals[0]) in generalisations(name_of(score))]
    refined = [(score, refine.refine(e, now.model, _joined(e, now, score))) for score in rivals[:2] + special]
    # What a simulation confirms counts, not what a linear estimate promised.
    before = now.residual_sum_of_squares
    better = [
        after
        for score, after in refined
        if before - after.residual_sum_of_squares > least_gain(e, ranked, library, score)
    ]
    return simplest(better, refine.floor(e)) if better else None


def _joined(e: Evidence, now: Fitted, score: Score) -> list[EffectValues]:
    """The effects with one more; a wider form of a present effect takes its place and its values."""
    narrow = EFFECTS[name_of(score)].extends
    present = next((valued for valued in now.effects if valued.effect.name == narrow), None)
    if present is None:
        return [*now.effects, _initial(e, now, score)]
    wide = effect_of(score)
    known = {name: value for name, value in present.values.items() if name in wide.values}
    others = [valued for valued in now.effects if valued is not present]
    return [*others, EffectValues(wide.effect, {**wide.values, **known})]


def _initial(e: Evidence, now: Fitted, score: Score) -> EffectValues:
    """Initial values of an effect: its linear estimate, or the best place on the grid of a resonance."""
    effect = score.form.effect
    if not effect.resonant:
        return effect_of(score)
    places = [EffectValues(effect, form.values(form.typical)) for form in candidates.forms([effect])]
    refined = [refine.refine(e, now.model, [*now.effects, place], 1) for place in places]
    finite = [fitted for fitted in refined if np.isfinite(fitted.residual_sum_of_squares)]
    return min(finite, key=lambda fitted: fitted.residual_sum_of_squares).effects[-1] if finite else effect_of(score)


def _pruned(e: Evidence, library: Library, now: Fitted, say: Say) -> Fitted:
    """`now` without the effects that another one has made superfluous."""
    if len(now.effects) < 2:
        return now
    for valued in now.effects[:-1]:
        rest = [other for other in now.effects if other is not valued]
        less = refine.refine(e, now.model, rest, 1)
        left = less.residual_sum_of_squares
        if left - now.residual_sum_of_squares < max(SMALLEST_GAIN, material(e) * (left - refine.floor(e))):
            say(f"dropped {valued.effect.name}")
            return _pruned(e, library, less, say)
    return now


def material(e: Evidence) -> float:
    """Share of the rest that an effect must explain."""
    return thresholds.MATERIAL if refine.repeated(e) else thresholds.MATERIAL_UNREPEATED


def eligible(e: Evidence, ranked: CandidateScores, library: Library, now: Fitted) -> list[Score]:
    """The best form of each effect that is material and beyond the null ensemble, largest gain first."""
    # Across a gap the other columns change: next to a nonlinear effect, only a dominant one is accepted.
    worst = thresholds.DOMINANT if any(valued.effect.nonlinear for valued in now.effects) else 0.0
    good = [
        score
        for score in best_of(ranked.scores).values()
        if score.gain > least_gain(e, ranked, library, score)
        and score.worst > worst
        and _beyond_null(ranked, library, score)
    ]
    return sorted(good, key=lambda score: -score.gain)


def _beyond_null(ranked: CandidateScores, library: Library, score: Score) -> bool:
    """Whether machines without an effect give less, on all data or on one experiment."""
    known = library.thresholds[name_of(score)]
    clear = score.gain > known.limit or score.worst > max(thresholds.BEYOND * known.share, thresholds.DOMINANT)
    return clear or ranked.clarity(library.forms_of(name_of(score))).doubt < 1.0


def least_gain(e: Evidence, ranked: CandidateScores, library: Library, score: Score) -> float:
    """Gain that makes an effect material: of what no nuisance explains now, and of the gap at the beginning."""
    channel = library.channel(score.form.effect)
    left = score.before - float(ranked.floor[channel])
    clear = score.worst > thresholds.DOMINANT and score.gain > thresholds.FAR * library.thresholds[name_of(score)].limit
    of_all = thresholds.OF_ALL_CLEAR if clear else thresholds.OF_ALL
    return max(material(e) * left, of_all * library.first[channel], thresholds.SMALLEST_GAIN)


def stands_out(score: Score, gains: Mapping[str, float]) -> bool:
    """Whether it is more than the error of form of an effect that was added, or a wider form of that effect.

    `gains` holds what each effect explained when it was added.
    """
    wider = EFFECTS[name_of(score)].extends in gains
    similar = kin(name_of(score))
    resembling = max((gain for other, gain in gains.items() if other in similar), default=0.0)
    return score.gain > thresholds.OF_KIN * resembling or (wider and score.worst > thresholds.OF_MORE)


def simplest(better: Sequence[Fitted], floor: float) -> Fitted:
    """The best of these models, or a special case of it that leaves little more above `floor`."""
    best = min(better, key=lambda fitted: fitted.residual_sum_of_squares)
    wide = best.effects[-1].effect.name
    special = [model for model in better if wide in generalisations(model.effects[-1].effect.name)]
    left = best.residual_sum_of_squares - floor
    return next(
        (model for model in special if (1.0 - thresholds.OF_KIN) * (model.residual_sum_of_squares - floor) < left), best
    )
