"""A drive that answers later, told from a time shift of the log.

What a current follows is a staircase.  A shift of it, a delay and a lag look alike until they are simulated, and where
one of them has gone after another, no column around it shows that.
"""

from __future__ import annotations

from collections.abc import Sequence

from stagectl.gap.selection import constants, linearised, refine
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.material import adequate
from stagectl.gap.selection.refine import Evidence, Fitted


def on_time(e: Evidence, library: Library, now: Fitted) -> Fitted:
    """`now`, or the model with a later drive where the time shift stands for most of that."""
    if abs(now.model.shift) <= constants.LEAST_SHIFT * e.base.prior.dt:
        return now
    tried = _later(e, library, now, now.effects)
    best = min([now, *tried], key=lambda fitted: fitted.residual_sum_of_squares)
    return best if _current(e, library, best) < _current(e, library, now) and _stands(e, library, now, best) else now


def without_unlike(e: Evidence, library: Library, now: Fitted, valued: EffectValues) -> Library:
    """The library without the later drives that leave far more of the current than `valued`, in whose place they are.

    As it is for any other effect.
    """
    if valued.effect.name not in constants.TIMING:
        return library
    rest = [other for other in now.effects if other is not valued]
    shifted = refine.refine(e, now.model, rest)
    others = library._replace(forms=tuple(form for form in library.forms if form.effect.name != valued.effect.name))
    alike = {
        fitted.effects[-1].effect.name
        for fitted in _later(e, others, now, rest)
        if _stands(e, library, shifted, fitted)
    }
    unlike = {*constants.TIMING} - alike - {valued.effect.name}
    return library._replace(forms=tuple(form for form in library.forms if form.effect.name not in unlike))


def _later(e: Evidence, library: Library, now: Fitted, others: Sequence[EffectValues]) -> list[Fitted]:
    """Every form of a later drive beside `others`, refined from a log without time shift."""
    forms = [form for form in library.forms if form.effect.name in constants.TIMING]
    begin = now.model._replace(shift=0.0)
    return [refine.refine(e, begin, [*others, EffectValues(f.effect, f.values(f.typical))]) for f in forms]


def _stands(e: Evidence, library: Library, before: Fitted, after: Fitted) -> bool:
    left = _current(e, library, before)
    return adequate(left, _current(e, library, after), left)


def _current(e: Evidence, library: Library, fitted: Fitted) -> float:
    return linearised.excess(e, library, fitted)[1]
