"""Which effects of a fitted model stand: each is taken out in turn and compared with all others in its place.

What is left of the model is what the diagnosis names, with the probability of each effect, and its rivals.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.residuals.thresholds import LEAD_ORDERS
from stagectl.gap.selection import (
    bristle_shape,
    constants,
    drive_alikes,
    linearised,
    refine,
    resonance_alikes,
    simulation_odds,
    waves,
)
from stagectl.gap.selection.candidates import EffectValues, joined
from stagectl.gap.selection.evidence import fitted_odds, temper
from stagectl.gap.selection.linearised import Library, Linearised, Remains
from stagectl.gap.selection.material import is_material, refitted_without, without
from stagectl.gap.selection.refine import Evidence, Fitted

Say = Callable[[str], None]


class Selection(NamedTuple):
    """The effects that the evidence selects, and how well each of them is established."""

    fitted: Fitted
    left: linearised.Cuts  # sum of squares above the floor that nothing of the model explains
    probability: dict[str, float]  # of each effect, and of a bias that is off
    alternatives: dict[str, dict[str, float]]  # of each effect: odds of others in its place against it
    gains: dict[str, float]  # of each effect: sum of squares that nothing else of the model explains
    rivals: dict[str, dict[str, EffectValues]]  # the comparable alternatives, with their values
    beside: frozenset[str] = frozenset()  # effects that were found next to a free function, which no loop has


def established(e: Evidence, library: Library, now: Fitted, say: Say) -> Selection:
    """Every effect of `now` taken out in turn; the one whose place is most probably empty is dropped, then the next.

    What a simulation makes no larger than a trace is dropped first, whatever the evidence around the model says of it,
    but for what would be missing without it.
    """
    present = linearised.remains(e, library, now)
    lines = {valued.effect.name: wave for valued in now.effects if (wave := waves.wave(e, now, valued))}
    others = [valued for valued in now.effects if valued.effect.name not in lines]
    small = (valued for valued in others if is_trace(valued) and not is_material(e, library, now, valued))
    if trace := next(small, None):
        return dropped(e, library, now, trace.effect.name, say)
    selection = Selection(now, present.excess, {}, {}, {}, {})
    for name, wave in lines.items():
        _enter_wave(e, library, selection, name, wave)
    empty, kin = {}, dict[str, list[EffectValues]]()
    for valued in others:
        at, most = _in_the_place_of(e, library, now, present, valued)
        selection.gains[valued.effect.name] = sum(at.excess) - sum(present.excess)
        empty[valued.effect.name] = max(at.empty, 1.0 - most)
        _enter(selection, at, valued.effect.name, most)
        kin[valued.effect.name] = _over_its_coordinate(selection, at, valued)
        _enter_alikes(selection, _alikes(e, library, now, valued), valued.effect.name)
    weak = max(empty, key=empty.__getitem__, default="")
    weak = weak if weak and empty[weak] > 1.0 - constants.KEPT else _further_part(selection)
    if weak:
        return dropped(e, library, now, weak, say)
    closer = _with_rival(e, library, selection, kin)
    if closer is None:
        return selection
    say(f"{closer.effects[-1].effect.name} explains more than what stood in its place")
    return established(e, library, closer, say)


def _further_part(selection: Selection) -> str:
    """An effect that is too small to be more than a further part of another one; empty where none is.

    A structure has more modes than one, the friction of a lead more harmonics, and a ripple that drifts more lines.
    """
    gains = selection.gains
    for valued in selection.fitted.effects:
        others = [other for other in selection.fitted.effects if other is not valued and _of_kin(valued, other)]
        if any(gains[valued.effect.name] < constants.OF_KIN * gains[other.effect.name] for other in others):
            return valued.effect.name
    return ""


def _of_kin(valued: EffectValues, other: EffectValues) -> bool:
    """Whether an effect may be a further part of the `other`: two resonances; a wave at an order of the lead.

    A ripple whose amplitude drifts along the travel has lines on both sides of its own.
    """
    if valued.effect.resonant and other.effect.resonant:
        return True
    if {valued.effect.name, other.effect.name} == {*constants.RIPPLES}:
        return math.isclose(valued.values["order"], other.values["order"], rel_tol=constants.SIDEBAND)
    return other.effect.name == constants.LEAD and round(valued.values.get("order", 0.0)) in (1, *LEAD_ORDERS)


def _over_its_coordinate(selection: Selection, at: Linearised, valued: EffectValues) -> list[EffectValues]:
    """Others that may order what the effect `valued` does, however probable, where it leaves much of that.

    `at` compares them around the model without it, which has bent: a Stribeck curve of another form was a nonlinear
    damping, which left a ninth, where the curve itself leaves a thirtieth.
    """
    effect = valued.effect
    if sum(selection.left) <= constants.FORM * selection.gains[effect.name]:
        return []
    present = {other.effect.name for other in selection.fitted.effects}
    alone = [item for item in at.verdict.sets if len(item.effects) == 1 and not item.effects & present]
    first = {other: item for item in reversed(alone) for other in item.effects}
    of_block = [other for other in first if EFFECTS[other].block == effect.block]
    kin = [other for other in of_block if effect.coordinate in EFFECTS[other].seen_over]
    return [instead for other in kin for instead in at.values(first[other])]


def _with_rival(
    e: Evidence, library: Library, selection: Selection, kin: Mapping[str, Sequence[EffectValues]]
) -> Fitted | None:
    """The fit with a rival in the place of an effect, where it is then far more probable; None where none is.

    Rivals are comparable around the model, or its `kin`.  How much each explains its own fit tells, but of alikes: see
    `preferred`.
    """
    now, left, strokes = selection.fitted, sum(selection.left), linearised.strokes(e)
    power = temper(left, strokes)
    for valued in now.effects:
        rest = [other for other in now.effects if other is not valued]
        rivals = selection.rivals.get(valued.effect.name, {})
        further = [other for other in kin.get(valued.effect.name, ()) if other.effect.name not in rivals]
        for rival in [*rivals.values(), *further]:
            pair = {valued.effect.name, rival.effect.name}
            if pair <= {*constants.SCALING} or pair <= {*resonance_alikes.OTHERS}:
                continue
            fitted = refine.refine(e, now.model, joined(rest, [rival]))
            gain = power * (left - sum(linearised.excess(e, library, fitted)))
            odds = fitted_odds(gain, len(rival.values) - len(valued.values), strokes)
            if odds > -math.log(constants.COMPARABLE):
                return bristle_shape.beside_effects(e, fitted)
    return None


def _in_the_place_of(
    e: Evidence, library: Library, now: Fitted, present: Remains, valued: EffectValues
) -> tuple[Linearised, float]:
    """The sets that may stand in the place of an effect of `now`, and how probable its simulation lets it be at most.

    It is no trace where it explains what is missing.  `present` is what `now` leaves.
    """
    rest = without(e, now, valued)
    at = linearised.linearised(e, library, rest, valued)
    most = simulation_odds.simulated(valued, linearised.remains(e, library, rest), present, at.powers)
    probability = min(at.verdict.of_effects().get(valued.effect.name, 0.0), most)
    if probability >= constants.KEPT or not is_material(e, library, now, valued):
        return at, most
    library = drive_alikes.without_unlike(e, library, now, valued)
    return linearised.linearised(e, library, rest, valued, traces=False), most


def dropped(e: Evidence, library: Library, now: Fitted, name: str, say: Say) -> Selection:
    """What is established of the other effects, without the effect `name`: with it another of two alikes was nearer."""
    say(f"dropped {name}")
    return established(e, library, preferred(e, library, refitted_without(e, now, {name})), say)


def preferred(e: Evidence, library: Library, now: Fitted) -> Fitted:
    """`now` with those of its effects' alikes which leave the base nearer to its nominal, or are simpler."""
    return resonance_alikes.simpler(e, library, drive_alikes.nearest(e, library, now))


def is_trace(valued: EffectValues) -> bool:
    """Whether an effect is no larger than what every machine has of it; one whose column bends has no trace."""
    return not valued.effect.nonlinear and vanishes(valued)


def vanishes(valued: EffectValues) -> bool:
    """Whether an effect is so small that the machine might as well be without it."""
    sizes = [valued.values[a.name] / a.typical[0] for a in valued.effect.amplitudes]
    return math.hypot(*sizes) < constants.IMMATERIAL


def _enter(selection: Selection, at: Linearised, name: str, most: float) -> None:
    """What the evidence says of the effect `name` that was taken out, and of others in its place.

    It is no more probable than `most`.
    """
    sets = [item for item in at.verdict.sets if name not in item.effects]
    present = at.verdict.of_effects().get(name, 0.0)
    odds: dict[str, float] = {}
    rivals: dict[str, EffectValues] = {}
    for item in sets:
        for other in item.effects:
            odds[other] = odds.get(other, 0.0) + item.probability / max(present, 1e-300)
    for other in (other for other, ratio in odds.items() if ratio >= constants.COMPARABLE):
        best = next(item for item in sets if other in item.effects)
        rivals[other] = next(valued for valued in at.values(best) if valued.effect.name == other)
    selection.probability[name] = min(present, most)
    selection.alternatives[name] = dict(sorted(odds.items(), key=lambda pair: -pair[1]))
    selection.rivals[name] = rivals


def _enter_wave(e: Evidence, library: Library, selection: Selection, name: str, wave: waves.Wave) -> None:
    """A wave of the position stands by its line: the evidence of all that is missing says little of it."""
    selection.probability[name] = wave.probability
    selection.gains[name] = sum(linearised.excess(e, library, wave.rest)) - sum(selection.left)
    selection.alternatives[name], selection.rivals[name] = {}, {}


def _alikes(e: Evidence, library: Library, now: Fitted, valued: EffectValues) -> Sequence[Fitted]:
    """`now` with what explains the same in the place of `valued`, as the last of its effects."""
    if valued.effect.name in constants.SCALING:
        return drive_alikes.other_scales(e, library, now)
    return resonance_alikes.other_resonances(e, library, now, valued)


def _enter_alikes(selection: Selection, others: Sequence[Fitted], name: str) -> None:
    """What explains the same as the effect `name`, with other values of the base, is as probable."""
    for other in (fitted.effects[-1] for fitted in others):
        selection.alternatives[name] = {other.effect.name: 1.0, **selection.alternatives[name]}
        selection.rivals[name][other.effect.name] = other
