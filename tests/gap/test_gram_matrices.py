"""The Gram matrices against their definition, in whatever steps the columns were added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.model_tracking import MeasuredPath
from stagectl.gap.residuals.run_products import first_fold

ROWS, STROKES, REPEATS = 60, 4, 3
SHARED, CLOCKED = ("a", "b", "c", "d"), ("warm", "step")


def _run(source: np.random.Generator) -> Run:
    path = MeasuredPath(np.zeros((ROWS, 3)), 0.0, 5e-4)
    cluster = np.repeat(np.arange(STROKES), ROWS // STROKES)
    weight = (source.random(ROWS) > 0.2).astype(np.float64)
    return Run("sine", (), (path,) * REPEATS, path, weight, cluster)


def _columns(source: np.random.Generator) -> dict[str, list[Array]]:
    shared = {name: [source.standard_normal((ROWS, 2))] for name in ("own", *SHARED)}
    clocked = {name: [source.standard_normal((ROWS, 2)) for _ in range(REPEATS)] for name in CLOCKED}
    return shared | clocked


def _defined(run: Run, x: Mapping[str, Sequence[Array]], residuals: Sequence[Array], names: Sequence[str]) -> Array:
    """(2, c, p + 1, p + 1) by ``sum_k [X_k r_k]' [X_k r_k]``, all less their part along the run's own column."""
    own = (run.weight[:, None] * x["own"][0]).T
    own /= np.linalg.norm(own)
    sums = np.zeros((2, STROKES, len(names) + 1, len(names) + 1))
    for k in range(len(residuals)):
        each = [
            (run.weight[:, None] * column).T
            for column in (*(x[name][k % len(x[name])] for name in names), residuals[k])
        ]
        z = np.stack([column - np.vdot(own, column) * own for column in each], axis=1)
        for stroke in range(STROKES):
            rows = z[:, :, run.cluster == stroke]
            sums[:, stroke] += rows @ np.swapaxes(rows, 1, 2)
    return sums


@pytest.mark.parametrize(
    "steps",
    [
        (("a", "b", "c", "d", "warm", "step"),),
        (("a", "warm"), ("b",), ("step", "c", "d")),
        (("a", "b"), ("c",), ("d",), ("warm", "step")),
    ],
)
@pytest.mark.parametrize("chosen", [None, ("d", "step", "a"), ("c", "b")])
def test_the_matrices_follow_their_definition(steps: Sequence[Sequence[str]], chosen: Sequence[str] | None) -> None:
    source = np.random.default_rng(5)
    runs = [_run(source), _run(source)]
    x = [_columns(source) for _ in runs]
    residuals = [[source.standard_normal((ROWS, 2)) for _ in range(REPEATS)] for _ in runs]
    p = gram_matrices.products(runs, [{name: columns[name] for name in ("own", *steps[0])} for columns in x], "own")
    for more in steps[1:]:
        p = gram_matrices.with_columns(p, [{name: columns[name] for name in more} for columns in x])
    names = [name for step in steps for name in step] if chosen is None else list(chosen)
    g = gram_matrices.grams(p if chosen is None else gram_matrices.selected(p, names), residuals)
    assert list(g.names) == names
    for k, (run, columns) in enumerate(zip(runs, x, strict=True)):
        wanted = _defined(run, columns, residuals[k], names)
        at = g.experiment == k
        np.testing.assert_allclose(g.effort[at], wanted[0], atol=2e-5)  # columns are kept in single precision
        np.testing.assert_allclose(g.current[at], wanted[1], atol=2e-5)


def test_one_residual_for_all_repeats_and_columns_added_to_selected_ones() -> None:
    """For the mean of repeats, columns that run on the clock count by their mean."""
    source = np.random.default_rng(8)
    run, x = _run(source), _columns(source)
    p = gram_matrices.products([run], [{name: x[name] for name in ("own", "a", "b", "warm")}], "own")
    p = gram_matrices.with_columns(gram_matrices.selected(p, ["warm", "a"]), [{"step": x["step"], "c": x["c"]}])
    mean = [[source.standard_normal((ROWS, 2))]]
    once = {name: [np.mean(each, axis=0)] for name, each in x.items()}
    wanted = _defined(run, once, mean[0], ("warm", "a", "step", "c"))
    g = gram_matrices.grams(p, mean)
    np.testing.assert_allclose(np.stack([g.effort, g.current]), wanted, atol=2e-5)


def test_adding_columns_does_not_change_existing_products() -> None:
    """Two searches go on from the same products: neither sees the columns of the other."""
    source = np.random.default_rng(6)
    run, x = _run(source), _columns(source)
    residuals = [[source.standard_normal((ROWS, 2)) for _ in range(REPEATS)]]
    p = gram_matrices.products([run], [{name: x[name] for name in ("own", "a", "warm")}], "own")
    before = gram_matrices.grams(p, residuals).effort.copy()
    gram_matrices.grams(gram_matrices.with_columns(p, [{"step": x["step"], "b": x["b"]}]), residuals)
    assert np.array_equal(gram_matrices.grams(p, residuals).effort, before)


@pytest.mark.parametrize("repeats", [1, REPEATS])
def test_fold_sums_are_the_sums_of_the_half_strokes_of_each_fold(repeats: int) -> None:
    """With folds of unequal size, and columns that run on the clock."""
    source = np.random.default_rng(7)
    runs = [_run(source), _run(source)._replace(cluster=np.repeat(np.arange(3), ROWS // 3))]
    x = [_columns(source) for _ in runs]
    residuals = [[source.standard_normal((ROWS, 2)) for _ in range(repeats)] for _ in runs]
    p = gram_matrices.products(runs, [{name: columns[name] for name in ("own", "a", "warm")} for columns in x], "own")
    p = gram_matrices.selected(
        gram_matrices.with_columns(p, [{name: columns[name] for name in ("b", "step")} for columns in x]),
        ["step", "b", "a"],
    )
    whole, sums = gram_matrices.grams(p, residuals), gram_matrices.fold_sums(p, residuals)
    assert sums.names == whole.names
    assert first_fold(sums.stroke).tolist() == [True, False]
    first = first_fold(whole.stroke)
    for channel in ("effort", "current", "floor"):
        strokes, folds = getattr(whole, channel), getattr(sums, channel)
        np.testing.assert_allclose(
            folds, [strokes[first].sum(axis=0), strokes[~first].sum(axis=0)], rtol=1e-12, atol=1e-12
        )


def test_a_drift_that_a_column_on_the_clock_explains_is_no_noise() -> None:
    source = np.random.default_rng(11)
    runs = [_run(source), _run(source)]
    x = [_columns(source) for _ in runs]
    p = gram_matrices.products(runs, x, "own")
    noise = [[source.standard_normal((ROWS, 2)) for _ in range(REPEATS)] for _ in runs]
    drift = [
        [r + 9.0 * warm for r, warm in zip(repeats, columns["warm"], strict=True)]
        for repeats, columns in zip(noise, x, strict=True)
    ]
    same = [[repeats[0]] * REPEATS for repeats in noise]
    plain, drifting = gram_matrices.noise(p, noise), gram_matrices.noise(p, drift)
    np.testing.assert_allclose(drifting, plain, rtol=1e-3)  # columns of a drift are kept in double precision
    assert (drifting < 0.2 * gram_matrices.fold_sums(p, drift).floor.sum(axis=0)).all()
    np.testing.assert_allclose(gram_matrices.noise(p, same), 0.0, atol=1e-9)


def test_repeats_differ_by_what_is_not_their_mean() -> None:
    """Of two runs with repeats and one without."""
    source = np.random.default_rng(17)
    runs = [_run(source), _run(source), _run(source)]
    runs[1] = runs[1]._replace(paths=runs[1].paths[:1])
    x = [_columns(source) for _ in runs]
    x[1] = {name: column[:1] for name, column in x[1].items()}
    residuals = [[source.standard_normal((ROWS, 2)) for _ in run.paths] for run in runs]
    p = gram_matrices.products(runs, [{name: columns[name] for name in ("a", "warm", "b")} for columns in x])
    found = gram_matrices.differences(p, residuals)
    expected = np.zeros((2, 2, 2))
    for run, columns, repeats in zip(runs, x, residuals, strict=True):
        rows = [np.stack([warm, r]) * run.weight[:, None] for warm, r in zip(columns["warm"], repeats, strict=True)]
        for deviation in np.array(rows) - np.mean(rows, axis=0):
            expected += np.einsum("imc,jmc->cij", deviation, deviation)
    assert found.places == (1,)
    np.testing.assert_allclose(found.square, expected, rtol=1e-9)
    assert gram_matrices.unexplained(found.square[0]) == pytest.approx(
        expected[0, 1, 1] - expected[0, 0, 1] ** 2 / expected[0, 0, 0]
    )


def test_without_a_clock_the_noise_is_what_repeats_differ_by() -> None:
    source = np.random.default_rng(12)
    run, x = _run(source), _columns(source)
    p = gram_matrices.products([run], [{name: x[name] for name in ("own", *SHARED)}], "own")
    residuals = [[source.standard_normal((ROWS, 2)) for _ in range(REPEATS)]]
    floor = gram_matrices.fold_sums(p, residuals).floor.sum(axis=0)
    np.testing.assert_allclose(gram_matrices.noise(p, residuals), floor)


def test_the_products_kept_do_not_grow_with_the_number_of_half_strokes() -> None:
    """A leg that hops for minutes makes thousands of them, and each would hold a matrix of all columns."""
    source = np.random.default_rng(13)
    run, x = _run(source), _columns(source)
    many = run._replace(cluster=np.arange(ROWS))
    few, most = (gram_matrices.products([each], [x], "own").parts[0] for each in (run, many))
    assert [array.nbytes for block in few.blocks for array in block] == [
        array.nbytes for block in most.blocks for array in block
    ]


def test_what_was_recorded_once_is_as_noisy_as_the_repeats() -> None:
    """Where some experiments were repeated and others not, no noise may pass for what repeats."""
    source = np.random.default_rng(3)
    runs = [_run(source)._replace(weight=np.ones(ROWS), rests=()) for _ in range(40)]
    once = [run if k % 2 else run._replace(paths=run.paths[:1]) for k, run in enumerate(runs)]
    residuals = [[source.standard_normal((ROWS, 2)) for _ in run.paths] for run in once]
    columns = [{"a": [np.ones((ROWS, 2))]} for _ in once]
    p = gram_matrices.products(once, columns)
    whole = sum(len(run.paths) for run in once) * ROWS
    for floor in (gram_matrices.noise(p, residuals), gram_matrices.fold_sums(p, residuals).floor.sum(axis=0)):
        np.testing.assert_allclose(floor, whole, rtol=0.1)
    g = gram_matrices.grams(p, residuals)
    at = np.isin(g.experiment, [k for k, run in enumerate(once) if len(run.paths) == 1])
    np.testing.assert_allclose(g.floor[at].sum(axis=0), 20 * ROWS, rtol=0.1)
    np.testing.assert_allclose(g.floor.sum(axis=0), whole, rtol=0.1)
