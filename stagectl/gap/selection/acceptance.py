"""Which candidates the search may add: clear of the null ensemble, material, and more than an error of form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stagectl.gap.effects.library import EFFECTS, generalisations, kin
from stagectl.gap.selection import refine, thresholds
from stagectl.gap.selection.candidate_scores import CandidateScores, Library, name_of
from stagectl.gap.selection.cross_validation import Score, best_of
from stagectl.gap.selection.refine import Evidence, Fitted


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
    resembling = max(_gains_of_kin(name_of(score), gains), default=0.0)
    return score.gain > thresholds.OF_KIN * resembling or (wider and score.worst > thresholds.OF_MORE)


def _gains_of_kin(name: str, gains: Mapping[str, float]) -> list[float]:
    return [gain for other, gain in gains.items() if other in kin(name)]


def simplest(better: Sequence[Fitted], floor: float) -> Fitted:
    """The best of these models, or a special case of it that leaves little more above `floor`."""
    best = min(better, key=lambda fitted: fitted.residual_sum_of_squares)
    wide = best.effects[-1].effect.name
    special = [model for model in better if wide in generalisations(model.effects[-1].effect.name)]
    left = best.residual_sum_of_squares - floor
    return next(
        (model for model in special if (1.0 - thresholds.OF_KIN) * (model.residual_sum_of_squares - floor) < left), best
    )
