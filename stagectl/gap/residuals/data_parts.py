"""The data of all runs divided into parts: by a coordinate of the motion, by half octaves of frequency, by the clock.

Each way gives the Gram matrices (b, 2, p + 1, p + 1) of its parts, of effort and current.  What repeats differ by is no
part of them, but for the columns that run on the clock.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.gram_matrices import Products
from stagectl.gap.residuals.run_products import RunProducts
from stagectl.gap.residuals.thresholds import COORDINATE_PARTS, KEPT, LEAST_BLOCKS, LOWEST_OCTAVE
from stagectl.parallel import in_parallel

Numbers = NDArray[np.int64]  # of the part that each sample belongs to, or each line of a spectrum
Residuals = Sequence[Sequence[Array]]  # (m, 2) of each run and repeat


def quantiles(coordinate: Sequence[Array], count: int = COORDINATE_PARTS) -> list[Numbers]:
    """`count` parts of as many samples each, in the order of a coordinate (m,) of each run."""
    edges = np.quantile(np.concatenate(coordinate), np.linspace(0.0, 1.0, count + 1)[1:-1])
    return [np.searchsorted(edges, values, side="right") for values in coordinate]


def by_sample(p: Products, residuals: Residuals, numbers: Sequence[Numbers]) -> Array:
    """Parts by the number (m,) of each sample of each run."""
    return _summed(p, residuals, lambda k, _, rows: (rows, numbers[k]))


def by_octave(p: Products, residuals: Residuals) -> Array:
    """Parts by half octaves of frequency: of the cosine transform, which keeps sums of products."""

    def transformed(k: int, _: int, rows: Array) -> tuple[Array, Numbers]:
        count = rows.shape[-1]
        line = np.arange(count) / (2.0 * count * KEPT * p.parts[k].run.mean.dt)
        half = np.floor(2.0 * np.log2(np.maximum(line / LOWEST_OCTAVE, 0.5))) + 2.0
        return fft.dct(rows, norm="ortho"), half.astype(np.int64)

    return _summed(p, residuals, transformed)


def by_clock(p: Products, residuals: Residuals) -> Array:
    """Parts by the instants at which the repeats began."""
    starts = [np.array([path.start for path in part.run.paths], dtype=np.float64) for part in p.parts]
    begun = quantiles(starts, LEAST_BLOCKS)
    return _summed(p, residuals, lambda k, repeat, rows: (rows, np.full(rows.shape[-1], begun[k][repeat])))


def _summed(p: Products, residuals: Residuals, divided: Callable[[int, int, Array], tuple[Array, Numbers]]) -> Array:
    """Sums over runs and repeats; `divided` gives rows and their numbers for a run, a repeat, and its rows."""

    def of_run(k: int) -> dict[int, Array]:
        found: dict[int, Array] = {}
        for repeat in range(len(residuals[k])):
            rows, number = divided(k, repeat, _rows(p.parts[k], residuals[k], repeat))
            for part in np.unique(number).tolist():
                chosen = rows[:, :, number == part]
                found[part] = found.get(part, 0.0) + chosen @ np.swapaxes(chosen, 1, 2)
        return found

    runs = in_parallel(of_run, range(len(p.parts)))
    return np.array([sum(run[part] for run in runs if part in run) for part in sorted(set().union(*runs))])


def _rows(part: RunProducts, repeats: Sequence[Array], number: int) -> Array:
    """(2, p + 1, m) columns and residual of one repeat."""
    rows = np.concatenate([part.mean, part.weighted(repeats[number])[:, None]], axis=1)
    if part.clocked is not None and len(repeats) > 1:
        rows[:, list(part.clocked.places)] += part.clocked.deviation[number]
    return rows
