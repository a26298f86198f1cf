"""Bounded steps and errors of fitted amplitudes against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.gap.residuals.gram_matrices import Grams, by_experiment, mean_square_error

CLUSTERS, ROWS = 200, 10
BOTH = [0, 1]
Array = NDArray[np.float64]


def _parts(common: float) -> Array:
    """Two columns of unit variance, amplitudes 2 and -1, noise with a part that is `common` to a cluster."""
    source = np.random.default_rng(4)
    x = source.standard_normal((CLUSTERS, ROWS, 2)) + source.standard_normal((CLUSTERS, 1, 2))
    noise = source.standard_normal((CLUSTERS, ROWS)) + common * source.standard_normal((CLUSTERS, 1))
    return _squares(np.concatenate([x, (x @ np.array([2.0, -1.0]) + noise)[..., None]], axis=2))


def _squares(z: Array) -> Array:
    return np.asarray(np.swapaxes(z, 1, 2) @ z)


def _fitted(parts: Array) -> Array:
    """The same around the least squares fit."""
    change = np.eye(parts.shape[-1])
    whole = parts.sum(axis=0)
    change[:-1, -1] = -np.linalg.solve(whole[:-1, :-1], whole[:-1, -1])
    return np.asarray(change.T @ parts @ change)


def _error(parts: Array, precision: Array, mean: float = 0.0) -> float:
    """Of the first amplitude."""
    return float(mean_square_error(parts, BOTH, np.array([mean, 0.0]), precision).whole[0, 0] ** 0.5)


def test_white_noise_gives_the_textbook_covariance() -> None:
    parts = _fitted(_parts(0.0))
    white = np.linalg.inv(parts.sum(axis=0)[:2, :2])
    found = mean_square_error(parts, BOTH, np.zeros(2), np.zeros(2)).between
    np.testing.assert_allclose(np.diag(found), np.diag(white), rtol=0.3)


def test_noise_that_is_common_to_an_experiment_widens_it() -> None:
    """By the design effect 1 + (n - 1) rho_x rho_r of n rows, half of x's and of the noise's variance common."""
    white, clustered = (_error(_fitted(_parts(common)), np.zeros(2)) for common in (0.0, 1.0))
    expected = np.sqrt(2.0 * (1.0 + (ROWS - 1) * 0.25))  # twice the noise's variance
    assert 0.75 * expected < clustered / white < 1.25 * expected


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """Six experiments, each with noise of its own; the factor of Student takes their number into account."""
    source, held = np.random.default_rng(5), 0
    for _ in range(400):
        x, noise = source.standard_normal((6, ROWS, 1)), source.standard_normal((6, ROWS, 1))
        square = _squares(np.concatenate([x, noise], axis=2))
        whole = square.sum(axis=0)
        best, fitted = whole[0, 1] / whole[0, 0], _fitted(square)
        held += abs(best) < 1.96 * mean_square_error(fitted, [0], np.zeros(1), np.zeros(1)).between[0, 0] ** 0.5
    assert 0.92 < held / 400 < 0.98


def test_how_far_a_fit_is_from_what_is_most_probable_belongs_to_its_error() -> None:
    """The fit is at 0 and the data say 2."""
    assert _error(_parts(0.0), np.zeros(2)) == pytest.approx(2.0, abs=0.1)


def test_few_experiments_are_divided_in_the_order_of_time() -> None:
    effort, nothing = _fitted(_parts(1.0)), np.zeros((CLUSTERS, 2))
    one, many = (
        by_experiment(Grams(("a", "b"), effort, 0.0 * effort, nothing, number, np.arange(CLUSTERS))).sum(axis=1)
        for number in (np.zeros(CLUSTERS, int), np.arange(CLUSTERS))
    )
    assert len(one) == 5 and len(many) == CLUSTERS
    assert 0.3 < _error(one, np.zeros(2)) / _error(many, np.zeros(2)) < 3.0
    assert np.isfinite(_error(effort[:1], np.ones(2)))


def test_a_direction_that_the_data_do_not_excite_keeps_the_width_of_its_prior() -> None:
    parts = _fitted(_parts(1.0))
    still = parts.copy()
    still[:, 0, :] = still[:, :, 0] = 0.0
    assert _error(still, np.array([4.0, 0.0])) == pytest.approx(0.5)
    assert _error(still, np.array([4.0, 0.0]), 2.0) == pytest.approx((0.25 + 4.0) ** 0.5)
    assert _error(parts, np.array([1e9, 0.0])) == pytest.approx(1e-9**0.5, rel=0.01)


def test_a_value_that_parts_of_the_data_contradict_is_not_known() -> None:
    """No noise within the parts: half of them say +1, half -1."""
    parts = _squares(np.array([[[10.0, 10.0 * sign]] for sign in (1.0, -1.0, 1.0, -1.0, 1.0, -1.0)]))
    assert mean_square_error(parts, [0], np.zeros(1), np.zeros(1)).between[0, 0] ** 0.5 > 0.4


def test_what_a_part_that_says_most_is_off_by_is_what_it_pulls_and_not_what_the_rest_says_without_it() -> None:
    """One of eight parts says a hundred times as much: left out, the others would say five times the error."""
    source, sizes = np.random.default_rng(6), np.array([100.0, *([1.0] * 7)])
    squares, found = [], []
    for _ in range(2000):
        off = source.standard_normal(8) / np.sqrt(sizes)
        parts = _fitted(np.array([[[n, n * x], [n * x, n * x * x]] for n, x in zip(sizes, off, strict=True)]))
        squares.append(float(sizes @ off / sizes.sum()) ** 2)
        found.append(mean_square_error(parts, [0], np.zeros(1), np.zeros(1)).between[0, 0])
    student = (2.365 / 1.96) ** 2
    assert np.mean(found) == pytest.approx(student * np.mean(squares), rel=0.15)
