"""Everything that a search asks of the data, in one small matrix for each half stroke.

With columns X and residual r of a half stroke c, ``G_c = [X r]' [X r]``, repeats added up: sums of these give any fit,
on any part of the data, to any set of columns.  Nothing after this step touches the rows again, so leaving out an
experiment, resampling half strokes and trying thousands of sets cost microseconds.

::

    columns of each run --> Products: X' X, once --> beside: a few columns more --> grams: a residual added

Most columns are the same in every repeat.  What runs on the session clock is not, and counts by its mean over the
repeats and by each repeat's deviation from it: ``sum_k X_k' X_k = n X' X + sum_k dX_k' dX_k``.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from stagectl.gap.batch import in_parallel
from stagectl.gap.runs import Run
from stagectl.gap.session import Array

FLAT = 1e-9  # smallest eigenvalue of the correlations that is believed
RIDGE = 1e-10  # of each diagonal element: columns that these data cannot tell apart stay finite


class Grams(NamedTuple):
    """All half strokes of the data; the last row and column of each matrix is the residual."""

    names: tuple[str, ...]  # of the columns
    effort: Array  # (c, p + 1, p + 1) of cut C
    current: Array  # (c, p + 1, p + 1) of cut B
    floor: Array  # (c, 2) what repeats differ by, of C and B
    experiment: NDArray[np.int64]  # (c,) number of the run
    stroke: NDArray[np.int64]  # (c,) number of the half stroke in its run

    @property
    def both(self) -> Array:
        """(c, p + 1, p + 1) of both cuts together."""
        return self.effort + self.current

    def of(self, names: Sequence[str]) -> list[int]:
        """Places of columns."""
        place = {name: k for k, name in enumerate(self.names)}
        return [place[name] for name in names]


class _Part(NamedTuple):
    """Products of the columns of one run."""

    run: Run
    own: Array  # (2, m) the column of which the run has its own amplitude, of unit length; zero: none
    mean: NDArray[np.float32]  # (2, p, m) columns, weighted, less their part along `own`; single: they are most of it
    square: Array  # (2, c, p, p) of these
    clocked: tuple[int, ...]  # places of the columns that differ from repeat to repeat
    deviation: Array  # (n, 2, q, m) of these from their mean, each repeat
    unequal: Array  # (2, c, q, q) products of these, repeats added up


class Products(NamedTuple):
    """Columns of all runs with their products."""

    names: tuple[str, ...]
    parts: tuple[_Part, ...]


Columns = Sequence[Mapping[str, Sequence[Array]]]  # of each run, by name: (m, 2), one for all repeats or one each


def products(runs: Sequence[Run], columns: Columns, own: str = "") -> Products:
    """Columns multiplied; `own` is a column that each run has its own amplitude of, taken out of all others first."""
    names = tuple(name for name in columns[0] if name != own)
    nothing = [
        _Part(run, _unit(run, found.get(own, ())), *_empty(run)) for run, found in zip(runs, columns, strict=True)
    ]
    return beside(Products((), tuple(nothing)), [{name: found[name] for name in names} for found in columns])


def beside(p: Products, columns: Columns) -> Products:
    """`p` with more columns."""
    if not columns[0]:
        return p
    parts = in_parallel(lambda pair: _joined(*pair), list(zip(p.parts, columns, strict=True)))
    return Products((*p.names, *columns[0]), tuple(parts))


def beside_each(p: Products, columns_of: Callable[[Run], Mapping[str, Sequence[Array]]]) -> Products:
    """`p` with more columns, made and multiplied run by run: few runs' are in memory twice."""
    joined = in_parallel(lambda part: beside(p._replace(parts=(part,)), [columns_of(part.run)]), p.parts)
    return Products(joined[0].names, tuple(one.parts[0] for one in joined))


def only(p: Products, names: Sequence[str]) -> Products:
    """`p` with these of its columns, in this order."""
    place = {name: k for k, name in enumerate(p.names)}
    return Products(tuple(names), tuple(_chosen(part, [place[name] for name in names]) for part in p.parts))


def grams(p: Products, residuals: Sequence[Sequence[Array]]) -> Grams:
    """The matrices of all half strokes, with the residuals (m, 2) of each run and repeat."""
    counts = [part.square.shape[1] for part in p.parts]
    squares, floors = np.empty((2, sum(counts), len(p.names) + 1, len(p.names) + 1)), np.empty((2, sum(counts)))
    ends = list(itertools.accumulate(counts, initial=0))
    spans = zip(p.parts, residuals, itertools.pairwise(ends), strict=True)
    in_parallel(lambda x: _with_residual(x[0], x[1], (squares[:, slice(*x[2])], floors[:, slice(*x[2])])), spans)
    experiment = np.repeat(np.arange(len(counts)), counts)
    stroke = np.concatenate([np.arange(count) for count in counts])
    return Grams(p.names, squares[0], squares[1], floors.T, experiment, stroke)


def _empty(run: Run) -> tuple[NDArray[np.float32], Array, tuple[int, ...], Array, Array]:
    rows, strokes, repeats = len(run.weight), len(_borders(run)) - 1, len(run.paths)
    nothing = np.zeros((2, strokes, 0, 0))
    return np.zeros((2, 0, rows), dtype=np.float32), nothing, (), np.zeros((repeats, 2, 0, rows)), nothing


def _unit(run: Run, column: Sequence[Array]) -> Array:
    if not column:
        return np.zeros((2, len(run.weight)))
    weighted = (column[0] * run.weight[:, None]).T
    size = float(np.sqrt(np.sum(weighted * weighted)))
    unit: Array = weighted / size if size > 0.0 else weighted
    return unit


def _joined(p: _Part, columns: Mapping[str, Sequence[Array]]) -> _Part:
    """Products of old and new columns: what is known already is not multiplied again."""
    count, borders = p.mean.shape[1], _borders(p.run)
    new = [_split(p, found) for found in columns.values()]
    mean = np.stack([one for one, _ in new], axis=1)
    unequal = [(count + k, each) for k, (_, each) in enumerate(new) if each is not None]
    deviation = np.concatenate([p.deviation, *(each[:, :, None] for _, each in unequal)], axis=2)
    square = _bordered(p.square, _between(p.mean, mean, borders), _between(mean, mean, borders))
    clocked = (*p.clocked, *(place for place, _ in unequal))
    return _Part(
        p.run,
        p.own,
        np.concatenate([p.mean, mean.astype(np.float32)], axis=1),
        square,
        clocked,
        deviation,
        _repeated(deviation, borders),
    )


def _split(p: _Part, found: Sequence[Array]) -> tuple[Array, Array | None]:
    """Mean (2, m) of a column over the repeats, and each repeat's deviation (n, 2, m); None where there is none."""
    each = np.stack([_free(p, (one * p.run.weight[:, None]).T) for one in found])
    mean = each.mean(axis=0)
    return mean, each - mean if len(found) > 1 else None


def rows(p: _Part, residual: Array) -> Array:
    """(2, m) a residual (m, 2) as the products hold it: weighted, less its part along the run's own column."""
    return _free(p, (residual * p.run.weight[:, None]).T)


def _free(p: _Part, column: Array) -> Array:
    """`column` (2, m) less its part along the run's own."""
    share = float(np.vdot(p.own, column))
    return column - share * p.own if share else column


def _with_residual(p: _Part, left: Sequence[Array], found: tuple[Array, Array]) -> None:
    """Fills `found`: matrices (2, c, p + 1, p + 1) with the residual last, repeats added up, and their floor (2, c)."""
    (square, floor), borders, repeats = found, _borders(p.run), len(left)
    each = np.stack([_free(p, (one * p.run.weight[:, None]).T) for one in left])
    mean = each.mean(axis=0)
    spread = (each - mean)[:, :, None]
    noise = _repeated(spread, borders)
    last = mean[:, None]
    np.multiply(p.square, repeats, out=square[:, :, :-1, :-1])
    square[:, :, :-1, -1:] = repeats * _between(p.mean, last, borders)
    square[:, :, -1:, -1:] = repeats * _between(last, last, borders) + noise
    if p.clocked and repeats > 1:  # a mean of repeats has but one clock
        at = list(p.clocked)
        square[:, :, np.array(at)[:, None], at] += p.unequal
        square[:, :, at, -1:] += sum(
            _between(one, other, borders) for one, other in zip(p.deviation, spread, strict=True)
        )
    square[:, :, -1, :-1] = square[:, :, :-1, -1]
    floor[:] = noise[:, :, 0, 0] * repeats / max(repeats - 1, 1)


def _chosen(p: _Part, places: list[int]) -> _Part:
    kept = [(places.index(place), k) for k, place in enumerate(p.clocked) if place in places]
    within = [k for _, k in kept]
    return p._replace(
        mean=p.mean[:, places],
        square=p.square[:, :, np.array(places, dtype=np.intp)[:, None], places],
        clocked=tuple(place for place, _ in kept),
        deviation=p.deviation[:, :, within],
        unequal=p.unequal[:, :, np.array(within, dtype=np.intp)[:, None], within],
    )


def _borders(run: Run) -> list[int]:
    """First rows of the half strokes, and the end."""
    return [0, *(np.flatnonzero(np.diff(run.cluster)) + 1).tolist(), len(run.cluster)]


def _between(x: Array | NDArray[np.float32], y: Array, borders: Sequence[int]) -> Array:
    """Products (2, c, p, q) of `x` (2, p, m) and `y` (2, q, m) within each half stroke, in double precision."""
    spans = list(itertools.pairwise(borders))
    found: Array = np.stack(
        [[one[:, a:b] @ other[:, a:b].T for a, b in spans] for one, other in zip(x, y, strict=True)]
    )
    return found


def _repeated(x: Array, borders: Sequence[int]) -> Array:
    """Products (2, c, q, q) of `x` (n, 2, q, m), repeats added up."""
    found: Array = np.sum([_between(one, one, borders) for one in x], axis=0)
    return found


def _bordered(old: Array, cross: Array, new: Array) -> Array:
    """Matrices (..., p + q, p + q) of the blocks (..., p, p), (..., p, q) and (..., q, q)."""
    return np.block([[old, cross], [np.swapaxes(cross, -1, -2), new]])


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
