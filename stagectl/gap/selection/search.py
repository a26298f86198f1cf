"""The search: floating forward selection, each addition refitted with everything beside it.

::

    score all effects on what is left --> add the largest gain --> refine all values --> drop what is superfluous
            ^                                                                                   |
            +-----------------------------------------------------------------------------------+

Ranking is by gain, never by the ratio to a threshold.  What stops the search is the ensemble of machines without an
effect, and materiality against what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.effects.effect import Definition
from stagectl.gap.effects.library import EFFECTS, generalisations, kin
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.residuals.gram_matrices import Grams, Products
from stagectl.gap.selection import baseline_fit, candidates, null_ensemble, refine, stability_selection
from stagectl.gap.selection.candidates import Form, Named
from stagectl.gap.selection.cross_validation import Score, best_of, cuts_of, free_of, freed, scores
from stagectl.gap.selection.detection_thresholds import BEYOND, SMALLEST, Clarity, Threshold, clarity
from stagectl.gap.selection.refine import Evidence, Fitted

MOST = 5  # effects that are looked for at once
MATERIAL = 0.03  # of the closable gap that is left, in the effect's own cut
OF_ALL = 0.01  # of the closable gap that base refit and friction's laws left: less is the form of something else
OF_ALL_CLEAR = 0.001  # the same for a second, weaker effect that takes `DOMINANT` of what is left and is `FAR` above
FAR = 20.0  # times its limit
ALONE = 0.1  # the same where nothing was repeated: there is no floor, and form error counts as gap
DOMINANT = 0.1  # relative drop from which an effect is judged by it alone
VANISHING = 0.4  # share of resamples below which an effect is none
ADEQUATE = 0.57  # of what a function of one coordinate foretells: an effect that takes less is not what is there
OF_KIN = 0.25  # of what an effect took whose error of form looks like another one
OF_MORE = 0.3  # of all that is left, from which an effect is taken for a special case of a wider one
RIVAL = 0.7  # of the largest gain: from there on another effect is refined, too, before one is chosen


class Library(NamedTuple):
    """All candidates with their columns, and what the null ensemble gives them."""

    forms: tuple[Form, ...]
    products: Products  # of the base and the null ensemble, too
    thresholds: Mapping[str, Threshold]  # by effect
    resampled: int  # times for each experiment that is left out, to see whether an effect stays
    first: tuple[float, float]  # closable misfit that the base refit and friction's laws left: of mechanics, of drive
    measured: bool  # whether the logs hold the current beside the command


class Selected(NamedTuple):
    """What the search found."""

    fitted: Fitted
    alternatives: Mapping[str, Mapping[str, float]]  # of each effect: gain of others in its place, relative to it
    gains: Mapping[str, float]  # of each effect when it alone is left out
    rivals: Mapping[str, Mapping[str, Named]]  # the same others, with their values
    inclusion: Mapping[str, float]  # of each effect: share of resamples in which it is found again
    clarity: Mapping[str, Clarity]  # of each effect
    unexplained: float  # sum of squares above the floor that is left in the mechanics' cut, and that no nuisance takes


Say = Callable[[str], None]
Unknown = Callable[[Fitted], float]  # what the best function of one coordinate foretells of what is left


def search(e: Evidence, library: Library, say: Say, unknown: Unknown) -> Selected:
    """The effects that are in the data; it ends where a function of one coordinate foretells far more than the best."""
    now, forms = refine.start(e), library.forms
    taken: dict[str, float] = {}
    while len(now.effects) < MOST:
        best = _next(e, library._replace(forms=forms), now, taken)
        if best is None:
            break
        effect = best.effects[-1].effect
        if not _of_drive(effect, library) and _free(e, now) - _free(e, best) < ADEQUATE * unknown(now):
            forms = tuple(form for form in forms if _of_drive(form.effect, library))  # what it is, is in no library
            continue
        say(f"added {effect.name}")
        taken[effect.name] = now.misfit - best.misfit
        now = _pruned(e, library, best, say)
    return _stable(e, library, now, say)


def _stable(e: Evidence, library: Library, now: Fitted, say: Say) -> Selected:
    """What was found, without effects that vanish when the data are drawn again, and without an idle one.

    An idle one takes nothing beside the others, and hides what they take.
    """
    found = _judged(e, library, now)
    gone = [name for name, share in found.inclusion.items() if share < VANISHING]
    why = "in too few resamples"
    if not gone and len(now.effects) > 1:
        weakest = min(found.gains, key=found.gains.__getitem__)
        gone, why = [weakest] if found.gains[weakest] < SMALLEST else [], "idle beside the others"
    if not gone:
        return found
    say(f"dropped {', '.join(gone)}: {why}")
    stay = [one for one in now.effects if one.effect.name not in gone]
    return _stable(e, library, refine.refine(e, now.model, stay), say)


def _of_drive(effect: Definition, library: Library) -> bool:
    """Whether it is seen in the drive's cut."""
    return effect.block == "drive" and library.measured


def _free(e: Evidence, now: Fitted) -> float:
    """Sum of squares left in the mechanics' cut that no nuisance explains: what functions are fitted to."""
    own = sensitivities.all_columns(now.equipped, e.runs, refine.parameters(now), e.base.noise)
    g = gram_matrices.dealt(gram_matrices.beside(gram_matrices.only(e.base.products, nuisances(e)), own), now.left)
    return float(freed(cuts_of(g)[0], range(len(g.names)))[:, -1, -1].sum())


class Scored(NamedTuple):
    """Every effect that is not in a model yet, on what that leaves."""

    scores: list[Score]
    floor: Array  # (2,) what repeats differ by, of both cuts
    beside: list[str]  # columns that move beside every candidate
    products: Products
    left: list[list[Array]]

    def half_strokes(self, forms: Sequence[Form]) -> Grams:
        """The matrices of the half strokes, with what a verdict on `forms` asks."""
        own = dict.fromkeys(name for form in forms for name in form.names)
        return gram_matrices.grams(
            gram_matrices.only(self.products, [*self.beside, *null_ensemble.gains(self.products.names), *own]),
            self.left,
        )

    def clarity(self, forms: Sequence[Form]) -> Clarity:
        """How clear the effect of `forms` is."""
        g = self.half_strokes(forms)
        return clarity(g, g.of(self.beside), forms)


def scored(e: Evidence, library: Library, now: Fitted) -> Scored:
    """Every effect that is not in the model yet, on what is left."""
    own = refine.parameters(now)
    found = sensitivities.all_columns(now.equipped, e.runs, own, e.base.noise)
    products = gram_matrices.beside(library.products, found)
    g, beside = gram_matrices.dealt(products, now.left), [*nuisances(e), *(one.name for one in own)]
    taken = {one.effect.name for one in now.effects}
    forms = [form for form in library.forms if form.effect.name not in taken]
    each = scores(cuts_of(g), g.of(beside), [g.of(form.names) for form in forms], forms)
    return Scored(each, g.floor.sum(axis=0), beside, products, now.left)


def nuisances(e: Evidence) -> list[str]:
    """What moves beside every candidate: the base's parameters, and the friction laws that may stand in for its own."""
    return [*refine.nuisances(e), *(one.name for one in e.base.directions if baseline_fit.is_member(one.name))]


def closable(e: Evidence, g: Grams) -> tuple[float, float]:
    """Sum of squares left that no nuisance explains, above the floor of repeats: of the mechanics, of the drive."""
    free = free_of(cuts_of(g), g.of(nuisances(e)))
    effort, current = free[:, :, -1, -1].sum(axis=1) - g.floor.sum(axis=0)
    return float(effort), float(current)


def material(e: Evidence) -> float:
    """Share of what is left that an effect must take."""
    return MATERIAL if refine.repeated(e) else ALONE


def _eligible(e: Evidence, found: Scored, library: Library, now: Fitted) -> list[Score]:
    good = []
    # Across a gap the others' columns are not what they were: only what stands out is believed beside it.
    least = DOMINANT if any(one.effect.nonlinear for one in now.effects) else 0.0
    for score in best_of(found.scores).values():
        material = score.gain > _least(e, found, library, score) and score.worst > least
        if material and _beyond(found, library, score):
            good.append(score)
    return sorted(good, key=lambda score: -score.gain)


def _beyond(found: Scored, library: Library, score: Score) -> bool:
    """Whether it is more than machines without an effect give it, on all data or on one experiment."""
    known, forms = library.thresholds[_name(score)], _forms_of(library, _name(score))
    clear = score.gain > known.limit or score.worst > max(BEYOND * known.share, DOMINANT)
    return clear or found.clarity(forms).doubt < 1.0


def _forms_of(library: Library, name: str) -> list[Form]:
    return [form for form in library.forms if form.effect.name == name]


def _least(e: Evidence, found: Scored, library: Library, score: Score) -> float:
    """Sum of squares that an effect must take to be material: of what no nuisance explains, and of all there was."""
    cut = 1 if _of_drive(score.form.effect, library) else 0
    left = score.before - float(found.floor[cut])
    clear = score.worst > DOMINANT and score.gain > FAR * library.thresholds[_name(score)].limit
    return max(material(e) * left, (OF_ALL_CLEAR if clear else OF_ALL) * library.first[cut], SMALLEST)


def _next(e: Evidence, library: Library, now: Fitted, taken: Mapping[str, float]) -> Fitted | None:
    """The model with one effect more, or None where no candidate is good enough.

    `taken` holds what each effect took when it was added.  None of them returns that was dropped, and their kin must
    take more than an error of their form would.
    """
    found = scored(e, library, now)
    eligible = [score for score in _eligible(e, found, library, now) if _name(score) not in taken]
    good = [score for score in eligible if _stands_out(score, taken)]
    if not good:
        return None
    rivals = [score for score in good if score.gain >= RIVAL * good[0].gain]
    first = rivals[:2] + [one for one in rivals[2:] if _name(one) in generalisations(_name(rivals[0]))]
    tried = [(score, refine.refine(e, now.model, _joined(e, now, score))) for score in first]
    # What a simulation confirms counts, not what a linear estimate promised.
    better = [one for score, one in tried if now.misfit - one.misfit > _least(e, found, library, score)]
    return _simplest(better, refine.floor(e)) if better else None


def _joined(e: Evidence, now: Fitted, score: Score) -> list[Named]:
    """The effects with one more, which takes the place of the one that it is a wider form of, and its values."""
    under = next((one for one in now.effects if one.effect.name == EFFECTS[_name(score)].extends), None)
    if under is None:
        return [*now.effects, _begun(e, now, score)]
    wide = named(score)
    known = {name: value for name, value in under.values.items() if name in wide.values}
    return [*(one for one in now.effects if one is not under), Named(wide.effect, {**wide.values, **known})]


def _begun(e: Evidence, now: Fitted, score: Score) -> Named:
    """Where the fit of an effect begins: at its linear estimate, or at the best place on the grid of a resonance."""
    effect = score.form.effect
    if not effect.resonant:
        return named(score)
    places = [Named(effect, form.values(form.typical)) for form in candidates.forms([effect])]
    tried = [refine.refine(e, now.model, [*now.effects, one], 1) for one in places]
    settled = [one for one in tried if np.isfinite(one.misfit)]
    return min(settled, key=lambda one: one.misfit).effects[-1] if settled else named(score)


def _simplest(better: Sequence[Fitted], least: float) -> Fitted:
    """The best of them, or a special case of it that leaves little more above the floor `least`."""
    best = min(better, key=lambda one: one.misfit)
    wide = best.effects[-1].effect.name
    special = [one for one in better if one.effects[-1].effect.name in generalisations(wide)]
    return next((one for one in special if (1.0 - OF_KIN) * (one.misfit - least) < best.misfit - least), best)


def _stands_out(score: Score, taken: Mapping[str, float]) -> bool:
    """Whether it is more than the error of form of an effect that was added, or that effect with more to it."""
    more = EFFECTS[_name(score)].extends in taken
    resembling = max(_of_kin(_name(score), taken), default=0.0)
    return score.gain > OF_KIN * resembling or (more and score.worst > OF_MORE)


def _of_kin(name: str, taken: Mapping[str, float]) -> list[float]:
    return [gain for other, gain in taken.items() if other in kin(name)]


def _name(score: Score) -> str:
    return score.form.effect.name


def named(score: Score) -> Named:
    """The effect of a score, with its amplitudes."""
    return Named(score.form.effect, score.form.values(score.amplitudes))


def _pruned(e: Evidence, library: Library, now: Fitted, say: Say) -> Fitted:
    """`now` without the effects that another one has made superfluous."""
    if len(now.effects) < 2:
        return now
    for one in now.effects[:-1]:
        rest = [other for other in now.effects if other is not one]
        less = refine.refine(e, now.model, rest, 1)
        if less.misfit - now.misfit < max(SMALLEST, material(e) * (less.misfit - refine.floor(e))):
            say(f"dropped {one.effect.name}")
            return _pruned(e, library, less, say)
    return now


def _judged(e: Evidence, library: Library, now: Fitted) -> Selected:
    """Swap tests on every effect."""
    alternatives, gains, rivals, inclusion, clear = {}, {}, {}, {}, {}
    for one in now.effects:
        rest = tuple(other for other in now.effects if other is not one)
        less = Fitted(now.model, rest, refine.left(e, now.model, rest), 0.0)
        every, forms = scored(e, library, less), _forms_of(library, one.effect.name)
        found, g = best_of(every.scores), every.half_strokes(forms)
        inclusion[one.effect.name] = stability_selection.inclusion(
            g, g.of(every.beside), forms, OF_ALL, library.resampled
        )
        clear[one.effect.name] = clarity(g, g.of(every.beside), forms)
        own = found[one.effect.name].gain
        gains[one.effect.name] = own
        alternatives[one.effect.name] = {
            name: score.gain / own for name, score in found.items() if name != one.effect.name and own > 0.0
        }
        rivals[one.effect.name] = {name: named(score) for name, score in found.items() if score.gain > 0.0}
    left = _free(e, now) - float(gram_matrices.dealt(e.base.products, now.left).floor[:, 0].sum())
    return Selected(now, alternatives, gains, rivals, inclusion, clear, left)
