"""The Gaussian evidence against densities by scipy, in which no sum and no elimination stands."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from stagectl.gaussian_evidence import Matrix, Prior, Sums, Vector, independent, posterior

ROWS, COLUMNS = 40, 5


def _case(seed: int) -> tuple[Matrix, Vector, Prior]:
    random = np.random.default_rng(seed)
    x = random.normal(size=(ROWS, COLUMNS))
    root = random.normal(size=(COLUMNS, COLUMNS))
    return x, random.normal(size=ROWS), Prior(random.normal(size=COLUMNS), root @ root.T + np.eye(COLUMNS))


def _sums(x: Matrix, y: Vector) -> Sums:
    return Sums(x.T @ x, x.T @ y, float(y @ y))


@pytest.mark.parametrize("seed", range(5))
def test_the_evidence_is_the_density_of_the_rows(seed: int) -> None:
    x, y, prior = _case(seed)
    covariance = np.eye(ROWS) + x @ np.linalg.inv(prior.precision) @ x.T
    expected = multivariate_normal(x @ prior.mean, covariance).logpdf(y) + 0.5 * ROWS * np.log(2.0 * np.pi)
    assert posterior(_sums(x, y), prior).log_evidence == pytest.approx(expected, rel=1e-9)


def test_what_the_data_do_not_excite_stays_at_its_prior() -> None:
    x, y, _ = _case(0)
    x[:, 0] = 0.0
    answer = posterior(_sums(x, y), independent(np.full(COLUMNS, 2.0), np.full(COLUMNS, 0.3)))
    assert answer.mean[0] == pytest.approx(2.0)


def test_without_a_prior_it_is_least_squares() -> None:
    x, y, _ = _case(1)
    answer = posterior(_sums(x, y), independent(np.zeros(COLUMNS), np.full(COLUMNS, np.inf)))
    assert answer.mean == pytest.approx(np.linalg.lstsq(x, y, rcond=None)[0])


def test_what_nothing_determines_is_refused() -> None:
    x, y, _ = _case(2)
    x[:, 0] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        posterior(_sums(x, y), independent(np.zeros(COLUMNS), np.full(COLUMNS, np.inf)))
