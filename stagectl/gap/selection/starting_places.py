"""Where the fit of an effect begins whose columns bend on the way: one place on the grid of its shapes.

Far from its values the column of a soft belt looks like that of a gap or of a base that moves: only fits tell.  They
take long, so that every place is tried on the runs in which most is missing, and the best few of them on all.
"""

import math
from collections.abc import Callable, Sequence
from itertools import compress

import numpy as np

from stagectl.gap.effects.effect import Definition
from stagectl.gap.logs.session import Array
from stagectl.gap.selection import refine
from stagectl.gap.selection.baseline_fit import sum_of_squares
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.linearised import Library
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.thresholds import MISSING_SHARE, PLACE_STEPS, PROMISING_PLACES

Starts = Callable[[], Sequence[EffectValues]]  # found once: they take long


def bends(effect: Definition) -> bool:
    """Whether a column of the effect holds only near the values at which it was taken."""
    return effect.resonant or effect.nonlinear


def starting_places(e: Evidence, library: Library, now: Fitted) -> list[EffectValues]:
    """Of each effect that bends and is not in `now`, what few steps make of the place from which they explain most.

    The one that explains most comes first.
    """
    present = {valued.effect.name for valued in now.effects}
    places: dict[str, list[EffectValues]] = {}
    for form in (form for form in library.forms if bends(form.effect) and form.effect.name not in present):
        places.setdefault(form.effect.name, []).append(EffectValues(form.effect, form.values(form.typical)))
    missing = [sum_of_squares([run], [left]) for run, left in zip(e.runs, now.residuals, strict=True)]
    part = _part(e, telling(np.array(missing), np.array([run.rows for run in e.runs])))
    found: list[Fitted] = []
    for tried in _promising(e, part, now, list(places.values())):
        found.append(_best(e, now, tried, min(map(_left, found), default=math.inf)))
    return [fitted.effects[-1] for fitted in sorted(found, key=_left) if math.isfinite(_left(fitted))]


def _promising(
    e: Evidence, part: Evidence, now: Fitted, places: Sequence[Sequence[EffectValues]]
) -> Sequence[Sequence[EffectValues]]:
    """Of each effect's places those that explain most of `part`, the best effect first; all where `part` is all."""
    if len(part.runs) == len(e.runs):
        return places
    ranked = [sorted((_left(_after_few_steps(part, now, place)), k) for k, place in enumerate(of)) for of in places]
    best_first = sorted(zip(ranked, places, strict=True), key=lambda pair: pair[0][0])
    return [[of[k] for _, k in order[:PROMISING_PLACES]] for order, of in best_first]


def _best(e: Evidence, now: Fitted, places: Sequence[EffectValues], rival: float) -> Fitted:
    """The fit from the best of one effect's `places`; it ends where the sum of squares `rival` is out of reach."""
    fits: list[Fitted] = []
    for place in places:
        fits.append(_after_few_steps(e, now, place, min([rival, *map(_left, fits)])))
    return min(fits, key=_left)


def _left(fitted: Fitted) -> float:
    """Its sum of squares; without end where it diverged."""
    left = fitted.residual_sum_of_squares
    return left if math.isfinite(left) else math.inf


def _after_few_steps(e: Evidence, now: Fitted, place: EffectValues, rival: float = math.inf) -> Fitted:
    return refine.refine(e, now.model, [*now.effects, place], PLACE_STEPS, rival)


def telling(missing: Array, rows: Array) -> Array:
    """Whether each run is one of the shortest that hold `MISSING_SHARE` of what is `missing` (sums of squares)."""
    order = np.argsort(-missing / rows)
    held = np.cumsum(missing[order])
    chosen = np.zeros(len(missing), dtype=bool)
    chosen[order[: np.searchsorted(held, MISSING_SHARE * held[-1]) + 1]] = True
    return chosen


def _part(e: Evidence, chosen: Array) -> Evidence:
    """`e` with the `chosen` runs alone."""
    base, parts = e.base, tuple(compress(e.base.products.parts, chosen))
    base = base._replace(
        products=base.products._replace(parts=parts),
        before=list(compress(base.before, chosen)),
        after=list(compress(base.after, chosen)),
    )
    cut = Evidence(list(compress(e.runs, chosen)), base, list(compress(e.deviations, chosen)))
    return cut if e.beside is None else cut._replace(beside=e.beside.on(chosen))
