"""Bounded steps and errors of fitted amplitudes against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.gap.residuals.gram_matrices import Grams, mean_square_error

CLUSTERS, ROWS = 200, 10


def _grams(common: float) -> Grams:
    """Two columns of unit variance, amplitudes 2 and -1, noise with a part that is `common` to a cluster."""
    source = np.random.default_rng(4)
    x = source.standard_normal((CLUSTERS, ROWS, 2)) + source.standard_normal((CLUSTERS, 1, 2))
    noise = source.standard_normal((CLUSTERS, ROWS)) + common * source.standard_normal((CLUSTERS, 1))
    z = np.concatenate([x, (x @ np.array([2.0, -1.0]) + noise)[..., None]], axis=2)
    squares = np.swapaxes(z, 1, 2) @ z
    number = np.arange(CLUSTERS)
    return Grams(("a", "b"), squares, np.zeros_like(squares), np.zeros((CLUSTERS, 2)), number, 0 * number)


def _fitted(g: Grams) -> Grams:
    """The same around the least squares fit."""
    change = np.eye(3)
    change[:2, 2] = -np.linalg.solve(g.both.sum(axis=0)[:2, :2], g.both.sum(axis=0)[:2, 2])
    return g._replace(effort=change.T @ g.effort @ change)


def _error(g: Grams, precision: np.ndarray, mean: float = 0.0) -> float:
    """Of the first amplitude."""
    step, error = mean_square_error(g, ["a", "b"], np.array([mean, 0.0]), precision)
    return float(np.sqrt(error[0, 0] + step[0] ** 2))


def test_white_noise_gives_the_textbook_covariance() -> None:
    g = _fitted(_grams(0.0))
    white = np.linalg.inv(g.both.sum(axis=0)[:2, :2])
    _, found = mean_square_error(g, ["a", "b"], np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(np.diag(found), np.diag(white), rtol=0.3)


def test_noise_that_is_common_to_an_experiment_widens_it() -> None:
    """By the design effect 1 + (n - 1) rho_x rho_r of n rows, half of x's and of the noise's variance common."""
    white, clustered = (_error(_fitted(_grams(common)), np.zeros(2)) for common in (0.0, 1.0))
    expected = np.sqrt(2.0 * (1.0 + (ROWS - 1) * 0.25))  # twice the noise's variance
    assert 0.75 * expected < clustered / white < 1.25 * expected


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """Six experiments, each with noise of its own; the factor of Student takes their number into account."""
    source, held = np.random.default_rng(5), 0
    for _ in range(400):
        x, noise = source.standard_normal((6, ROWS, 1)), source.standard_normal((6, ROWS, 1))
        z = np.concatenate([x, noise], axis=2)
        square = np.swapaxes(z, 1, 2) @ z
        g = Grams(("a",), square, 0.0 * square, np.zeros((6, 2)), np.arange(6), np.zeros(6, int))
        whole = square.sum(axis=0)
        best = whole[0, 1] / whole[0, 0]
        change = np.array([[1.0, -best], [0.0, 1.0]])
        fitted = g._replace(effort=change.T @ square @ change)
        held += abs(best) < 1.96 * mean_square_error(fitted, ["a"], np.zeros(1), np.zeros(1))[1][0, 0] ** 0.5
    assert 0.92 < held / 400 < 0.98


def test_how_far_a_fit_is_from_what_is_most_probable_belongs_to_its_error() -> None:
    """The fit is at 0 and the data say 2."""
    assert _error(_grams(0.0), np.zeros(2)) == pytest.approx(2.0, abs=0.1)


def test_few_experiments_are_divided_in_the_order_of_time() -> None:
    g = _fitted(_grams(1.0))
    one, many = (g._replace(experiment=number) for number in (np.zeros(CLUSTERS, int), np.arange(CLUSTERS)))
    assert 0.3 < _error(one, np.zeros(2)) / _error(many, np.zeros(2)) < 3.0
    alone = one._replace(effort=one.effort[:1], current=one.current[:1], experiment=one.experiment[:1])
    assert np.isfinite(_error(alone, np.ones(2)))


def test_a_direction_that_the_data_do_not_excite_keeps_the_width_of_its_prior() -> None:
    g = _fitted(_grams(1.0))
    still = g.effort.copy()
    still[:, 0, :] = still[:, :, 0] = 0.0
    assert _error(g._replace(effort=still), np.array([4.0, 0.0])) == pytest.approx(0.5)
    assert _error(g._replace(effort=still), np.array([4.0, 0.0]), 2.0) == pytest.approx((0.25 + 4.0) ** 0.5)
    assert _error(g, np.array([1e9, 0.0])) == pytest.approx(1e-9**0.5, rel=0.01)
