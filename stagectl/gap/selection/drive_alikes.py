"""Effects of the drive that look alike until they are simulated.

* What a current follows is a staircase: a shift of the log, a delay and a lag.
* A drive that gives less than it is told, and one that reports more than it gives: all efforts differ by one factor.

Where the base has gone after one of them, no column around it shows the other.
"""

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from typing import NamedTuple

from stagectl.gap.selection import constants, refine
from stagectl.gap.selection.bristle_members import shaped_as
from stagectl.gap.selection.candidates import EffectValues, Form
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.material import most_that_stands, stands
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.thresholds import AS_CLOSE


def on_time(e: Evidence, library: Library, now: Fitted) -> Fitted:
    """`now`, or the model with a later drive where the time shift stands for most of that.

    Of later drives the one that explains more: what else was missing may have decided between them before.
    """
    late = [valued for valued in now.effects if valued.effect.name in constants.TIMING]
    if not late and abs(now.model.shift) <= constants.LEAST_SHIFT * e.base.prior.dt:
        return now
    rest = _Beside([valued for valued in now.effects if valued not in late], now.model.shift + sum(map(delay, late)))
    rival = now.residual_sum_of_squares if late else most_that_stands(library, now)
    tried = _later(e, library, now, rest, rival)
    best = min([now, *tried], key=lambda fitted: fitted.residual_sum_of_squares)
    return best if late or stands(library, now, best) else now


def nearest(e: Evidence, library: Library, now: Fitted) -> Fitted:
    """`now` with that of two scales, and of two offsets, of the current which leaves the base nearer to its nominal.

    They explain the same.  The other scale needs inertia and all friction off by the same factor, the other offset a
    constant force against the current that it gives.  Where they are about as near, it is the one of fewer parameters:
    how far the nominal values of a stage are off nobody knows, so that the ratio of two distances is what counts.
    """

    def nearer(others: Sequence[Fitted], *names: str) -> Fitted:
        known = [name for name in names if name in refine.nuisances(e)]
        tried = [(e.base.prior.cost(fitted.model, known), fitted) for fitted in (now, *others)]
        most = min(cost for cost, _ in tried) * constants.COMPARABLE ** (-2.0 / max(len(known), 1))
        near = [(_size(fitted), cost, fitted) for cost, fitted in tried if cost <= most]
        return min(near, key=lambda each: each[:2])[-1]

    now = nearer(other_scales(e, library, now), "inertia", "viscous")  # known best: friction has a form
    return nearer(_other_offsets(e, now), "bias")


def _size(fitted: Fitted) -> int:
    """The number of amplitudes of its effects."""
    return sum(len(valued.effect.amplitudes) for valued in fitted.effects)


def other_scales(e: Evidence, library: Library, now: Fitted) -> list[Fitted]:
    """`now` with the other scale of the current, last, in the place of the one that it has; none where it is worse.

    The noise of the current is one of the efforts, which the other side may make larger.
    """
    scales = [valued for valued in now.effects if valued.effect.name in constants.SCALING]
    if len(scales) != 1:
        return []
    scale, rest = scales[0], [valued for valued in now.effects if valued is not scales[0]]
    others = [form for form in library.forms if form.effect.name in {*constants.SCALING} - {scale.effect.name}]
    sides = [EffectValues(form.effect, form.values(_opposed(scale, form))) for form in others]
    begin = shaped_as(e.base.model, now.model)
    tried = [refine.refine(e, begin, [*rest, side]) for side in sides]
    gain = 1.0 + scale.values[scale.effect.amplitudes[0].name]
    larger = max(gain if scale.effect.name == constants.SCALING[0] else 1.0 / gain, 1.0)
    most = now.residual_sum_of_squares * (1.0 + AS_CLOSE) * larger**2
    return [fitted for fitted in tried if fitted.residual_sum_of_squares <= most]


def _other_offsets(e: Evidence, now: Fitted) -> list[Fitted]:
    """`now` with its offset of the current where it is only reported, or the other way; none where it has none."""
    offset = next((valued for valued in now.effects if valued.effect.name == constants.OFFSET), None)
    if offset is None:
        return []
    other = EffectValues(offset.effect, {**offset.values, "reported": 1.0 - offset.values["reported"]})
    effects = [other if each is offset else each for each in now.effects]
    tried = refine.refine(e, shaped_as(e.base.model, now.model), effects)
    return [tried] if tried.residual_sum_of_squares <= now.residual_sum_of_squares * (1.0 + AS_CLOSE) else []


def _opposed(scale: EffectValues, form: Form) -> list[float]:
    """Sizes at which `form` is the other side of the same factor: its first amplitude is a gain."""
    gain = scale.values[scale.effect.amplitudes[0].name]
    return [gain, *[0.0] * (len(form.typical) - 1)]


def without_unlike(e: Evidence, library: Library, now: Fitted, valued: EffectValues) -> Library:
    """The library without what looks like `valued` until it is simulated: later drives that leave far more, the scale.

    As it is for any other effect.
    """
    if valued.effect.name in constants.SCALING:
        return without_effects(library, {*constants.SCALING} - {valued.effect.name})
    if valued.effect.name not in constants.TIMING:
        return library
    rest = [other for other in now.effects if other is not valued]
    shifted = refine.refine(e, now.model, rest)
    others = without_effects(library, {valued.effect.name})
    beside = _Beside(rest, now.model.shift + delay(valued))
    later = _later(e, others, now, beside, most_that_stands(library, shifted))
    alike = {
        fitted.effects[-1].effect.name
        for fitted in later
        if stands(library, shifted, fitted) and not stands(library, fitted, now)
    }
    return without_effects(library, {*constants.TIMING} - alike - {valued.effect.name})


def without_effects(library: Library, names: AbstractSet[str]) -> Library:
    """The library without the effects `names`."""
    return library._replace(forms=tuple(form for form in library.forms if form.effect.name not in names))


class _Beside(NamedTuple):
    """What a later drive stands beside, and by how much it is later."""

    effects: Sequence[EffectValues]
    by: float  # s


def delay(valued: EffectValues) -> float:
    """By how much (s) an effect makes the drive answer later than its model: its only amplitude."""
    return valued.values[valued.effect.amplitudes[0].name]


def _later(e: Evidence, library: Library, now: Fitted, beside: _Beside, rival: float) -> list[Fitted]:
    """Every later drive, refined from a log without time shift as far as the sum of squares `rival` is in reach.

    Of one effect the best: where a loop is slow and not damped, no column shows that it might overshoot.
    """
    begin, best = now.model._replace(shift=0.0), dict[str, Fitted]()
    for form in (form for form in library.forms if form.effect.name in constants.TIMING):
        name, valued = form.effect.name, EffectValues(form.effect, form.values([beside.by]))
        after = refine.refine(e, begin, [*beside.effects, valued], rival=rival)
        best[name] = min(best.get(name, after), after, key=lambda fitted: fitted.residual_sum_of_squares)
    return list(best.values())
