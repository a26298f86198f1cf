"""Everything that a search asks of the data, in one small matrix for each half stroke.

With columns X and residual r of a half stroke c, ``G_c = [X r]' [X r]``, repeats added up: sums of these give any fit,
on any part of the data, to any set of columns.  Nothing after this step touches the rows again, so leaving out an
experiment, resampling half strokes and trying thousands of sets cost microseconds.

::

    columns of each run --> Products: X' X, once --> beside: a few columns more --> grams: a residual added
                                                                                --> dealt: ... and summed over the hands

Most columns are the same in every repeat.  What runs on the session clock is not, and counts by its mean over the
repeats and by each repeat's deviation from it: ``sum_k X_k' X_k = n X' X + sum_k dX_k' dX_k``.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.half_strokes import Run
from stagectl.parallel import in_parallel

HANDS = (0, 2)  # numbers of half strokes that stand for a hand each, where all of it are added up


class Grams(NamedTuple):
    """All half strokes of the data, or their sums over two hands; the residual is last in each matrix."""

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
    hands: Array  # (2, 2, p + q, q) the same, dealt


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
    places = [place[name] for name in names]
    return Products(tuple(names), tuple(in_parallel(lambda part: _chosen(part, places), p.parts)))


def grams(p: Products, residuals: Sequence[Sequence[Array]]) -> Grams:
    """The matrices of all half strokes, with the residuals (m, 2) of each run and repeat."""
    counts = [len(_borders(part.run)) - 1 for part in p.parts]
    squares, floors = np.empty((2, sum(counts), len(p.names) + 1, len(p.names) + 1)), np.empty((2, sum(counts)))
    spans = [slice(*ends) for ends in itertools.pairwise(itertools.accumulate(counts, initial=0))]

    def fill(run: tuple[_Part, Sequence[Array], slice]) -> None:
        part, left, span = run
        column, floors[:, span] = _residual(part, left)
        _fill(squares[:, span], part, (column, len(left)), False)

    in_parallel(fill, zip(p.parts, residuals, spans, strict=True))
    experiment = np.repeat(np.arange(len(counts)), counts)
    stroke = np.concatenate([np.arange(count) for count in counts])
    return Grams(p.names, squares[0], squares[1], floors.T, experiment, stroke)


def dealt(p: Products, residuals: Sequence[Sequence[Array]]) -> Grams:
    """`grams` dealt into the two hands at once: all that a score asks, for a tenth of the work."""

    def of(run: tuple[_Part, Sequence[Array]]) -> tuple[Array, Array]:
        part, left = run
        square = np.empty((2, 2, len(p.names) + 1, len(p.names) + 1))
        column, floor = _residual(part, left)
        _fill(square, part, (_dealt(column), len(left)), True)
        return square, _dealt(floor)

    each = in_parallel(of, zip(p.parts, residuals, strict=True))
    square, floor = (np.sum([one[k] for one in each], axis=0) for k in (0, 1))
    return Grams(p.names, square[0], square[1], floor.T, np.zeros(2, np.int64), np.array(HANDS))


def first_hand(stroke: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which half strokes (c,) the first hand holds, by their numbers: two by two, there and back stay together."""
    first: NDArray[np.bool_] = stroke % 4 < 2
    return first


def _dealt(each: Array) -> Array:
    """(2, 2, ...) sums over the hands of what each half stroke of one run gives, (2, c, ...)."""
    first = first_hand(np.arange(each.shape[1]))
    return np.stack([each[:, hand].sum(axis=1) for hand in (first, ~first)], axis=1)


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
    return p._replace(blocks=(*p.blocks, _Block(mean.astype(np.float32), square, _dealt(square))), clocked=clocked)


def _also_clocked(p: _Clocked | None, unequal: Mapping[int, Array], borders: Sequence[int]) -> _Clocked:
    new = np.stack(list(unequal.values()), axis=2)
    deviation = new if p is None else np.concatenate([p.deviation, new], axis=2)
    places = (*(() if p is None else p.places), *unequal)
    return _Clocked(places, deviation, _repeated(deviation, borders))


def _split(p: _Part, found: Sequence[Array]) -> tuple[Array, Array | None]:
    """Mean (2, m) of a column over the repeats, and each repeat's deviation (n, 2, m); None where there is none."""
    each = [rows(p, one) for one in found]
    if len(each) == 1:
        return each[0], None
    mean: Array = np.mean(each, axis=0)
    return mean, np.stack(each) - mean


def rows(p: _Part, signal: Array) -> Array:
    """(2, m) a column or a residual (m, 2) as the products hold it: weighted, less its part along the run's own."""
    found: Array = np.multiply(signal.T, p.run.weight, order="C")
    share = float(np.vdot(p.own, found))
    if share:
        found -= share * p.own
    return found


def _residual(p: _Part, left: Sequence[Array]) -> tuple[Array, Array]:
    """The last column (2, c, p + 1, 1) of the matrices, repeats added up, and their floor (2, c)."""
    borders, repeats = _borders(p.run), len(left)
    each = np.stack([rows(p, one) for one in left])
    mean = each.mean(axis=0)
    spread = (each - mean)[:, :, None]
    noise, last = _repeated(spread, borders), mean[:, None]
    parts = [*(_between(block.mean, last, borders) for block in p.blocks), _between(last, last, borders)]
    column = repeats * np.concatenate(parts, axis=2)
    column[:, :, -1:] += noise
    if p.clocked is not None and repeats > 1:  # a mean of repeats has but one clock
        pairs = zip(p.clocked.deviation, spread, strict=True)
        column[:, :, list(p.clocked.places)] += sum(_between(one, other, borders) for one, other in pairs)
    return column, noise[:, :, 0, 0] * repeats / max(repeats - 1, 1)


def _fill(square: Array, p: _Part, last: tuple[Array, int], dealt: bool) -> None:
    """Fills matrices (2, c, p + 1, p + 1), or of the hands, with the products and the column of the residual."""
    (column, repeats), start = last, 0
    for block in p.blocks:
        start = _filled(square, block.hands if dealt else block.square, start, repeats)
    _filled(square, column, start, 1.0)
    if p.clocked is not None and repeats > 1:
        at = list(p.clocked.places)
        square[:, :, np.array(at)[:, None], at] += _dealt(p.clocked.unequal) if dealt else p.clocked.unequal


def _filled(square: Array, block: Array, start: int, factor: float) -> int:
    """Writes `factor` times the (2, c, p + q, q) of a block to both sides of the diagonal; returns where it ends."""
    end: int = start + block.shape[3]
    np.multiply(block, factor, out=square[:, :, :end, start:end])
    square[:, :, start:end, :start] = np.swapaxes(square[:, :, :start, start:end], 2, 3)
    return end


def _chosen(p: _Part, places: Sequence[int]) -> _Part:
    """These columns, in this order, in one block."""
    count = len(places)
    means = np.empty((2, count, len(p.run.weight)), np.float32)
    square = np.empty((2, len(_borders(p.run)) - 1, count, count))
    start = 0
    for block in p.blocks:
        end = start + block.mean.shape[1]
        rows_, columns = ([k for k, place in enumerate(places) if low <= place < end] for low in (0, start))
        values = block.square[:, :, [places[k] for k in rows_]][..., [places[k] - start for k in columns]]
        means[:, columns] = block.mean[:, [places[k] - start for k in columns]]
        square[:, :, np.array(rows_, dtype=np.intp)[:, None], columns] = values
        square[:, :, np.array(columns, dtype=np.intp)[:, None], rows_] = np.swapaxes(values, 2, 3)
        start = end
    return p._replace(blocks=(_Block(means, square, _dealt(square)),), clocked=_chosen_clocked(p.clocked, places))


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
