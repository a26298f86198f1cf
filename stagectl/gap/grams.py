"""Everything that a search asks of the data, in one small matrix for each half stroke.

With columns X and residual r of a cluster c, ``G_c = [X r]' [X r]``: sums of these give any fit, on any part of the
data, to any set of columns.  Nothing after this step touches the rows again, so leaving out an experiment, resampling
half strokes and trying thousands of sets cost microseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from stagectl.gap.runs import Run
from stagectl.gap.session import Array

FLAT = 1e-9  # smallest eigenvalue of the correlations that is believed
RIDGE = 1e-10  # of each diagonal element: columns that these data cannot tell apart stay finite


class Grams(NamedTuple):
    """All clusters of the data; the last row and column of each matrix is the residual."""

    names: tuple[str, ...]  # of the columns
    effort: Array  # (c, p + 1, p + 1) of cut C
    current: Array  # (c, p + 1, p + 1) of cut B
    floor: Array  # (c, 2) what repeats differ by, of C and B
    experiment: NDArray[np.int64]  # (c,) number of the run
    stroke: NDArray[np.int64]  # (c,) number of the half stroke in its run, the same in every repeat

    @property
    def both(self) -> Array:
        """(c, p + 1, p + 1) of both cuts together."""
        return self.effort + self.current

    def of(self, names: Sequence[str]) -> list[int]:
        """Places of columns."""
        place = {name: k for k, name in enumerate(self.names)}
        return [place[name] for name in names]


def grams(
    runs: Sequence[Run], columns: Sequence[dict[str, list[Array]]], residuals: Sequence[list[Array]], own: str = ""
) -> Grams:
    """The matrices of all half strokes; `own` is a column that each run has its own amplitude of, taken out first."""
    names = tuple(name for name in columns[0] if name != own)
    effort: list[Array] = []
    current: list[Array] = []
    floor: list[tuple[float, float]] = []
    experiment: list[int] = []
    stroke: list[int] = []
    for number, (run, found, left) in enumerate(zip(runs, columns, residuals, strict=True)):
        mean, repeats = np.mean(left, axis=0), len(left)
        spread = [(one - mean) * np.sqrt(repeats / max(repeats - 1, 1)) for one in left]
        for k, residual in enumerate(left):
            z = np.stack([*(found[name][min(k, len(found[name]) - 1)] for name in names), residual])
            z = z * run.weight[:, None]
            z = _without(z, found[own][0] * run.weight[:, None]) if own else z
            parts = _clusters(z, run.cluster)
            noise = _clusters((spread[k] * run.weight[:, None])[None], run.cluster)
            effort += [one[0] for one in parts]
            current += [one[1] for one in parts]
            floor += [(one[0][0, 0], one[1][0, 0]) for one in noise]
            experiment += [number] * len(parts)
            stroke += range(len(parts))
    numbers = (np.array(experiment), np.array(stroke))
    return Grams(names, np.array(effort), np.array(current), np.array(floor), *numbers)


def _without(z: Array, column: Array) -> Array:
    """`z` (k, m, 2) less its part along `column` (m, 2)."""
    size = float(np.sum(column * column))
    if size == 0.0:
        return z
    return z - np.tensordot(z, column, ([1, 2], [0, 1]))[:, None, None] * (column / size)


def _clusters(z: Array, cluster: NDArray[np.int64]) -> list[tuple[Array, Array]]:
    """Both cuts' matrices of each cluster of `z` (k, m, 2)."""
    borders = np.flatnonzero(np.diff(cluster)) + 1
    found = []
    for begin, end in zip([0, *borders], [*borders, len(cluster)], strict=True):
        e, i = z[:, begin:end, 0], z[:, begin:end, 1]
        found.append((e @ e.T, i @ i.T))
    return found


class Fit(NamedTuple):
    """Least squares of some columns."""

    amplitude: Array  # (k,) in the order asked for
    misfit: float  # sum of squares left


def fit(g: Array, chosen: Sequence[int]) -> Fit:
    """Least squares on a summed matrix `g`."""
    chosen = list(chosen)
    a, b = g[np.ix_(chosen, chosen)], g[chosen, -1]
    a = a + np.diag(RIDGE * np.diag(a) + 1e-300)
    amplitude = np.asarray(np.linalg.pinv(a, hermitian=True, rcond=1e-14), dtype=np.float64) @ b
    return Fit(amplitude, misfit(g, chosen, amplitude))


def inverse(a: Array) -> Array:
    """Pseudo-inverse of normal equations (k, k) whose columns have units of their own."""
    scale = np.sqrt(np.diag(a))
    scale = np.where(scale > 0.0, scale, 1.0)
    found: Array = np.linalg.pinv(a / np.outer(scale, scale), rcond=FLAT, hermitian=True) / np.outer(scale, scale)
    return found


def bounded(g: Array, chosen: Sequence[int], low: Array, high: Array) -> Array:
    """Amplitudes (k,) of the least squares within `low` and `high`; zero must lie between them."""
    places = list(chosen)
    a, b = g[np.ix_(places, places)], g[places, -1]
    if not np.isfinite(a).all():  # a candidate has diverged: no step can be told
        return np.zeros(len(places))
    scale = np.sqrt(np.diag(a))
    scale = np.where(scale > 0.0, scale, 1.0)  # a column that these data do not have
    q, r = np.linalg.eigh(a / np.outer(scale, scale))  # columns of unit length
    root = np.sqrt(np.maximum(q, FLAT))
    bounds = (np.minimum(low * scale, -1e-12), np.maximum(high * scale, 1e-12))
    solved = lsq_linear(root[:, None] * r.T, (r.T @ (b / scale)) / root, bounds, method="bvls")
    amplitude: Array = solved.x / scale
    return amplitude


def misfit(g: Array, chosen: Sequence[int], amplitude: Array) -> float:
    """Sum of squares left by given amplitudes, on the data that `g` sums up."""
    chosen = list(chosen)
    a, b = g[np.ix_(chosen, chosen)], g[chosen, -1]
    return float(g[-1, -1] - 2.0 * b @ amplitude + amplitude @ a @ amplitude)
