"""Products of the columns of one run, for each of its half strokes and summed over its two folds.

Most columns are the same in every repeat.  A column that runs on the session clock is not; it counts by its mean over
the repeats and by each repeat's deviation from it: ``sum_k X_k' X_k = n X' X + sum_k dX_k' dX_k``.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.half_strokes import Run, spans


class Block(NamedTuple):
    """Some columns of one run, with their products with all columns of the blocks before and with themselves."""

    mean: NDArray[np.float32]  # (2, q, m) weighted, less their part along `own`; single precision: they fill the memory
    square: Array  # (2, c, p + q, q)
    folds: Array  # (2, 2, p + q, q) the same, summed over the folds


class ClockColumns(NamedTuple):
    """The columns of one run that differ from repeat to repeat."""

    places: tuple[int, ...]
    deviation: Array  # (n, 2, q, m) of each repeat from the mean
    square: Array  # (2, c, q, q) products of the deviations, summed over the repeats


class ResidualColumn(NamedTuple):
    """The residual's products with all columns and with itself: the last column of the Gram matrices."""

    products: Array  # (2, c, p + 1, 1), summed over the repeats
    floor: Array  # (2, c) sum of squares that repeats differ by
    repeats: int


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


def fold_sums(strokes: Array) -> Array:
    """(2, 2, ...) sums over the folds of the half strokes (2, c, ...) of one run."""
    first = first_fold(np.arange(strokes.shape[1]))
    return np.stack([strokes[:, fold].sum(axis=1) for fold in (first, ~first)], axis=1)


def without_columns(run: Run, own: Sequence[Array]) -> RunProducts:
    """A run with its own column (m, 2), if it has one, and no others yet."""
    if not own:
        return RunProducts(run, np.zeros((2, len(run.weight))), (), None)
    weighted = (own[0] * run.weight[:, None]).T
    length = float(np.sqrt(np.sum(weighted * weighted)))
    return RunProducts(run, weighted / length if length > 0.0 else weighted, (), None)


def with_columns(p: RunProducts, columns: Mapping[str, Sequence[Array]]) -> RunProducts:
    """`p` with more columns; products that exist are not multiplied again."""
    count, strokes = sum(block.mean.shape[1] for block in p.blocks), spans(p.run.cluster)
    separated = [_mean_and_deviation(p, repeats) for repeats in columns.values()]
    mean = np.stack([column for column, _ in separated], axis=1)
    square = np.concatenate(
        [*(_between(block.mean, mean, strokes) for block in p.blocks), _between(mean, mean, strokes)], axis=2
    )
    deviations = {count + k: deviation for k, (_, deviation) in enumerate(separated) if deviation is not None}
    clocked = _with_clocked(p.clocked, deviations, strokes) if deviations else p.clocked
    block = Block(mean.astype(np.float32), square, fold_sums(square))
    return p._replace(blocks=(*p.blocks, block), clocked=clocked)


def _with_clocked(p: ClockColumns | None, deviations: Mapping[int, Array], strokes: Sequence[slice]) -> ClockColumns:
    new = np.stack(list(deviations.values()), axis=2)
    deviation = new if p is None else np.concatenate([p.deviation, new], axis=2)
    places = (*(() if p is None else p.places), *deviations)
    return ClockColumns(places, deviation, _over_repeats(deviation, strokes))


def _mean_and_deviation(p: RunProducts, repeats: Sequence[Array]) -> tuple[Array, Array | None]:
    """Mean (2, m) of a column over the repeats, and each repeat's deviation (n, 2, m); None where there is only one."""
    columns = [p.weighted(column) for column in repeats]
    if len(columns) == 1:
        return columns[0], None
    mean: Array = np.mean(columns, axis=0)
    return mean, np.stack(columns) - mean


def residual_column(p: RunProducts, residuals: Sequence[Array]) -> ResidualColumn:
    """The last column of the matrices, from the residual (m, 2) of each repeat."""
    strokes, repeats = spans(p.run.cluster), len(residuals)
    rows = np.stack([p.weighted(residual) for residual in residuals])
    mean = rows.mean(axis=0)
    deviation = (rows - mean)[:, :, None]
    noise, last = _over_repeats(deviation, strokes), mean[:, None]
    products = [*(_between(block.mean, last, strokes) for block in p.blocks), _between(last, last, strokes)]
    column = repeats * np.concatenate(products, axis=2)
    column[:, :, -1:] += noise
    if p.clocked is not None and repeats > 1:  # a mean of repeats has a single clock
        pairs = zip(p.clocked.deviation, deviation, strict=True)
        column[:, :, list(p.clocked.places)] += sum(_between(clocked, own, strokes) for clocked, own in pairs)
    return ResidualColumn(column, noise[:, :, 0, 0] * repeats / max(repeats - 1, 1), repeats)


def differences(p: RunProducts, residuals: Sequence[Array]) -> Array:
    """(2, q + 1, q + 1) products of what repeats differ by: of the columns on the clock, and of the residual, the last.

    Scaled to the size of the repeats themselves; without repeats there are no differences.
    """
    clocked = () if p.clocked is None else p.clocked.places
    square, repeats = np.zeros((2, len(clocked) + 1, len(clocked) + 1)), len(residuals)
    if repeats < 2:
        return square
    rows = np.stack([p.weighted(residual) for residual in residuals])
    last = (rows - rows.mean(axis=0))[:, :, None]
    both = last if p.clocked is None else np.concatenate([p.clocked.deviation, last], axis=2)
    square += _over_repeats(both, [slice(None)])[:, 0]
    return square * (repeats / (repeats - 1))


def fill(square: Array, p: RunProducts, last: ResidualColumn, folded: bool) -> None:
    """Write the Gram matrices (2, c, p + 1, p + 1) of the half strokes, or of the two folds, into `square`."""
    start = 0
    for block in p.blocks:
        start = _fill_block(square, block.folds if folded else block.square, start, last.repeats)
    _fill_block(square, fold_sums(last.products) if folded else last.products, start, 1.0)
    if p.clocked is not None and last.repeats > 1:
        at = list(p.clocked.places)
        square[:, :, np.array(at)[:, None], at] += fold_sums(p.clocked.square) if folded else p.clocked.square


def _fill_block(square: Array, block: Array, start: int, factor: float) -> int:
    """Write `factor` times the (2, c, p + q, q) of a block to both sides of the diagonal; return where it ends."""
    end: int = start + block.shape[3]
    np.multiply(block, factor, out=square[:, :, :end, start:end])
    square[:, :, start:end, :start] = np.swapaxes(square[:, :, :start, start:end], 2, 3)
    return end


def selected(p: RunProducts, places: Sequence[int]) -> RunProducts:
    """The columns at `places`, in this order, in one block."""
    count = len(places)
    means = np.empty((2, count, len(p.run.weight)), np.float32)
    square = np.empty((2, len(spans(p.run.cluster)), count, count))
    start = 0
    for block in p.blocks:
        end = start + block.mean.shape[1]
        rows, columns = ([k for k, place in enumerate(places) if low <= place < end] for low in (0, start))
        values = block.square[:, :, [places[k] for k in rows]][..., [places[k] - start for k in columns]]
        means[:, columns] = block.mean[:, [places[k] - start for k in columns]]
        square[:, :, np.array(rows, dtype=np.intp)[:, None], columns] = values
        square[:, :, np.array(columns, dtype=np.intp)[:, None], rows] = np.swapaxes(values, 2, 3)
        start = end
    block = Block(means, square, fold_sums(square))
    return p._replace(blocks=(block,), clocked=_selected_clocked(p.clocked, places))


def _selected_clocked(p: ClockColumns | None, places: Sequence[int]) -> ClockColumns | None:
    kept = [] if p is None else [(places.index(place), k) for k, place in enumerate(p.places) if place in places]
    if p is None or not kept:
        return None
    within = np.array([k for _, k in kept])
    return ClockColumns(
        tuple(place for place, _ in kept), p.deviation[:, :, within], p.square[:, :, within[:, None], within]
    )


def _between(x: Array | NDArray[np.float32], y: Array, strokes: Sequence[slice]) -> Array:
    """Products (2, c, p, q) of `x` (2, p, m) and `y` (2, q, m) within each half stroke, in double precision."""
    products: Array = np.stack(
        [[left[:, span] @ right[:, span].T for span in strokes] for left, right in zip(x, y, strict=True)]
    )
    return products


def _over_repeats(x: Array, strokes: Sequence[slice]) -> Array:
    """Products (2, c, q, q) of `x` (n, 2, q, m) with itself, summed over the repeats."""
    products: Array = np.sum([_between(repeat, repeat, strokes) for repeat in x], axis=0)
    return products
