from __future__ import annotations

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
    before, after = coordinates.predicted_squares(partialled_out(_folds(3.0), [1]), [0])
    assert before == pytest.approx(10_000 * 10.0, rel=0.05)
    assert after == pytest.approx(10_000, rel=0.05)


def test_a_function_that_is_not_there_predicts_nothing() -> None:
    before, after = coordinates.predicted_squares(partialled_out(_folds(0.0), [1]), [0])
    assert abs(before - after) < 10.0


def test_any_column_may_stand_in_the_place_of_the_residual() -> None:
    folds, order = partialled_out(_folds(3.0), [1]), [0, 2, 1]
    swapped = folds[:, order][:, :, order]
    both = coordinates.predicted_of(folds, [0], [-1, 1])
    for k, one in enumerate((folds, swapped)):
        assert [float(squares[k]) for squares in both] == pytest.approx(coordinates.predicted_squares(one, [0]))


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


def test_what_no_table_holds_stays_neutral() -> None:
    assert shape_fits.as_table(UnknownTerm("acceleration", np.arange(3.0), np.ones(3), 0.8)) == effects.NO_TABLE
