"""The effects that are in the data: the evidence compared, the best set refined by simulation, and compared again.

::

    linearise at the model --> compare sets of effects --> refine the best set by simulation --+
            ^                                                                                  |
            +-------------------- while the set grows, and the fit confirms it <---------------+

Then every effect is taken out in turn and compared with all others in its place: its probability, its rivals.

Every machine has a trace of everything, so that a small effect is no finding.  But where something is missing that
repeats and has an order, what explains it is no trace, however small it is: nothing is called unknown before.
"""

import functools
from collections.abc import Mapping, Sequence, Set

from stagectl.gap.effects.effect import DRIVE
from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.selection import bristle_shape, constants, drive_alikes, linearised, refine, waves
from stagectl.gap.selection.candidates import EffectValues, bends, joined
from stagectl.gap.selection.established import Say, Selection, established, preferred, vanishes
from stagectl.gap.selection.linearised import Cuts, Library, Linearised
from stagectl.gap.selection.material import adequate, at_bound, explainable, explains, explains_most, refitted_without
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.starting_places import Starts, starting_places


def select(e: Evidence, library: Library, say: Say) -> Selection:
    """The effects that are in the data; `say` reports what is added and dropped.

    Mechanical effects end where a function of one coordinate predicts far more of the residuals than the best set of
    them explains: the evidence compares what the library holds, and the cause is not in it then.  Nor is an effect the
    cause that would explain more with a value that no machine has: the search goes on without it.
    """
    return select_from(e, library, refine.start(e), say)


def select_from(e: Evidence, library: Library, now: Fitted, say: Say) -> Selection:
    """The same from a model `now` on, whose effects may be dropped again.

    One that is dropped, or replaced, may have stood in the place of others: next to those that stay, these are looked
    for once more.
    """
    whole = _grown_whole(e, library, now, say)
    found = established(e, library, whole, say)
    gone = {valued.effect.name for valued in _added(found.fitted, whole)}
    if not gone:
        return found
    wider = _grown_whole(e, _other_than(library, gone, found, now, whole), found.fitted, say)
    more = found if wider is found.fitted else established(e, library, wider, say)
    return max(found, more, key=lambda s: (len(s.fitted.effects), -s.fitted.residual_sum_of_squares))


def _other_than(library: Library, gone: Set[str], found: Selection, now: Fitted, whole: Fitted) -> Library:
    """The library for a second search: without what is `gone`, where that search would find it again.

    Next to another effect, or without one of several that went one after the other, it may stand.
    """
    replaced, stays = _added(whole, found.fitted), _added(now, found.fitted)
    again = not replaced and (len(gone) == 1 or not stays)
    return drive_alikes.without_effects(library, gone) if again else library


def _grown_whole(e: Evidence, library: Library, now: Fitted, say: Say) -> Fitted:
    """`now` with everything that joins it."""
    while len(now.effects) < constants.MOST_EFFECTS:
        now = drive_alikes.on_time(e, library, now)  # each time: what else is missing may hide it
        tried = functools.cache(functools.partial(starting_places, e, library, now))
        after = (
            _with_more(e, library, now, tried)
            or _with_small(e, library, now, tried)
            or waves.with_wave(e, library, now)
            or _with_bent(e, library, now, tried)
        )
        if after is None:
            break
        if beyond := {valued.effect.name for valued in after.effects if at_bound(valued)}:
            library, now = drive_alikes.without_effects(library, beyond), refitted_without(e, now, beyond)
            continue
        after = bristle_shape.beside_effects(e, preferred(e, library, after))
        say(f"added {', '.join(valued.effect.name for valued in _added(now, after))}")
        now = after
    return now


def _with_more(e: Evidence, library: Library, now: Fitted, tried: Starts) -> Fitted | None:
    """`now` with the most probable set of effects, or with the next that holds it; None where none stands."""
    at = linearised.linearised(e, library, now)
    sets = _and_wider(at.verdict.of_sets())
    for effects in sets:
        added = at.values(at.verdict.best(effects))
        starts = _if_bent(added, tried)
        after = _first_of(e, now, added, starts, _grown(e, now, added, starts))
        standing = None if after is None else _that_stands(e, library, now, after)
        if standing is not None:
            return standing
    added = at.values(at.verdict.best(sets[0]))
    drive = [valued for valued in added if valued.effect.block == DRIVE]
    return _grown(e, now, drive, _if_bent(drive, tried)) if len(drive) < len(added) else None


def _and_wider(sets: Mapping[frozenset[str], float]) -> list[frozenset[str]]:
    """The first of the `sets`, the most probable one, and those that hold it and more and are comparable with it.

    Of what explains a little, much may be left that a second effect explains; where several explain it about as well,
    they share its probability, and the set without any of them is the most probable one.
    """
    best, *others = sets
    least = constants.COMPARABLE * sets[best]
    return [best, *(item for item in others if best and best < item and sets[item] >= least)]


def _that_stands(e: Evidence, library: Library, now: Fitted, after: Fitted) -> Fitted | None:
    """`after`, or else with a wave more or more of its wave, where that stands against functions.

    One harmonic of a wave leaves the others, which a function of the place predicts.
    """
    if _stands_against_functions(e, library, now, after):
        return after
    waving = waves.with_wave(e, library, after)
    return waving if waving is not None and _stands_against_functions(e, library, now, waving) else None


def _stands_against_functions(e: Evidence, library: Library, now: Fitted, after: Fitted) -> bool:
    """Whether the mechanics that `after` adds to `now` explain about as much as any function of one coordinate.

    They may leave more than the function does, by an error of their form, or what no function predicts.  What leaves a
    function as much to predict as before is no rival of it: both are missing.  Next to a function they have to explain
    most of what it leaves, unless they drift: a smaller part may be the function's own error of form, which repeats.
    """
    predicted, added = library.predict(e, now), _added(now, after)
    may_be_form = e.beside is not None and not any(valued.effect.time_variation for valued in added)
    if all(valued.effect.block == DRIVE for valued in added) or not (may_be_form or predicted.cuts[0]):
        return True
    beyond = library.predict(e, after).cuts[0]
    if e.beside is None and beyond >= (1.0 - constants.FORM) * predicted.cuts[0]:
        return True
    before, left = (linearised.excess(e, library, fitted)[0] for fitted in (now, after))
    if not adequate(before, left, before if may_be_form else predicted.cuts[0]):
        return False
    if left <= constants.FORM * before or left <= constants.OUTDONE * (1.0 - predicted.share) * before:
        return True
    return not beyond


def _added(now: Fitted, after: Fitted) -> list[EffectValues]:
    """The effects of `after` that `now` does not have."""
    present = {valued.effect.name for valued in now.effects}
    return [valued for valued in after.effects if valued.effect.name not in present]


def _first_of(
    e: Evidence,
    now: Fitted,
    added: Sequence[EffectValues],
    starts: Sequence[EffectValues],
    together: Fitted | None,
) -> Fitted | None:
    """`now` with the one effect of `added` that explains nearly all that they explain `together`; else with all.

    A large effect bends: around the model without it, several small ones together look more like it than its column.
    """
    if together is None or len(added) < 2:
        return together
    single = [fitted for fitted in (_grown(e, now, [valued], starts) for valued in added) if fitted is not None]
    best = min(single, key=lambda fitted: fitted.residual_sum_of_squares, default=together)
    gain, lost = (a.residual_sum_of_squares - together.residual_sum_of_squares for a in (now, best))
    return best if lost <= constants.ONE_OF_MANY * gain else together


def _with_small(e: Evidence, library: Library, now: Fitted, tried: Starts) -> Fitted | None:
    """`now` with effects of whatever size that explain most of what is missing; None where nothing is or does.

    Two may be missing, each about as much: either alone explains too little, so the most probable set comes first.  Its
    effects of the drive may explain the missing current, whatever is missing in the mechanics.
    """
    at = linearised.linearised(e, library, now, traces=False)
    sets, predicted = at.verdict.of_sets(), library.predict(e, now).cuts
    best, single = next(iter(sets)), next((item for item in sets if len(item) == 1), frozenset[str]())
    drive = frozenset(name for name in best if EFFECTS[name].block == DRIVE)
    for effects in dict.fromkeys((best, single, drive)):
        fitted = _fitted(e, now, at, effects, predicted, tried) if sets.get(effects, 0.0) > at.empty else None
        if fitted is not None and _explain(e, library, now, fitted, at, predicted):
            return _that_stands(e, library, now, fitted)
    return None


def _with_bent(e: Evidence, library: Library, now: Fitted, tried: Starts) -> Fitted | None:
    """`now` with the effect whose column bends that explains enough of what is missing; None where none does.

    Around the model without it such a column may promise nothing.  Fits take long: only where no function of a
    coordinate predicts the missing effort, as none does what oscillates, and it is a band or more than the noise.
    """
    if e.beside is not None:
        return None
    missing = linearised.excess(e, library, now)[0]
    if (missing <= refine.floor(e) and not library.unordered(e, now)) or library.predict(e, now).cuts[0]:
        return None
    fitted = _grown(e, now, tried(), tried())
    if fitted is None:
        return None
    left = linearised.excess(e, library, fitted)[0]
    enough = adequate(missing, left, missing, constants.ADEQUATE_BENT)
    return _that_stands(e, library, now, fitted) if enough else None


def _fitted(
    e: Evidence, now: Fitted, at: Linearised, effects: frozenset[str], predicted: Cuts, tried: Starts
) -> Fitted | None:
    """`now` with `effects`, refined; None where their columns promise too little, and do not bend."""
    best = at.verdict.best(effects)
    added = at.values(best)
    if not _bent(added) and not any(explainable(predicted, added)) and at.explained(best) < constants.ADEQUATE:
        return None
    return _grown(e, now, added, _if_bent(added, tried))


def _explain(e: Evidence, library: Library, now: Fitted, after: Fitted, at: Linearised, predicted: Cuts) -> bool:
    """Whether what `after` adds to `now` explains most of what is missing, or is most probable where it was found."""
    added, left = _added(now, after), linearised.excess(e, library, after)
    before, remaining, ordered = (explainable(cuts, added) for cuts in (at.excess, left, predicted))
    if explains_most(before, remaining, linearised.strokes(e)) or explains(before, remaining, ordered):
        return True
    return _bent(added) and _most_probable(e, library, now, after)


def _most_probable(e: Evidence, library: Library, now: Fitted, after: Fitted) -> bool:
    """Whether the effect that `after` adds to `now` is in the most probable set, its refined values on the grid.

    Away from its values, the column of an effect that bends explains little.
    """
    added, *others = _added(now, after)
    if others:
        return False
    likeliest = next(iter(linearised.linearised(e, library, now, added).verdict.of_sets()))
    return added.effect.name in likeliest


def _grown(e: Evidence, now: Fitted, added: Sequence[EffectValues], starts: Sequence[EffectValues]) -> Fitted | None:
    """`now` with further effects, refined by simulation; None where there are none or they do not fit.

    In the place of those of `added` whose columns bend stands the one of `starts` that explains most, if there is
    any. One whose size vanishes on the way is none: a gap of nothing behind a spring is a spring, and stands among
    them as such.
    """
    straight = [valued for valued in added if not bends(valued.effect)]
    bent = [[start] for start in starts] if len(straight) < len(added) else []
    if not straight and not bent:
        return None
    best = now
    for start in bent or [[]]:
        effects, rival = joined(now.effects, [*straight, *start]), best.residual_sum_of_squares
        grown = refine.refine(e, now.model, effects, rival=rival)
        better = grown.residual_sum_of_squares < rival and not (start and vanishes(grown.effects[-1]))
        best = grown if better else best
    return None if best is now else best


def _if_bent(added: Sequence[EffectValues], tried: Starts) -> Sequence[EffectValues]:
    return tried() if _bent(added) else ()


def _bent(added: Sequence[EffectValues]) -> bool:
    """Whether the column of one of them explains little away from its place on the grid."""
    return any(bends(valued.effect) for valued in added)
