"""All that a fit needs to know of the data, in one small matrix for each fold or half stroke.

With columns X and residual r of a half stroke c, ``G_c = [X r]' [X r]``, summed over the repeats.  Sums of these give
any fit, on any part of the data, to any set of columns, without touching the rows again.  Leaving out an experiment,
resampling half strokes or trying thousands of sets therefore costs microseconds.

::

    columns of each run --> products: X' X, once --> with_columns: further columns --> grams: with a residual
                                                                                   --> fold_sums: summed over the folds
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import least_squares, run_products
from stagectl.gap.residuals.half_strokes import Run, noise_of_all, samples
from stagectl.gap.residuals.run_products import RunProducts
from stagectl.gap.residuals.thresholds import FLAT, LEAST_BLOCKS, SINGULAR_NUISANCE
from stagectl.number_format import NORMAL as NORMAL
from stagectl.parallel import in_parallel

FOLDS = (0, 2)  # numbers of half strokes that stand for a whole fold: `first_fold` sorts them like its members


class Grams(NamedTuple):
    """Gram matrices of all half strokes, or of the two folds; the residual is the last row and column."""

    names: tuple[str, ...]  # of the columns
    effort: Array  # (c, p + 1, p + 1) of the residual effort
    current: Array  # (c, p + 1, p + 1) of the missing current
    floor: Array  # (c, 2) sum of squares that repeats differ by, of effort and current
    experiment: NDArray[np.int64]  # (c,) number of the run
    stroke: NDArray[np.int64]  # (c,) number of the half stroke in its run

    @property
    def both(self) -> Array:
        """(c, p + 1, p + 1) of effort and current together."""
        return self.effort + self.current

    def places(self, names: Sequence[str]) -> list[int]:
        """Places of columns in the matrices."""
        place = {name: k for k, name in enumerate(self.names)}
        return [place[name] for name in names]


class Products(NamedTuple):
    """Columns of all runs with their products."""

    names: tuple[str, ...]
    parts: tuple[RunProducts, ...]


Columns = Sequence[Mapping[str, Sequence[Array]]]  # of each run, by name: (m, 2), one for all repeats or one each


def products(runs: Sequence[Run], columns: Columns, own: str = "") -> Products:
    """Products of all columns.  `own` names a column with an amplitude per run; it is taken out of all others first."""
    names = tuple(name for name in columns[0] if name != own)
    empty = [
        run_products.without_columns(run, by_name.get(own, ())) for run, by_name in zip(runs, columns, strict=True)
    ]
    return with_columns(Products((), tuple(empty)), [{name: by_name[name] for name in names} for by_name in columns])


def with_columns(p: Products, columns: Columns) -> Products:
    """`p` with more columns."""
    if not columns[0]:
        return p
    pairs = list(zip(p.parts, columns, strict=True))
    parts = in_parallel(lambda pair: run_products.with_columns(*pair), pairs)
    return Products((*p.names, *columns[0]), tuple(parts))


def with_columns_by_run(p: Products, columns_of: Callable[[Run], Mapping[str, Sequence[Array]]]) -> Products:
    """`p` with more columns, made and multiplied run by run, so that only a few runs are in memory twice."""
    joined = in_parallel(lambda part: with_columns(p._replace(parts=(part,)), [columns_of(part.run)]), p.parts)
    return Products(joined[0].names, tuple(single.parts[0] for single in joined))


def selected(p: Products, names: Sequence[str]) -> Products:
    """`p` with these of its columns, in this order."""
    place = {name: k for k, name in enumerate(p.names)}
    places = [place[name] for name in names]
    return Products(tuple(names), tuple(in_parallel(lambda part: run_products.selected(part, places), p.parts)))


def grams(p: Products, residuals: Sequence[Sequence[Array]]) -> Grams:
    """The matrices of all half strokes, with the residuals (m, 2) of each run and repeat; for a few columns."""
    found = in_parallel(lambda run: run_products.of_strokes(*run), list(zip(p.parts, residuals, strict=True)))
    square, floor = (np.concatenate([run[k] for run in found], axis=1) for k in (0, 1))
    counts = [run.floor.shape[1] for run in found]
    stroke = np.concatenate([np.arange(count) for count in counts])
    floor = _with_recorded_once(p, floor)
    return Grams(p.names, square[0], square[1], floor.T, np.repeat(np.arange(len(counts)), counts), stroke)


def _with_recorded_once(p: Products, floor: Array) -> Array:
    """`floor` (2, c) of all half strokes, with the noise of those that were recorded once: as much in each sample."""
    runs = [part.run for part in p.parts]
    counts = [samples(run) for run in runs]
    each = np.concatenate(counts)
    repeated = np.repeat([len(run.paths) > 1 for run in runs], [len(of_run) for of_run in counts])
    known = float(each[repeated].sum())
    rate = floor[:, repeated].sum(axis=1) / known if known else np.zeros(2)
    return np.where(repeated, floor, rate[:, None] * each)


def fold_sums(p: Products, residuals: Sequence[Sequence[Array]]) -> Grams:
    """`grams` summed over the two folds at once: all that a score needs, for a tenth of the work."""
    found = in_parallel(lambda run: run_products.of_folds(*run), list(zip(p.parts, residuals, strict=True)))
    square, floor = (np.sum([run[k] for run in found], axis=0) for k in (0, 1))
    floor = floor * noise_of_all([part.run for part in p.parts])
    return Grams(p.names, square[0], square[1], floor.T, np.zeros(2, np.int64), np.array(FOLDS))


def noise(p: Products, residuals: Sequence[Sequence[Array]]) -> Array:
    """(2,) sum of squares that repeats differ by, without what the columns on the clock explain: no drift is noise."""
    counts = [len(repeats) for repeats in residuals]
    of_repeats = [count / max(count - 1, 1) for count in counts]  # their mean has taken a part of the noise
    summed = differences(p, residuals, of_repeats).square * noise_of_all([part.run for part in p.parts])
    return np.array([unexplained(cut) for cut in summed])


class Differences(NamedTuple):
    """What the repeats of all experiments differ by, summed over them."""

    places: tuple[int, ...]  # of the columns that run on the clock: all others are the same in every repeat
    square: Array  # (2, q + 1, q + 1) products of these columns' deviations and the residual's, which is the last


def differences(
    p: Products, residuals: Sequence[Sequence[Array]], weights: Sequence[float] | None = None
) -> Differences:
    """Of the residuals (m, 2) of each run and repeat; `weights` of the runs, one unless given."""
    weights = weights or [1.0] * len(p.parts)
    rows = list(zip(p.parts, residuals, weights, strict=True))
    squares = [run_products.differences(part, repeats) * weight for part, repeats, weight in rows]
    widest = max(square.shape[1] for square in squares)  # a run without repeats has none of these columns
    places = next((part.clocked.places for part in p.parts if part.clocked is not None), ())
    return Differences(places, np.sum([square for square in squares if square.shape[1] == widest], axis=0))


def unexplained(square: Array) -> float:
    """Sum of squares that all columns of `square` (q + 1, q + 1) leave of its last one."""
    return least_squares.fit(square, range(len(square) - 1)).residual_sum_of_squares


class MeanSquareError(NamedTuple):
    """Of amplitudes that data and a prior say."""

    step: Array  # (k,) from the fit to them
    between: Array  # (k, k) square error by which parts of the data contradict each other
    prior: Array  # (k, k) what the prior's width adds where the data say little

    @property
    def whole(self) -> Array:
        """(k, k) of the values of the fit."""
        return self.between + self.prior + np.outer(self.step, self.step)


def mean_square_error(parts: Array, places: Sequence[int], mean: Array, precision: Array) -> MeanSquareError:
    """Of the columns at `places`.

    The prior lies at `mean` (k,) with the `precision` (k,): a direction that the data do not excite keeps its width.
    The `parts` (b, p + 1, p + 1) of the data contradict each other by what each pulls the fit by.  A part that says
    most of a value has pulled the fit to itself, and the others say little without it: each pull counts as the
    bias-reduced linearization has it, that is, for parts that say equally much as the jackknife has it, with Student's
    factor of 95 % for their number.  Source: R. M. Bell, D. F. McCaffrey, Survey Methodology 28(2), 2002.
    """
    prior, whole, count = np.diag(precision), parts.sum(axis=0), len(parts)
    known, rows = whole[np.ix_(places, places)] + prior, parts[:, places]
    inverse = least_squares.inverse(known)
    step: Array = inverse @ (whole[places, -1] + precision * mean)
    if count < 2:  # no part contradicts another
        return MeanSquareError(step, 0.0 * inverse, inverse)
    apart = _pulls(known, rows[:, :, places], rows[:, :, -1] - rows[:, :, places] @ step)
    factor = (student_t.ppf(0.975, count - 1) / NORMAL) ** 2
    return MeanSquareError(step, factor * apart.T @ apart, inverse @ prior @ inverse)


def _pulls(known: Array, parts: Array, force: Array) -> Array:
    """(b, k) What each of `parts` (b, k, k) of the normal equations `known` moves the solution by, with its `force`.

    Of a direction that a part alone says, it says nothing against the others.
    """
    scale = least_squares.column_lengths(known)
    size, axes = np.linalg.eigh(known / np.outer(scale, scale))
    root = np.where(size > FLAT * size[-1], 1.0 / np.sqrt(np.maximum(size, FLAT * size[-1])), 0.0)
    to_unit = root[:, None] * axes.T / scale  # (k, k) in whose coordinates `known` is one
    share, own = np.linalg.eigh(to_unit @ parts @ to_unit.T)
    of_others = 1.0 - share
    weight = np.where(of_others > FLAT, np.maximum(of_others, FLAT) ** -0.5, 0.0)
    along = np.einsum("bij,bi->bj", own, force @ to_unit.T)
    pulls: Array = np.einsum("bij,bj->bi", own, weight * along) @ to_unit
    return pulls


def by_experiment(g: Grams) -> Array:
    """Sums (b, 2, p + 1, p + 1) over experiments, or parts of them in the order of time where there are few."""
    experiments = [np.flatnonzero(g.experiment == number) for number in np.unique(g.experiment)]
    pieces = -(-LEAST_BLOCKS // len(experiments))
    blocks = [block for strokes in experiments for block in np.array_split(strokes, pieces) if len(block)]
    return np.array([[cut[block].sum(axis=0) for cut in (g.effort, g.current)] for block in blocks])


def folds(g: Grams, channel: Array) -> Array:
    """(2, p + 1, p + 1) sums of the matrices (c, p + 1, p + 1) of one channel over the two folds of half strokes."""
    first = run_products.first_fold(g.stroke).astype(np.float64)
    return np.stack([np.tensordot(fold, channel, 1) for fold in (first, 1.0 - first)])


def partialled_out(both: Array, nuisance: Sequence[int]) -> Array:
    """The folds (2, p + 1, p + 1) with all columns and the residual less what the nuisances explain on all data."""
    g, n = both.sum(axis=0), list(nuisance)
    a = g[np.ix_(n, n)] + least_squares.ridge(g[n, n])
    scale = least_squares.column_lengths(a)
    explained = np.linalg.pinv(a / np.outer(scale, scale), rcond=SINGULAR_NUISANCE, hermitian=True) @ (
        g[n] / scale[:, None]
    )
    explained = explained / scale[:, None]
    crossed = both[:, :, n] @ explained  # columns against what nuisances make of the others
    free: Array = both - crossed - np.swapaxes(crossed, 1, 2) + explained.T @ both[:, n][:, :, n] @ explained
    return free
