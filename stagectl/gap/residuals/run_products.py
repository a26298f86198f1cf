"""Products of the columns of one run: of its two folds once for all, of its half strokes where they are wanted.

A long log has thousands of half strokes: a matrix of all columns for each of them would fill the memory.

Most columns are the same in every repeat.  A column that runs on the session clock is not; it counts by its mean over
the repeats and by each repeat's deviation from it: ``sum_k X_k' X_k = n X' X + sum_k dX_k' dX_k``.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.half_strokes import Run, spans

Parts = Sequence[Sequence[slice]]  # spans of the samples that belong together
Places = NDArray[np.intp]


class Block(NamedTuple):
    """Some columns of one run, with their products with all columns of the blocks before and with themselves."""

    mean: NDArray[np.float32]  # (2, q, m) weighted, less their part along `own`; single precision: they fill the memory
    folds: Array  # (2, 2, p + q, q)
    driven: Places  # of those that the current has; most are effects of the mechanics, and it has none of them


class ClockColumns(NamedTuple):
    """The columns of one run that differ from repeat to repeat."""

    places: tuple[int, ...]
    deviation: Array  # (n, 2, q, m) of each repeat from the mean
    folds: Array  # (2, 2, q, q) products of the deviations, summed over the repeats


class RunProducts(NamedTuple):
    """Products of the columns of one run.  Further columns share the blocks that exist already."""

    run: Run
    own: Array  # (2, m) of unit length: the column of which the run has its own amplitude; zero: none
    blocks: tuple[Block, ...]
    clocked: ClockColumns | None

    @property
    def mean(self) -> NDArray[np.float32]:
        """(2, p, m) all columns."""
        return np.concatenate([block.mean for block in self.blocks], axis=1)

    def weighted(self, signal: Array) -> Array:
        """(2, m) of a column or a residual `signal` (m, 2): weighted, less its part along the run's own column."""
        rows: Array = np.multiply(signal.T, self.run.weight, order="C")
        share = float(np.vdot(self.own, rows))
        if share:
            rows -= share * self.own
        return rows


def first_fold(stroke: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether half strokes (c,) belong to the first fold, by their numbers: in pairs, there and back together."""
    return stroke % 4 < 2


def folds_of(run: Run) -> Parts:
    """The samples of both folds."""
    stroke = np.cumsum(np.diff(run.cluster, prepend=run.cluster[:1]) != 0)
    pairs = spans(first_fold(stroke).astype(np.int64))
    return [pairs[0::2], pairs[1::2]]


def without_columns(run: Run, own: Sequence[Array]) -> RunProducts:
    """A run with its own column (m, 2), if it has one, and no others yet."""
    if not own:
        return RunProducts(run, np.zeros((2, len(run.weight))), (), None)
    weighted = (own[0] * run.weight[:, None]).T
    length = float(np.sqrt(np.sum(weighted * weighted)))
    return RunProducts(run, weighted / length if length > 0.0 else weighted, (), None)


def with_columns(p: RunProducts, columns: Mapping[str, Sequence[Array]]) -> RunProducts:
    """`p` with more columns; products that exist are not multiplied again."""
    count, parts = sum(block.mean.shape[1] for block in p.blocks), folds_of(p.run)
    separated = [_mean_and_deviation(p, repeats) for repeats in columns.values()]
    mean = np.stack([column for column, _ in separated], axis=1).astype(np.float32)
    driven = _driven(mean)
    before = (_between(block.mean, mean, parts, (block.driven, driven)) for block in p.blocks)
    folds = [*before, _between(mean, mean, parts, (driven, driven))]
    deviations = {count + k: deviation for k, (_, deviation) in enumerate(separated) if deviation is not None}
    clocked = _with_clocked(p.clocked, deviations, parts) if deviations else p.clocked
    return p._replace(blocks=(*p.blocks, Block(mean, np.concatenate(folds, axis=2), driven)), clocked=clocked)


def _with_clocked(p: ClockColumns | None, deviations: Mapping[int, Array], folds: Parts) -> ClockColumns:
    new = np.stack(list(deviations.values()), axis=2)
    deviation = new if p is None else np.concatenate([p.deviation, new], axis=2)
    places = (*(() if p is None else p.places), *deviations)
    return ClockColumns(places, deviation, _over_repeats(deviation, folds))


def _mean_and_deviation(p: RunProducts, repeats: Sequence[Array]) -> tuple[Array, Array | None]:
    """Mean (2, m) of a column over the repeats, and each repeat's deviation (n, 2, m); None where there is only one."""
    columns = [p.weighted(column) for column in repeats]
    if len(columns) == 1:
        return columns[0], None
    mean: Array = np.mean(columns, axis=0)
    return mean, np.stack(columns) - mean


class Squares(NamedTuple):
    """Products of all columns and of the residual, which is the last, within parts of a run."""

    square: Array  # (2, b, p + 1, p + 1), summed over the repeats
    floor: Array  # (2, b) sum of squares that repeats differ by


def of_strokes(p: RunProducts, residuals: Sequence[Array]) -> Squares:
    """Of each half stroke, with the residual (m, 2) of each repeat."""
    parts = [[stroke] for stroke in spans(p.run.cluster)]
    clocked = None if p.clocked is None else _over_repeats(p.clocked.deviation, parts)
    return _squares(p, residuals, parts, _between(p.mean, p.mean, parts), clocked)


def of_folds(p: RunProducts, residuals: Sequence[Array]) -> Squares:
    """Of both folds."""
    count = sum(block.mean.shape[1] for block in p.blocks)
    square, start = np.empty((2, 2, count, count)), 0
    for block in p.blocks:
        end = start + block.mean.shape[1]
        square[:, :, :end, start:end] = block.folds
        square[:, :, start:end, :start] = np.swapaxes(block.folds[:, :, :start], 2, 3)
        start = end
    return _squares(p, residuals, folds_of(p.run), square, None if p.clocked is None else p.clocked.folds)


def _squares(
    p: RunProducts, residuals: Sequence[Array], parts: Parts, columns: Array, clocked: Array | None
) -> Squares:
    """`columns` (2, b, p, p) are the products of the means, `clocked` (2, b, q, q) those of the deviations."""
    count, repeats = columns.shape[2], len(residuals)
    rows = np.stack([p.weighted(residual) for residual in residuals])
    mean = rows.mean(axis=0)
    last, deviation = mean[:, None], (rows - mean)[:, :, None]
    noise = _over_repeats(deviation, parts)
    products = np.concatenate(
        [
            *(_between(each.mean, last, parts, (each.driven, np.arange(1))) for each in p.blocks),
            _between(last, last, parts),
        ],
        axis=2,
    )
    square = np.empty((*columns.shape[:2], count + 1, count + 1))
    np.multiply(columns, repeats, out=square[:, :, :count, :count])
    square[:, :, :, count:] = repeats * products
    square[:, :, -1:, -1:] += noise
    if p.clocked is not None and clocked is not None and repeats > 1:  # a mean of repeats has a single clock
        at, pairs = np.array(p.clocked.places), zip(p.clocked.deviation, deviation, strict=True)
        square[:, :, at[:, None], at] += clocked
        square[:, :, at, -1:] += sum(_between(clock, own, parts) for clock, own in pairs)
    square[:, :, -1, :-1] = square[:, :, :-1, -1]
    return Squares(square, noise[:, :, 0, 0] * repeats / max(repeats - 1, 1))


def differences(p: RunProducts, residuals: Sequence[Array]) -> Array:
    """(2, q + 1, q + 1) products of what repeats differ by: of the columns on the clock, and of the residual, the last.

    Without repeats there are no differences.
    """
    clocked = () if p.clocked is None else p.clocked.places
    square, repeats = np.zeros((2, len(clocked) + 1, len(clocked) + 1)), len(residuals)
    if repeats < 2:
        return square
    rows = np.stack([p.weighted(residual) for residual in residuals])
    last, whole = (rows - rows.mean(axis=0))[:, :, None], [[slice(None)]]
    square[:, -1:, -1:] = _over_repeats(last, whole)[:, 0]
    if p.clocked is not None:
        square[:, :-1, :-1] = p.clocked.folds.sum(axis=1)
        pairs = zip(p.clocked.deviation, last, strict=True)
        square[:, :-1, -1:] = np.sum([_between(clock, own, whole) for clock, own in pairs], axis=0)[:, 0]
        square[:, -1, :-1] = square[:, :-1, -1]
    return square


def selected(p: RunProducts, places: Sequence[int]) -> RunProducts:
    """The columns at `places`, in this order, in one block."""
    count = len(places)
    means, folds = np.empty((2, count, len(p.run.weight)), np.float32), np.empty((2, 2, count, count))
    start = 0
    for block in p.blocks:
        end = start + block.mean.shape[1]
        rows, columns = ([k for k, place in enumerate(places) if low <= place < end] for low in (0, start))
        values = block.folds[:, :, [places[k] for k in rows]][..., [places[k] - start for k in columns]]
        means[:, columns] = block.mean[:, [places[k] - start for k in columns]]
        folds[:, :, np.array(rows, dtype=np.intp)[:, None], columns] = values
        folds[:, :, np.array(columns, dtype=np.intp)[:, None], rows] = np.swapaxes(values, 2, 3)
        start = end
    return p._replace(blocks=(Block(means, folds, _driven(means)),), clocked=_selected_clocked(p.clocked, places))


def _selected_clocked(p: ClockColumns | None, places: Sequence[int]) -> ClockColumns | None:
    kept = [] if p is None else [(places.index(place), k) for k, place in enumerate(p.places) if place in places]
    if p is None or not kept:
        return None
    within = np.array([k for _, k in kept])
    return ClockColumns(
        tuple(place for place, _ in kept), p.deviation[:, :, within], p.folds[:, :, within[:, None], within]
    )


def _driven(columns: Array | NDArray[np.float32]) -> Places:
    """Places of those of `columns` (2, p, m) of which the current is not zero throughout."""
    return np.flatnonzero(columns[1].any(axis=1))


def _between(
    x: Array | NDArray[np.float32], y: Array | NDArray[np.float32], parts: Parts, driven: Sequence[Places] = ()
) -> Array:
    """Products (2, b, p, q) of `x` (2, p, m) and `y` (2, q, m) within each part, in double precision.

    `driven`: places of the columns of both that the current has; all unless given.
    """
    products = np.zeros((2, len(parts), x.shape[1], y.shape[1]))
    rows, columns = driven or (np.arange(x.shape[1]), np.arange(y.shape[1]))
    current = np.zeros((len(parts), len(rows), len(columns)))
    for k, span in ((k, span) for k, part in enumerate(parts) for span in part):
        products[0, k] += _product(x[0, :, span], y[0, :, span])
        current[k] += _product(x[1, rows, span], y[1, columns, span])
    products[1][:, rows[:, None], columns] = current
    return products


def _product(x: Array | NDArray[np.float32], y: Array | NDArray[np.float32]) -> Array:
    """(p, q) products of the rows of `x` (p, m) and `y` (q, m), in double precision."""
    product: Array = x.astype(np.float64, copy=False) @ y.astype(np.float64, copy=False).T
    return product


def _over_repeats(x: Array, parts: Parts) -> Array:
    """Products (2, b, q, q) of `x` (n, 2, q, m) with itself, summed over the repeats."""
    products: Array = np.sum([_between(repeat, repeat, parts) for repeat in x], axis=0)
    return products
