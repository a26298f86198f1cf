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
    return _summed(p, residuals, numbers, lambda rows: rows)


def by_octave(p: Products, residuals: Residuals) -> Array:
    """Parts by half octaves of frequency: of the cosine transform, which keeps sums of products."""
    numbers = [_half_octaves(len(part.run.weight), part.run.mean.dt * KEPT) for part in p.parts]
    return _summed(p, residuals, numbers, lambda rows: fft.dct(rows, norm="ortho"))


def _half_octaves(count: int, dt: float) -> Numbers:
    """Number (m,) of the half octave of each of the `count` lines of a cosine transform of samples every `dt` (s)."""
    line = np.arange(count) / (2.0 * count * dt)
    return (np.floor(2.0 * np.log2(np.maximum(line / LOWEST_OCTAVE, 0.5))) + 2.0).astype(np.int64)


def by_clock(p: Products, residuals: Residuals) -> Array:
    """Parts by the instants at which the repeats began."""
    starts = [np.array([path.start for path in part.run.paths], dtype=np.float64) for part in p.parts]
    begun = quantiles(starts, LEAST_BLOCKS)
    found: dict[int, Array] = {}
    for part, repeats, numbers in zip(p.parts, residuals, begun, strict=True):
        rows, composed = _repeats(part, repeats)
        square = rows @ np.swapaxes(rows, 1, 2)
        for number, one in zip(numbers.tolist(), composed, strict=False):  # of a mean of repeats there is one residual
            found[number] = found.get(number, 0.0) + one @ square @ one.T
    return np.array([found[number] for number in sorted(found)])


def _summed(
    p: Products, residuals: Residuals, numbers: Sequence[Numbers], transformed: Callable[[Array], Array]
) -> Array:
    """Sums over runs and repeats of the parts to which `numbers` assigns the samples of each run, `transformed`."""

    def of_run(k: int) -> dict[int, Array]:
        rows, composed = _repeats(p.parts[k], residuals[k])
        rows = transformed(rows)
        found: dict[int, Array] = {}
        for number in np.unique(numbers[k]).tolist():
            chosen = rows[:, :, numbers[k] == number]
            square = chosen @ np.swapaxes(chosen, 1, 2)
            found[number] = np.sum([one @ square @ one.T for one in composed], axis=0)
        return found

    runs = in_parallel(of_run, range(len(p.parts)))
    return np.array([sum(run[part] for run in runs if part in run) for part in sorted(set().union(*runs))])


def _repeats(part: RunProducts, residuals: Sequence[Array]) -> tuple[Array, list[Array]]:
    """The rows (2, s, m) that all repeats consist of, each only once, and how each repeat (p + 1, s) is composed.

    The columns of a repeat are their means and, of those on the clock, its own deviation; the last is its residual.
    """
    mean, count = part.mean, len(residuals)
    clocked = None if count == 1 else part.clocked  # a mean of repeats has a single clock
    places = [] if clocked is None else list(clocked.places)
    own = np.stack([part.weighted(residual) for residual in residuals], axis=1)
    deviations = [] if clocked is None else list(clocked.deviation)
    columns, rows = mean.shape[1], np.concatenate([mean, *deviations, own], axis=1)
    composed = np.zeros((count, columns + 1, rows.shape[1]))
    composed[:, :columns, :columns] = np.eye(columns)
    for repeat, one in enumerate(composed):
        one[places, columns + repeat * len(places) + np.arange(len(places))] = 1.0
        one[columns, columns + count * len(places) + repeat] = 1.0
    return rows, list(composed)
