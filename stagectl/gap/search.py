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

from stagectl.gap import base, columns, grams, null, refine
from stagectl.gap.candidates import Form, Named
from stagectl.gap.columns import Direction
from stagectl.gap.grams import Grams
from stagectl.gap.refine import Evidence, Fitted
from stagectl.gap.scores import Score, against, hands, scores
from stagectl.gap.session import Array

MOST = 5  # effects that are looked for at once
MATERIAL = 0.03  # of the closable gap that is left, in the effect's own cut
OF_ALL = 0.01  # of the closable gap that the base refit left: less is the form of something else
ALONE = 0.1  # the same where nothing was repeated: there is no floor, and form error counts as gap
DOMINANT = 0.1  # relative drop from which an effect is judged by it alone
BEYOND = 1.5  # of the largest gain in the null ensemble: as far again as half of it
SMALLEST = 60.0  # gain in sums of squares of unit noise: what noise alone gives the best of many forms
RIVAL = 0.7  # of the largest gain: from there on another effect is refined, too, before one is chosen


class Threshold(NamedTuple):
    """What machines without an effect give one effect."""

    largest: float  # gain of the sum of squares
    limit: float  # gain beyond which it counts as found
    share: float  # largest relative drop that it gives on both hands; well beyond it counts as found, too


class Library(NamedTuple):
    """All candidates with their columns, and what the null ensemble gives them."""

    forms: tuple[Form, ...]
    columns: list[dict[str, list[Array]]]  # of each run
    thresholds: Mapping[str, Threshold]  # by effect
    first: tuple[float, float]  # closable misfit that the base refit left: of both cuts, of the drive's


class Selected(NamedTuple):
    """What the search found."""

    fitted: Fitted
    alternatives: Mapping[str, Mapping[str, float]]  # of each effect: gain of others in its place, relative to it
    gains: Mapping[str, float]  # of each effect when it alone is left out
    rivals: Mapping[str, Mapping[str, Named]]  # the same others, with their values


Say = Callable[[str], None]


def thresholds(g: Grams, nuisance: Sequence[int], forms: Sequence[Form]) -> dict[str, Threshold]:
    """The gains of every effect on every machine of the null ensemble, and the limit beyond them.

    The limit lies beyond the largest of them.
    """
    both, places = hands(g), [g.of(form.names) for form in forms]
    found: dict[str, list[tuple[float, float]]] = {}
    for name in null.gains(g.names):
        member = g.names.index(name)
        best = best_of(scores(against(both, member), nuisance, places, forms))
        for effect, score in best.items():
            found.setdefault(effect, []).append((max(score.gain, 1.0), score.worst))
    return {effect: _threshold(np.array(gains)) for effect, gains in found.items()}


def _threshold(found: Array) -> Threshold:
    gain, share = found.max(axis=0)
    return Threshold(float(gain), max(BEYOND * float(gain), SMALLEST), float(share))


def best_of(found: Sequence[Score]) -> dict[str, Score]:
    """The best form of every effect."""
    best: dict[str, Score] = {}
    for score in found:
        name = score.form.effect.name
        if name not in best or score.gain > best[name].gain:
            best[name] = score
    return best


def search(e: Evidence, library: Library, say: Say) -> Selected:
    """The effects that are in the data."""
    now, dropped = refine.start(e), frozenset[str]()
    while len(now.effects) < MOST:
        best = _next(e, library, now, dropped)
        if best is None:
            break
        say(f"added {best.effects[-1].effect.name}")
        now = _pruned(e, library, best, say)
        dropped |= {one.effect.name for one in best.effects} - {one.effect.name for one in now.effects}
    return _judged(e, library, now)


def _scored(e: Evidence, library: Library, now: Fitted) -> tuple[Grams, list[Score]]:
    """Every effect that is not in the model yet, on what is left."""
    own = refine.parameters(now)
    found = _joined(e, library, now, own)
    g = grams.grams(e.runs, found, now.left, base.START)
    nuisance = g.of([*nuisances(e), *(one.name for one in own)])
    taken = {one.effect.name for one in now.effects}
    forms = [form for form in library.forms if form.effect.name not in taken]
    return g, scores(hands(g), nuisance, [g.of(form.names) for form in forms], forms)


def nuisances(e: Evidence) -> list[str]:
    """What moves beside every candidate: the base's parameters, and the friction laws that may stand in for its own."""
    return [*refine.nuisances(e), *(one.name for one in e.base.directions if base.is_member(one.name))]


def _joined(e: Evidence, library: Library, now: Fitted, own: Sequence[Direction]) -> list[dict[str, list[Array]]]:
    new = columns.all_columns(now.equipped, e.runs, own, e.base.noise)
    parts = zip(e.base.columns, library.columns, new, strict=True)
    return [{**nuisance, **candidates, **mine} for nuisance, candidates, mine in parts]


def closable(g: Grams) -> tuple[float, float]:
    """Sum of squares left above what repeats differ by, of both cuts together and of the drive's alone."""
    effort, current = g.effort[:, -1, -1].sum(), g.current[:, -1, -1].sum()
    return float(effort + current - g.floor.sum()), float(current - g.floor[:, 1].sum())


def material(e: Evidence) -> float:
    """Share of what is left that an effect must take."""
    return MATERIAL if any(len(one) > 1 for one in e.deviations) else ALONE


def _eligible(e: Evidence, g: Grams, found: Sequence[Score], library: Library) -> list[Score]:
    left, good = closable(g), []
    for score in best_of(found).values():
        effect = score.form.effect
        cut = 1 if effect.block == "drive" else 0
        least = max(material(e) * left[cut], OF_ALL * library.first[cut])
        known = library.thresholds[effect.name]
        beyond = score.gain > known.limit or score.worst > max(BEYOND * known.share, DOMINANT)
        if beyond and score.gain > max(least, SMALLEST) and score.worst > 0.0:
            good.append(score)
    return sorted(good, key=lambda score: -score.gain)


def _next(e: Evidence, library: Library, now: Fitted, dropped: frozenset[str]) -> Fitted | None:
    """The model with one effect more, or None where no candidate is good enough; what was dropped does not return."""
    g, found = _scored(e, library, now)
    good = [score for score in _eligible(e, g, found, library) if score.form.effect.name not in dropped]
    if not good:
        return None
    rivals = [score for score in good if score.gain >= RIVAL * good[0].gain][:2]
    tried = [refine.refine(e, now.model, [*now.effects, named(score)]) for score in rivals]
    better = [one for one in tried if one.misfit < now.misfit]  # not so where it diverged
    return min(better, key=lambda one: one.misfit, default=None)


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
        if less.misfit - now.misfit < max(SMALLEST, material(e) * (less.misfit - floor(e))):
            say(f"dropped {one.effect.name}")
            return _pruned(e, library, less, say)
    return now


def floor(e: Evidence) -> float:
    """Sum of squares that repeats differ by."""
    repeats = [len(one) for one in e.deviations]
    pairs = zip(e.deviations, e.runs, repeats, strict=True)
    return sum(
        float(np.sum((one * run.weight[:, None]) ** 2)) * count / max(count - 1, 1)
        for each, run, count in pairs
        for one in each
    )


def _judged(e: Evidence, library: Library, now: Fitted) -> Selected:
    """Swap tests on every effect."""
    alternatives, gains, rivals = {}, {}, {}
    for one in now.effects:
        rest = tuple(other for other in now.effects if other is not one)
        less = Fitted(now.model, rest, refine.left(e, now.model, rest), 0.0)
        found = best_of(_scored(e, library, less)[1])
        own = found[one.effect.name].gain
        gains[one.effect.name] = own
        alternatives[one.effect.name] = {
            name: score.gain / own for name, score in found.items() if name != one.effect.name and own > 0.0
        }
        rivals[one.effect.name] = {name: named(score) for name, score in found.items() if score.gain > 0.0}
    return Selected(now, alternatives, gains, rivals)
