"""Variances from the disagreement of frequencies, against estimates whose error is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.identification.simultaneous import agreement

ROWS = (1500, 2501)
Array = NDArray[np.float64]


def slope_of(column: Array, left: Array) -> tuple[float, float]:
    """A weight by least squares, and its standard deviation by the bands."""
    influence = column / float(column @ column)
    value = float(influence @ left)
    return value, float(np.sqrt(agreement.variance(influence, left - value * column, 0.0, ROWS)))


def drawn(seed: int) -> tuple[Array, Array, Array]:
    """A slow column, white noise of unit variance, and noise in the column alone: (n,) each."""
    source = np.random.default_rng(seed)
    slow = np.convolve(source.normal(0.0, 1.0, sum(ROWS) + 19), np.full(20, 0.05), "valid")
    return slow, source.normal(0.0, 1.0, sum(ROWS)), source.normal(0.0, 0.1, sum(ROWS))


def test_white_noise_has_the_variance_of_least_squares() -> None:
    ratios = []
    for seed in range(40):
        column, noise, _ = drawn(seed)
        ratios.append(slope_of(column, noise)[1] ** 2 * float(column @ column))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)


def test_noise_of_a_column_is_in_the_interval() -> None:
    """It makes the weight too small, by three of the deviations that least squares knows; slow rows say otherwise."""
    beyond_bands, beyond_least_squares = [], []
    for seed in range(40):
        column, noise, inside = drawn(seed)
        column = 3.0 * column
        seen = column + 2.0 * inside
        value, deviation = slope_of(seen, column + 0.3 * noise)
        beyond_bands.append(abs(value - 1.0) > 2.0 * deviation)
        known = float(np.std(column + 0.3 * noise - value * seen) / np.linalg.norm(seen))
        beyond_least_squares.append(abs(value - 1.0) > 2.0 * known)
    assert sum(beyond_least_squares) > 35 and sum(beyond_bands) < 8


def test_what_the_model_expects_of_noise_is_no_disagreement() -> None:
    """Noise in the column has its products with the residual at all frequencies alike: expected, they do not count."""
    column, noise, inside = drawn(1)
    seen = 3.0 * column + 5.0 * inside
    influence = seen / float(seen @ seen)
    residual = 0.1 * noise - 5.0 * inside
    bias = float(influence @ residual)
    known, unknown = (agreement.variance(influence, residual, more, ROWS) for more in (-bias, 0.0))
    assert known < 0.2 * unknown


def test_a_parameter_that_is_given_has_no_variance() -> None:
    assert agreement.variance(np.zeros(sum(ROWS)), drawn(1)[1], 0.0, ROWS) == 0.0
