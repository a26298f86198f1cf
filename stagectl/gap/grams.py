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

from stagectl.gap.batch import in_parallel
from stagectl.gap.runs import Run
from stagectl.gap.session import Array


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


class _Block(NamedTuple):
    """Some columns of one run, with their products with all columns of the blocks before and with themselves."""

    mean: NDArray[np.float32]  # (2, q, m) weighted, less their part along `own`; single: they are most of it
    square: Array  # (2, c, p + q, q)


class _Clocked(NamedTuple):
    """The columns of one run that differ from repeat to repeat."""

    places: tuple[int, ...]
    deviation: Array  # (n, 2, q, m) from their mean, each repeat
    unequal: Array  # (2, c, q, q) products of these, repeats added up


class _Part(NamedTuple):
    """Products of the columns of one run.  More columns share the blocks of those before: they cost their own alone."""

    run: Run
    own: Array  # (2, m) the column of which the run has its own amplitude, of unit length; zero: none
    blocks: tuple[_Block, ...]
    clocked: _Clocked | None

    @property
    def mean(self) -> NDArray[np.float32]:
        """(2, p, m) all columns."""
        return np.concatenate([block.mean for block in self.blocks], axis=1)


class Products(NamedTuple):
    """Columns of all runs with their products."""

    names: tuple[str, ...]
    parts: tuple[_Part, ...]


Columns = Sequence[Mapping[str, Sequence[Array]]]  # of each run, by name: (m, 2), one for all repeats or one each


def products(runs: Sequence[Run], columns: Columns, own: str = "") -> Products:
    """Columns multiplied; `own` is a column that each run has its own amplitude of, taken out of all others first."""
    names = tuple(name for name in columns[0] if name != own)
    pairs = zip(runs, columns, strict=True)
    nothing = [_Part(run, _unit(run, found.get(own, ())), (), None) for run, found in pairs]
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
    counts = [len(_borders(part.run)) - 1 for part in p.parts]
    squares, floors = np.empty((2, sum(counts), len(p.names) + 1, len(p.names) + 1)), np.empty((2, sum(counts)))
    ends = list(itertools.accumulate(counts, initial=0))
    spans = zip(p.parts, residuals, itertools.pairwise(ends), strict=True)
    in_parallel(lambda x: _with_residual(x[0], x[1], (squares[:, slice(*x[2])], floors[:, slice(*x[2])])), spans)
    experiment = np.repeat(np.arange(len(counts)), counts)
    stroke = np.concatenate([np.arange(count) for count in counts])
    return Grams(p.names, squares[0], squares[1], floors.T, experiment, stroke)


def _unit(run: Run, column: Sequence[Array]) -> Array:
    if not column:
        return np.zeros((2, len(run.weight)))
    weighted = (column[0] * run.weight[:, None]).T
    size = float(np.sqrt(np.sum(weighted * weighted)))
    unit: Array = weighted / size if size > 0.0 else weighted
    return unit


def _joined(p: _Part, columns: Mapping[str, Sequence[Array]]) -> _Part:
    """Products of old and new columns: what is known already is not multiplied again."""
    count, borders = sum(block.mean.shape[1] for block in p.blocks), _borders(p.run)
    new = [_split(p, found) for found in columns.values()]
    mean = np.stack([one for one, _ in new], axis=1)
    square = np.concatenate(
        [*(_between(block.mean, mean, borders) for block in p.blocks), _between(mean, mean, borders)], axis=2
    )
    unequal = {count + k: each for k, (_, each) in enumerate(new) if each is not None}
    clocked = _also_clocked(p.clocked, unequal, borders) if unequal else p.clocked
    return p._replace(blocks=(*p.blocks, _Block(mean.astype(np.float32), square)), clocked=clocked)


def _also_clocked(p: _Clocked | None, unequal: Mapping[int, Array], borders: Sequence[int]) -> _Clocked:
    new = np.stack(list(unequal.values()), axis=2)
    deviation = new if p is None else np.concatenate([p.deviation, new], axis=2)
    places = (*(() if p is None else p.places), *unequal)
    return _Clocked(places, deviation, _repeated(deviation, borders))


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
    last, start = mean[:, None], 0
    for block in p.blocks:
        start = _filled(square, block.square, start, repeats)
    own = [_between(block.mean, last, borders) for block in p.blocks]
    _filled(square, np.concatenate([*own, _between(last, last, borders) + noise / repeats], axis=2), start, repeats)
    if p.clocked is not None and repeats > 1:  # a mean of repeats has but one clock
        at, deviation = list(p.clocked.places), p.clocked.deviation
        square[:, :, np.array(at)[:, None], at] += p.clocked.unequal
        cross = sum(_between(one, other, borders) for one, other in zip(deviation, spread, strict=True))
        square[:, :, at, -1:] += cross
        square[:, :, -1, at] = square[:, :, at, -1]
    floor[:] = noise[:, :, 0, 0] * repeats / max(repeats - 1, 1)


def _filled(square: Array, block: Array, start: int, factor: float) -> int:
    """Writes `factor` times the (2, c, p + q, q) of a block to both sides of the diagonal; returns where it ends."""
    end: int = start + block.shape[3]
    np.multiply(block, factor, out=square[:, :, :end, start:end])
    square[:, :, start:end, :start] = np.swapaxes(square[:, :, :start, start:end], 2, 3)
    return end


def _chosen(p: _Part, places: Sequence[int]) -> _Part:
    """These columns, in this order, in one block."""
    means, count = p.mean[:, places], len(places)
    square = np.empty((2, len(_borders(p.run)) - 1, count, count))
    start = 0
    for block in p.blocks:
        end = start + block.mean.shape[1]
        rows_, columns = ([k for k, place in enumerate(places) if low <= place < end] for low in (0, start))
        values = block.square[:, :, [places[k] for k in rows_]][..., [places[k] - start for k in columns]]
        square[:, :, np.array(rows_, dtype=np.intp)[:, None], columns] = values
        square[:, :, np.array(columns, dtype=np.intp)[:, None], rows_] = np.swapaxes(values, 2, 3)
        start = end
    return p._replace(blocks=(_Block(means, square),), clocked=_chosen_clocked(p.clocked, places))


def _chosen_clocked(p: _Clocked | None, places: Sequence[int]) -> _Clocked | None:
    kept = [] if p is None else [(places.index(place), k) for k, place in enumerate(p.places) if place in places]
    if p is None or not kept:
        return None
    within = np.array([k for _, k in kept])
    return _Clocked(
        tuple(place for place, _ in kept), p.deviation[:, :, within], p.unequal[:, :, within[:, None], within]
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
