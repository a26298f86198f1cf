"""What is missing and has an order is no trace: whether an effect explains most of it, however small it is."""

import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet

from stagectl.gap.effects.effect import DRIVE
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.selection import bristle_shape, constants, linearised, refine
from stagectl.gap.selection.candidates import EffectValues, bends
from stagectl.gap.selection.linearised import Cuts, Library
from stagectl.gap.selection.refine import Evidence, Fitted


def without(e: Evidence, now: Fitted, valued: EffectValues) -> Fitted:
    """`now` without one of its effects, everything else as it is; fitted anew where that cannot be simulated."""
    rest = refine.at_values(e, now.model, tuple(other for other in now.effects if other is not valued))
    return rest if math.isfinite(rest.residual_sum_of_squares) else refine.refine(e, e.base.model, rest.effects)


def refitted_without(e: Evidence, now: Fitted, names: AbstractSet[str]) -> Fitted:
    """`now` without the effects `names`, fitted anew; the same where it has none of them."""
    kept = [valued for valued in now.effects if valued.effect.name not in names]
    return now if len(kept) == len(now.effects) else bristle_shape.refined(e, now.model, kept)


def is_material(e: Evidence, library: Library, now: Fitted, valued: EffectValues) -> bool:
    """Whether most of what is missing without the effect `valued` of `now` is explained by it."""
    rest = without(e, now, valued)
    late = valued.effect.name in constants.TIMING
    if late:  # in its place the time shift may move as far as it likes
        rest = refine.refine(e, now.model, rest.effects)
        if stands(library, rest, now):
            return True
    before, after = (explainable(linearised.excess(e, library, fitted), [valued]) for fitted in (rest, now))
    if late:  # the current shows it, whatever is missing in the mechanics
        return explains_most(before[1:], after[1:], linearised.strokes(e))
    least = constants.ADEQUATE_BENT if bends(valued.effect) else constants.ADEQUATE
    most = explains_most(before, after, linearised.strokes(e), least)
    return most or explains(before, after, explainable(library.predict(e, rest).cuts, [valued]))


def stands(library: Library, before: Fitted, after: Fitted) -> bool:
    """Whether `after` explains most of what `before` leaves above the noise.

    A drive that answers at another time than its model makes more of what repeats differ by: the noise is that of
    `after`.
    """
    least = float(gram_matrices.noise(library.products, after.residuals).sum())
    left, remains = (fitted.residual_sum_of_squares - least for fitted in (before, after))
    return left > 0.0 and adequate(left, remains, left)


def most_that_stands(library: Library, before: Fitted) -> float:
    """The sum of squares that no model exceeds which `stands` against `before`.

    The noise of `before` counts: with a drive that answers in time, it falls.
    """
    least = float(gram_matrices.noise(library.products, before.residuals).sum())
    left = before.residual_sum_of_squares
    return left - constants.ADEQUATE * max(left - least, 0.0)


def explainable(cuts: Cuts, effects: Sequence[EffectValues]) -> Sequence[float]:
    """Those of the `cuts` that `effects` may explain: without one of the drive, no current is missing for them."""
    return cuts if any(valued.effect.block == DRIVE for valued in effects) else cuts[:1]


def explains(before: Sequence[float], after: Sequence[float], predicted: Sequence[float]) -> bool:
    """Whether what is left falls by most of what is `predicted`, in one of the cuts of which anything is."""
    return any(p and adequate(b, a, p) for b, a, p in zip(before, after, predicted, strict=True))


def explains_most(
    before: Sequence[float], after: Sequence[float], strokes: int, least: float = constants.ADEQUATE
) -> bool:
    """Whether one of the cuts, of which more is left than noise of as many `strokes`, loses the share `least` of it."""
    return any(b > strokes and adequate(b, a, b, least) for b, a in zip(before, after, strict=True))


def adequate(before: float, after: float, predicted: float, least: float = constants.ADEQUATE) -> bool:
    """Whether a sum of squares falls by the share `least` of what is `predicted` of it."""
    return before - after >= least * min(predicted, before)


def at_bound(valued: EffectValues) -> bool:
    """Whether an amplitude has moved to an end of its range, so that its value is no measurement.

    The lower end of what makes a drive answer later is a drive that answers at once.
    """
    late = valued.effect.name in constants.TIMING
    ends = [
        (valued.values[a.name], end)
        for a in valued.effect.amplitudes
        for end in ((a.high,) if late else (a.low, a.high))
    ]
    return any(end and math.isclose(x, end, rel_tol=constants.AT_BOUND) for x, end in ends)
