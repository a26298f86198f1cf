"""In which coordinate the gap lies: what a smooth function of one coordinate alone predicts of it.

Functions are fitted on one half of the half strokes, together with all parameters of the base, and judged on the other.
"""

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from stagectl.gap.inference import basis_functions, thresholds
from stagectl.gap.inference.basis_functions import EVEN, ODD, TIME, BasisColumns
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.gram_matrices import Grams, folds, partialled_out
from stagectl.gap.residuals.half_strokes import noise_of_all
from stagectl.gap.residuals.thresholds import KEPT
from stagectl.gap.result.diagnosis import Coordinate
from stagectl.gap.selection import refine
from stagectl.gap.selection.refine import Evidence


def coordinates(e: Evidence, functions: BasisColumns) -> tuple[Coordinate, ...]:
    """Share of the base's excess over the repeats' floor that each coordinate predicts, largest first.

    For a coordinate, functions even and odd in the direction of motion count, and both, whichever predict most.
    Frequency counts by the share of the excess in its best band.
    """
    shares = {"frequency": _share_in_a_band(e)}
    floor = floor_of_means(e)
    for basis in functions.bases:
        g = gram_matrices.fold_sums(functions.products[basis.coordinate], means(e.base.after))
        even, odd = (basis_functions.names(basis, part) for part in (EVEN, ODD))
        shares[basis.coordinate] = max(_share(g, e, names, floor) for names in (even, odd, [*even, *odd]))
    if functions.clock is not None:
        g = gram_matrices.fold_sums(functions.clock, e.base.after)
        shares[TIME] = _share(g, e, basis_functions.CLOCK, g.floor.sum(axis=0), aging=True)
    return tuple(Coordinate(name, share) for name, share in sorted(shares.items(), key=lambda pair: -pair[1]))


def means(residuals: Sequence[list[Array]]) -> list[list[Array]]:
    """Means over the repeats of each run: what does not run on the clock is the same in all."""
    return [[np.mean(repeats, axis=0)] for repeats in residuals]


def scatter(e: Evidence) -> list[Array]:
    """(r, m, 2) of each run: deviations of its repeats, scaled to the error of their mean; 0 without repeats."""
    weighted = [(run.weight[:, None] * np.stack(repeats)) for run, repeats in zip(e.runs, e.deviations, strict=True)]
    return [deviations / np.sqrt(max(len(deviations) * (len(deviations) - 1), 1)) for deviations in weighted]


def floor_of_means(e: Evidence) -> Array:
    """Sums of squares (2,) that the repeats' noise leaves in their means, of effort and current."""
    floor: Array = np.sum([np.sum(deviations * deviations, axis=(0, 1)) for deviations in scatter(e)], axis=0)
    return floor * noise_of_all(e.runs, of_means=True)


def _share(g: Grams, e: Evidence, names: Sequence[str], floor: Array, aging: bool = False) -> float:
    """Both cuts by themselves: one function of effort and one of current."""
    gain = closable = 0.0
    for cut, part in enumerate((g.effort, g.current)):
        free = partialled_out(folds(g, part), g.places(refine.moving(e)))
        (before,), (after,), _ = predicted_of(free, g.places(names), [-1])
        gain += max(float(before - after), 0.0)
        closable += max(float(before - floor[cut]), 0.0)
    # Differences between repeats count as floor, unless a drift predicts them.
    closable += gain if aging else 0.0
    return min(gain / closable, 1.0) if closable > 0.0 else 0.0


def predicted_of(free: Array, columns: Sequence[int], residuals: Sequence[int]) -> tuple[Array, Array, Array]:
    """Sums of squares (r,) on the fold that was not fitted, both ways: without the `columns`, and with them; the ridge.

    They are those of each of the columns `residuals`; the residual itself is the last one.  The folds `free`
    (2, p + 1, p + 1) are free of what the nuisances can take.

    The residual is no white noise but an error of form as well, and nobody knows its size beforehand: a function takes
    the ridge (r,) out of `thresholds.RIDGES` by which one fold predicts most of the other.
    """
    before = free[:, residuals, residuals].sum(axis=0)
    after = np.stack([before] * len(thresholds.RIDGES))
    for fitted, judged in ((0, 1), (1, 0)):
        amplitudes = np.stack([ridge_fit(free[fitted], columns, r, of=residuals) for r in thresholds.RIDGES])
        right, gram = free[judged][np.ix_(columns, residuals)], free[judged][np.ix_(columns, columns)]
        after -= np.sum(amplitudes * (2.0 * right - gram @ amplitudes), axis=1)
    best = after.argmin(axis=0)
    return before, after.min(axis=0), np.array(thresholds.RIDGES)[best]


def ridge_fit(
    g: Array, columns: Sequence[int], ridge: float, nuisances: Sequence[int] = (), of: int | Sequence[int] = -1
) -> Array:
    """Amplitudes (k,) of the `nuisances` and then of the `columns` of the Gram matrix `g` (p + 1, p + 1).

    A `ridge`, a share of the best excited column's power, draws those of the `columns` to zero that the data hardly
    excite.  They fit the column `of`, the residual unless given; (k, r) where several are asked for.
    """
    places, free = [*nuisances, *columns], len(nuisances)
    size = np.maximum(np.diag(g)[places], 0.0)  # below it by rounding, where nuisances were taken out
    own = size[free:]
    prior = np.concatenate([np.zeros(free), np.full(len(own), ridge * float(own.max(initial=0.0)))])
    scale = 1.0 / np.sqrt(size + prior + 1e-300)
    a = g[np.ix_(places, places)] + np.diag(prior)
    inverse = np.linalg.pinv(a * np.outer(scale, scale), rcond=thresholds.PSEUDO_INVERSE_RANK, hermitian=True)
    amplitudes: Array = inverse * np.outer(scale, scale) @ g[places][:, of]
    return amplitudes


def _share_in_a_band(e: Evidence) -> float:
    """Largest share of the excess within `thresholds.EXCESS_BAND` octaves above `thresholds.LOWEST_FREQUENCY`."""
    dt = e.runs[-1].mean.dt * KEPT
    segment = min(thresholds.SPECTRUM_ROWS, *(len(run.mean.rows) // KEPT for run in e.runs))
    frequency = np.fft.rfftfreq(segment, dt)
    power = np.sum([_excess_power(e, number, segment) for number in range(len(e.runs))], axis=0)
    whole = float(power.sum())
    starts = frequency[
        (frequency >= thresholds.LOWEST_FREQUENCY) & (frequency * 2.0**thresholds.EXCESS_BAND <= frequency[-1])
    ]
    bands = [float(power[(frequency >= f) & (frequency < f * 2.0**thresholds.EXCESS_BAND)].sum()) for f in starts]
    return min(max(max(bands, default=0.0) / whole, 0.0), 1.0) if whole > 0.0 else 0.0


def _excess_power(e: Evidence, number: int, segment: int) -> Array:
    """Power (f,) of the mean residual of one run, less what the noise of its repeats leaves in it."""
    run, repeats, deviations = e.runs[number], e.base.after[number], e.deviations[number]
    rate = 1.0 / (run.mean.dt * KEPT)
    mean = run.weight[:, None] * np.mean(repeats, axis=0)
    power = welch(mean, rate, nperseg=segment, axis=0)[1]
    noise = [run.weight[:, None] * deviation for deviation in deviations]
    spread = sum(welch(deviation, nperseg=segment, fs=rate, axis=0)[1] for deviation in noise)
    clean: Array = (power - spread / max(len(noise) * (len(noise) - 1), 1)).sum(axis=1) * len(mean)
    return clean
