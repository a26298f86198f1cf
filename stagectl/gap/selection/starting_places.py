"""Where the fit of an effect begins whose columns bend on the way.

Far from its values the column of a soft belt looks like that of a gap or of a base that moves: only simulations tell.
They take long, so that places are tried on the runs in which most is missing, and the best few of them on all.
"""

import math
from collections.abc import Callable, Sequence
from itertools import compress
from operator import itemgetter

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.selection import linearised, place_search
from stagectl.gap.selection.candidates import EffectValues, Form, bends, in_place
from stagectl.gap.selection.linearised import Library, Remains
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.gap.selection.thresholds import MISSING_SHARE
from stagectl.number_format import NORMAL

Starts = Callable[[], Sequence[EffectValues]]  # found once: they take long


def starting_places(e: Evidence, library: Library, now: Fitted) -> list[EffectValues]:
    """Of each effect that bends and is not in `now`, the place that leaves least; the best place comes first.

    Of what hits stops, all that are promising: a fit ends near where it began, and which ends best shows at its end.
    None where no more effort is left than the noise scatters by, unless what is left is known to have no order: a
    search would fit noise.
    """
    left = linearised.remains(e, library, now)
    if left.excess[0] <= NORMAL * linearised.scatter(e, library, now) and not library.unordered(e, now):
        return []
    present = in_place(now.effects)
    grids: dict[str, list[Form]] = {}
    for form in (form for form in library.forms if bends(form.effect) and form.effect.name not in present):
        grids.setdefault(form.effect.name, []).append(form)
    chosen = telling(_missing(left), np.array([run.rows for run in e.runs]))
    part = (_part(e, chosen), _on(library, chosen), now._replace(residuals=list(compress(now.residuals, chosen))))
    left_by = place_search.left_by(e, library, now)
    found: list[tuple[float, EffectValues]] = []
    for grid in grids.values():
        ranked = sorted(((left_by(place), place) for place in place_search.places(*part, grid)), key=itemgetter(0))
        found += ranked if grid[0].effect.nonlinear else ranked[:1]
    return [place for left, place in sorted(found, key=itemgetter(0)) if math.isfinite(left)]


def _missing(left: Remains) -> Array:
    """(runs,) Sum of squares that is left of each run above its noise: what repeats differ by, less what drifts."""
    begins = np.cumsum([0, *left.experiments[:-1]])
    noise = float(left.strokes.sum()) - left.excess[0]
    floor = left.floor * (noise / max(float(left.floor.sum()), 1e-300))
    missing: Array = np.maximum(np.add.reduceat(left.strokes - floor, begins), 0.0)
    return missing


def telling(missing: Array, rows: Array) -> Array:
    """Whether each run is one of the shortest that hold `MISSING_SHARE` of what is `missing` (sums of squares)."""
    order = np.argsort(-missing / rows)
    held = np.cumsum(missing[order])
    chosen = np.zeros(len(missing), dtype=bool)
    chosen[order[: np.searchsorted(held, MISSING_SHARE * held[-1]) + 1]] = True
    return chosen


def _on(library: Library, chosen: Array) -> Library:
    """`library` on the `chosen` runs alone."""
    return library._replace(products=library.products._replace(parts=tuple(compress(library.products.parts, chosen))))


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
