"""Standard errors of a coloured residual against what is known of a first-order autoregressive one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from stagectl.identification.standard_errors import bandwidth, covariance, independent, integrated_autocorrelation

ROWS = 20000


def coloured(rho: float, seed: int = 1) -> NDArray[np.float64]:
    """Noise (n,) whose neighbours correlate by `rho`."""
    return np.asarray(lfilter([1.0], [1.0, -rho], np.random.default_rng(seed).normal(0.0, 1.0, ROWS)))


@pytest.mark.parametrize("rho", [0.3, 0.6, 0.8])
def test_the_lags_are_andrews_choice(rho: float) -> None:
    """D. W. K. Andrews, 1991, equation 6.4 for Bartlett's kernel: ``4 rho^2 / ((1 - rho)^2 (1 + rho)^2)``."""
    alpha = 4.0 * rho**2 / ((1.0 - rho) * (1.0 + rho)) ** 2
    assert bandwidth(coloured(rho)[:, None]) == pytest.approx(1.1447 * (alpha * ROWS) ** (1.0 / 3.0), rel=0.05)


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_the_mean_of_coloured_noise_is_known_as_well_as_theory_says(rho: float) -> None:
    """Variance of a mean: the textbook's times ``(1 + rho)/(1 - rho)``, of which the rows' worth is the inverse."""
    values, ones = coloured(rho), np.ones((ROWS, 1))
    grown = (1.0 + rho) / (1.0 - rho)
    assert float(covariance(ones, values)[0, 0]) * ROWS / float(np.var(values)) == pytest.approx(grown, rel=0.15)
    assert independent(values) == pytest.approx(ROWS / grown, rel=0.05)


@pytest.mark.parametrize("rho", [0.3, 0.8])
def test_the_integrated_autocorrelation_of_an_autoregressive_residual(rho: float) -> None:
    """``1 + 2 sum rho^k = (1 + rho)/(1 - rho)``."""
    assert integrated_autocorrelation(coloured(rho)) == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.1)
