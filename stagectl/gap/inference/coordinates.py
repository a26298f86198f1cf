"""In which coordinate the gap lies: what a smooth function of one coordinate alone foretells of it.

Functions are fitted on one half of the half strokes, beside all parameters of the base, and judged on the other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from stagectl.gap.inference import basis_functions
from stagectl.gap.inference.basis_functions import EVEN, ODD, TIME, Functions, Smoother
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, least_squares
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.thresholds import KEPT
from stagectl.gap.result.diagnosis import Coordinate
from stagectl.gap.selection import candidate_scores
from stagectl.gap.selection.cross_validation import folds, partialled_out
from stagectl.gap.selection.refine import Evidence

STIFF = 1e-3  # of the best seen function: what draws one that is hardly seen towards zero
WIDTH = 1.5  # octaves of the band in which a gap lies "in frequency"
LOWEST = 5.0  # Hz: below lie the motions themselves


def coordinates(e: Evidence, smooth: Functions) -> tuple[Coordinate, ...]:
    """Share of the base's excess over the repeats' floor that each coordinate foretells, largest first.

    Of a coordinate count functions even and odd in the direction of motion, and both, whichever foretells most.
    Frequency counts by the share of the excess in its best band.
    """
    found = {"frequency": _banded(e)}
    floor = floor_of_means(e)
    for one in smooth.tried:
        g = gram_matrices.fold_sums(smooth.products[one.coordinate], means(e.base.after))
        found[one.coordinate] = max(_share(g, e, chosen, floor) for chosen in _variants(one))
    if smooth.clock is not None:
        g = gram_matrices.fold_sums(smooth.clock, e.base.after)
        found[TIME] = _share(g, e, basis_functions.CLOCK, g.floor.sum(axis=0), aging=True)
    return tuple(Coordinate(name, share) for name, share in sorted(found.items(), key=lambda pair: -pair[1]))


def _variants(one: Smoother) -> list[list[str]]:
    even, odd = (basis_functions.names(one, part) for part in (EVEN, ODD))
    return [even, odd, [*even, *odd]]


def means(residuals: Sequence[list[Array]]) -> list[list[Array]]:
    """Of the repeats of each run: what does not run on the clock is the same in all."""
    return [[np.mean(repeats, axis=0)] for repeats in residuals]


def scatter(e: Evidence) -> list[Array]:
    """(r, m, 2) of each run: how far its repeats are off their mean, as that stands in the mean; 0 without repeats."""
    each = [(run.weight[:, None] * np.stack(repeats)) for run, repeats in zip(e.runs, e.deviations, strict=True)]
    return [one / np.sqrt(max(len(one) * (len(one) - 1), 1)) for one in each]


def floor_of_means(e: Evidence) -> Array:
    """(2,) sum of squares that the repeats' noise leaves in their means, of effort and current."""
    found: Array = np.sum([np.sum(one * one, axis=(0, 1)) for one in scatter(e)], axis=0)
    return found


def _share(g: Grams, e: Evidence, names: Sequence[str], floor: Array, aging: bool = False) -> float:
    """Both cuts by themselves: one function of effort and one of current."""
    gain = closable = 0.0
    for cut, part in enumerate((g.effort, g.current)):
        before, after = foretold(
            partialled_out(folds(g, part), g.places(candidate_scores.nuisances(e))), g.places(names)
        )
        gain += max(before - after, 0.0)
        closable += max(before - float(floor[cut]), 0.0)
    # What repeats differ by counts as floor, but where a drift foretells it.
    closable += gain if aging else 0.0
    return min(gain / closable, 1.0) if closable > 0.0 else 0.0


def foretold(free: Array, own: Sequence[int]) -> tuple[float, float]:
    """Sums of squares left on the hand that was not fitted, both ways: without the columns `own`, and with them.

    The hands `free` (2, p + 1, p + 1) are free of what the nuisances can take.
    """
    before = after = 0.0
    for fitted, judged in ((0, 1), (1, 0)):
        before += float(free[judged, -1, -1])
        after += least_squares.residual_sum_of_squares(free[judged], own, drawn(free[fitted], own))
    return before, after


def drawn(g: Array, chosen: Sequence[int], beside: Sequence[int] = ()) -> Array:
    """Amplitudes (k,) of the columns `beside` and `chosen`, the latter drawn to zero where they are hardly seen."""
    places, free = [*beside, *chosen], len(beside)
    size = np.diag(g)[places].copy()
    own = size[free:]
    prior = np.concatenate([np.zeros(free), np.full(len(own), STIFF * float(own.max(initial=0.0)))])
    scale = 1.0 / np.sqrt(size + prior + 1e-300)
    a = g[np.ix_(places, places)] + np.diag(prior)
    inverse = np.linalg.pinv(a * np.outer(scale, scale), rcond=1e-10, hermitian=True)
    amplitude: Array = scale * (inverse @ (scale * g[places, -1]))
    return amplitude


def _banded(e: Evidence) -> float:
    """Largest share of the excess within `WIDTH` octaves above `LOWEST`."""
    total: Array | None = None
    frequency = np.zeros(1)
    for run, repeats, deviations in zip(e.runs, e.base.after, e.deviations, strict=True):
        mean = run.weight[:, None] * np.mean(repeats, axis=0)
        noise = [run.weight[:, None] * one for one in deviations]
        segment = min(1024, *(len(each.mean.rows) // KEPT for each in e.runs))
        frequency, power = welch(mean, 1.0 / (run.mean.dt * KEPT), nperseg=segment, axis=0)
        spread = sum(welch(one, nperseg=segment, fs=1.0 / (run.mean.dt * KEPT), axis=0)[1] for one in noise)
        clean = (power - spread / max(len(noise) * (len(noise) - 1), 1)).sum(axis=1) * len(mean)
        total = clean if total is None else total + clean
    assert total is not None  # a session has runs
    whole = float(total.sum())
    starts = frequency[(frequency >= LOWEST) & (frequency * 2.0**WIDTH <= frequency[-1])]
    bands = [float(total[(frequency >= f) & (frequency < f * 2.0**WIDTH)].sum()) for f in starts]
    return min(max(max(bands, default=0.0) / whole, 0.0), 1.0) if whole > 0.0 else 0.0
