"""Bounded steps and the clustered covariance against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.gap.residuals.gram_matrices import Grams, bounded_step, clustered_covariance, standard_deviations

CLUSTERS, ROWS = 200, 10


def _grams(common: float) -> Grams:
    """Two columns of unit variance, amplitudes 2 and -1, noise with a part that is `common` to a cluster."""
    source = np.random.default_rng(4)
    x = source.standard_normal((CLUSTERS, ROWS, 2)) + source.standard_normal((CLUSTERS, 1, 2))
    noise = source.standard_normal((CLUSTERS, ROWS)) + common * source.standard_normal((CLUSTERS, 1))
    z = np.concatenate([x, (x @ np.array([2.0, -1.0]) + noise)[..., None]], axis=2)
    squares = np.swapaxes(z, 1, 2) @ z
    number = np.arange(CLUSTERS)
    return Grams(("a", "b"), squares, np.zeros_like(squares), np.zeros((CLUSTERS, 2)), 0 * number, number)


def test_a_step_stays_within_its_bounds() -> None:
    free = bounded_step(_grams(0.0), ["b", "a"], np.full(2, -np.inf), np.full(2, np.inf))
    assert free == pytest.approx({"a": 2.0, "b": -1.0}, abs=0.1)
    held = bounded_step(_grams(0.0), ["a", "b"], np.array([-np.inf, -0.5]), np.array([1.5, np.inf]))
    assert held == pytest.approx({"a": 1.5, "b": -0.5})


def test_white_noise_gives_the_textbook_covariance() -> None:
    g = _grams(0.0)
    white = np.linalg.inv(g.both.sum(axis=0)[:2, :2])
    np.testing.assert_allclose(np.diag(clustered_covariance(g, ["a", "b"])), np.diag(white), rtol=0.3)


def test_noise_that_is_common_to_a_cluster_widens_it() -> None:
    """By the design effect 1 + (n - 1) rho_x rho_r of n rows, half of x's and of the noise's variance common."""
    white, clustered = (standard_deviations(_grams(common), ["a", "b"])["a"] for common in (0.0, 1.0))
    expected = np.sqrt(2.0 * (1.0 + (ROWS - 1) * 0.25))  # twice the noise's variance
    assert 0.75 * expected < clustered / white < 1.25 * expected
