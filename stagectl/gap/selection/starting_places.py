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
from stagectl.parallel import in_parallel

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
    chosen = telling(np.array(missing), np.array([run.rows for run in e.runs]))
    part = _part(e, chosen)
    on_part = [_by_fit(part, now, of) for of in places.values()]
    found = [of[0][1] for of in on_part] if chosen.all() else _on_all(e, now, on_part)
    return [fitted.effects[-1] for fitted in sorted(found, key=_left) if math.isfinite(_left(fitted))]


def _by_fit(e: Evidence, now: Fitted, places: Sequence[EffectValues]) -> list[tuple[EffectValues, Fitted]]:
    """The `places`, each with its fit, in the order of the fits."""
    fits = in_parallel(lambda place: _after_few_steps(e, now, place), places)
    return sorted(zip(places, fits, strict=True), key=lambda pair: _left(pair[1]))


def _on_all(e: Evidence, now: Fitted, on_part: Sequence[Sequence[tuple[EffectValues, Fitted]]]) -> list[Fitted]:
    """The best fit of each effect from its most promising places, the most promising effect first."""
    found: list[Fitted] = []
    for of in sorted(on_part, key=lambda of: _left(of[0][1])):
        promising = [place for place, _ in of[:PROMISING_PLACES]]
        found.append(_best(e, now, promising, min(map(_left, found), default=math.inf)))
    return found


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
