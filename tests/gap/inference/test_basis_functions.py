from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.gap.inference import basis_functions, coordinates, shape_fits
from stagectl.gap.residuals.gram_matrices import partialled_out
from stagectl.gap.result.diagnosis import UnknownTerm
from stagectl.kernels import effects


def test_the_way_since_a_reversal_is_that_of_a_triangle() -> None:
    up = np.linspace(0.0, 1.0, 101)
    position = np.concatenate([up, up[-2::-1], up[1:51]])
    travel = basis_functions.since_reversal(position, 0.015)
    np.testing.assert_allclose(travel[50:100], position[50:100], atol=1e-12)
    np.testing.assert_allclose(travel[103:200], 1.0 - position[103:200], atol=1e-12)
    np.testing.assert_allclose(travel[204:], position[204:], atol=1e-12)


def test_jitter_below_the_threshold_is_no_reversal() -> None:
    position = np.linspace(0.0, 1.0, 1000) + 0.002 * np.random.default_rng(3).standard_normal(1000)
    assert basis_functions.since_reversal(position, 0.05)[-1] == pytest.approx(1.0, abs=0.07)


def test_hats_are_one_together_and_straight_between() -> None:
    nodes = np.array([0.0, 1.0, 3.0, 7.0])
    x = np.linspace(-1.0, 8.0, 50)
    basis = basis_functions.hats(nodes)(x)
    np.testing.assert_allclose(basis.sum(axis=0), 1.0)
    inside = (x >= 0.0) & (x <= 7.0)
    np.testing.assert_allclose((nodes @ basis)[inside], x[inside])


def _folds(signal: float, clusters: int = 2) -> np.ndarray:
    """Two hands of [column, nuisance, residual], the residual `signal` times the column and noise of one."""
    random = np.random.default_rng(11)
    sums = []
    for _ in range(clusters):
        column, nuisance, noise = random.standard_normal((3, 5000))
        z = np.stack([column, nuisance, signal * column + noise])
        sums.append(z @ z.T)
    return np.array(sums)


def test_a_function_predicts_what_it_holds() -> None:
    (before,), (after,), _ = coordinates.predicted_of(partialled_out(_folds(3.0), [1]), [0], [-1])
    assert before == pytest.approx(10_000 * 10.0, rel=0.05)
    assert after == pytest.approx(10_000, rel=0.05)


def test_a_function_that_is_not_there_predicts_nothing() -> None:
    (before,), (after,), _ = coordinates.predicted_of(partialled_out(_folds(0.0), [1]), [0], [-1])
    assert abs(before - after) < 10.0


def test_any_column_may_stand_in_the_place_of_the_residual() -> None:
    folds, order = partialled_out(_folds(3.0), [1]), [0, 2, 1]
    swapped = folds[:, order][:, :, order]
    both = coordinates.predicted_of(folds, [0], [-1, 1])
    for k, one in enumerate((folds, swapped)):
        alone = coordinates.predicted_of(one, [0], [-1])
        assert [squares[k] for squares in both[:2]] == pytest.approx([squares[0] for squares in alone[:2]])


def test_a_function_that_follows_every_error_takes_a_ridge() -> None:
    """Twenty columns, one of which holds the residual; the others follow the errors of 22 rows."""
    random, folds = np.random.default_rng(5), []
    for _ in range(2):
        columns = random.standard_normal((20, 22)) * np.array([1.0, *[0.2] * 19])[:, None]
        rows = np.vstack([columns, columns[0] + random.standard_normal(22)])
        folds.append(rows @ rows.T)
    free, every = np.array(folds), list(range(20))
    (before,), (after,), (ridge,) = coordinates.predicted_of(free, every, [-1])
    stiff = [coordinates.ridge_fit(free[k], every, 1e-3) for k in (0, 1)]
    left = [np.append(-stiff[k], 1.0) @ free[1 - k] @ np.append(-stiff[k], 1.0) for k in (0, 1)]
    assert sum(left) > before  # with the smallest ridge it predicts less than nothing
    assert ridge > 1e-3 and before - after > 0.2 * before


def _motion(position: np.ndarray) -> basis_functions.RunMotion:
    still = np.zeros(len(position))
    return basis_functions.RunMotion(position, still, still, np.full(len(position), np.inf), still)


def test_nodes_over_the_place_stand_where_most_is_left() -> None:
    """Half of them within the damaged millimetre of a stroke of 100 mm, the others evenly spaced."""
    size: Any = SimpleNamespace(centre=0.0, stroke=0.05, length=1e-5)
    position = np.linspace(-0.05, 0.05, 40_001)
    pulse = np.where(np.abs(position - 0.02) < 5e-4, 1.0, 0.0)
    nodes = basis_functions.place_nodes(size, [_motion(position)], [pulse])
    assert nodes[[0, -1]] == pytest.approx([-0.05, 0.05]) and np.all(np.diff(nodes) > 0.0)
    assert np.sum(np.abs(nodes - 0.02) < 6e-4) == pytest.approx(0.5 * len(nodes), abs=1.5)
    even = basis_functions.place_nodes(size, [_motion(position)], [np.zeros(len(position))])
    assert even == pytest.approx(np.linspace(-0.05, 0.05, len(even)))


def test_what_is_left_beside_a_reversal_draws_no_node() -> None:
    size: Any = SimpleNamespace(centre=0.0, stroke=0.05, length=1e-3)
    position = np.linspace(-0.05, 0.05, 40_001)
    motion = _motion(position)._replace(since=position + 0.05)
    left = np.where(position < -0.046, 1.0, 0.0)
    even = np.linspace(-0.05, 0.05, len(basis_functions.place_nodes(size, [motion], [left])))
    assert basis_functions.place_nodes(size, [motion], [left]) == pytest.approx(even, abs=1e-12)


@pytest.mark.parametrize(
    ("coordinate", "code"), [("speed", effects.VELOCITY), ("position", effects.POSITION), ("current", effects.CURRENT)]
)
def test_the_table_opposes_what_the_force_drives(coordinate: str, code: int) -> None:
    grid = np.linspace(-2.0, 2.0, 9)
    shape = UnknownTerm(coordinate, grid, 0.3 * grid**2 + grid, 0.8, (("residual.coordinate", "any"),))
    p = shape_fits.as_table(shape)
    assert p.coordinate == code
    for x, force in zip(grid.tolist(), shape.force.tolist(), strict=True):
        assert effects.looked_up(p, x) == pytest.approx(-force)


def test_a_speed_without_sign_goes_into_the_table_of_speeds() -> None:
    grid = np.linspace(0.0, 2.0, 9)
    shape = UnknownTerm("speed", grid, grid, 0.8, (("residual.coordinate", "speed"),))
    assert shape_fits.as_table(shape).coordinate == effects.SPEED
