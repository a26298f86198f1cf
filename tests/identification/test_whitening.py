"""The filter that makes a residual white, against noise whose filter is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from stagectl.identification.simultaneous import whitening

ROWS = (6000, 9000)
MODEL = np.array([1.0, -1.4, 0.6])  # e_k = r_k - 1.4 r_(k-1) + 0.6 r_(k-2)
OPEN = np.ones(1)  # rows that have passed no window


def residual() -> NDArray[np.float64]:
    """Two captures (n,) of the noise that `MODEL` turns into one of unit variance."""
    source = np.random.default_rng(3)
    return np.concatenate([lfilter([1.0], MODEL, source.normal(0.0, 1.0, rows)) for rows in ROWS])


def test_the_filter_of_an_autoregressive_residual_is_its_model() -> None:
    found = whitening.of(residual(), ROWS, OPEN).weights
    assert found == pytest.approx(MODEL, abs=0.03)


def test_what_is_filtered_is_white_and_no_row_knows_another_capture() -> None:
    filtered = whitening.of(residual(), ROWS, OPEN)
    lost = len(filtered.weights) - 1
    white = filtered(residual())
    assert len(white) == sum(ROWS) - 2 * lost
    assert np.var(white) == pytest.approx(1.0, rel=0.03)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 3.0 / np.sqrt(sum(ROWS))
    alone = whitening.Whitening(filtered.weights, ROWS[1:])(residual()[ROWS[0] :])
    np.testing.assert_array_equal(white[ROWS[0] - lost :], alone)


def test_the_window_of_the_rows_is_not_taken_back() -> None:
    """White noise that passed a window is white noise: the filter leaves it as it is."""
    window = np.array([1.0, 26.0, 66.0, 26.0, 1.0])  # the quintic B-spline at its knots
    passed = np.convolve(np.random.default_rng(5).normal(0.0, 1.0, 20000), window, "valid")
    products = np.correlate(window, window, "full")[4:]
    np.testing.assert_array_equal(whitening.of(passed, (len(passed),), products / products[0]).weights, [1.0])
    assert whitening.of(passed, (len(passed),), OPEN).weights[1] < -0.9


def test_a_least_square_of_filtered_rows_is_as_good_as_theory_says() -> None:
    """Slope of a straight line under slow noise: its variance is that of generalised least squares, ``(X'X)^-1``."""
    line, errors = np.linspace(-1.0, 1.0, 400)[:, None], []
    for seed in range(60):
        noise = lfilter([1.0], [1.0, -0.95], np.random.default_rng(seed).normal(0.0, 1.0, 400))
        filtered = whitening.of(noise, (400,), OPEN)
        column = filtered(line)
        errors.append(float((np.linalg.lstsq(column, filtered(noise), rcond=None)[0] / stated(column))[0]))
    assert np.std(errors) == pytest.approx(1.0, abs=0.3)


def stated(column: NDArray[np.float64]) -> float:
    """Standard deviation of a column's weight under white noise of unit variance."""
    return float(1.0 / np.linalg.norm(column))


def test_a_short_or_empty_residual_is_left_as_it_is() -> None:
    for values in (np.ones(15), np.zeros(500)):
        np.testing.assert_array_equal(whitening.of(values, (len(values),), OPEN)(values), values)


def test_noise_in_a_column_is_no_more_than_it_has_at_any_frequency() -> None:
    """A motion below a tenth of the band hides no noise above it, and is none itself."""
    noise = np.random.default_rng(5).normal(0.0, 0.1, sum(ROWS))
    motion = np.concatenate([3.0 * np.sin(0.2 * np.arange(rows)) for rows in ROWS])
    assert whitening.floor(motion, ROWS, OPEN) < 1e-4
    assert whitening.floor(motion + noise, ROWS, OPEN) == pytest.approx(0.01, rel=0.1)


def test_a_span_shorter_than_the_filter_looks_back_counts_too() -> None:
    """Spans between standstills: a few rows among many."""
    noise = np.random.default_rng(8).normal(0.0, 1.0, 2003)
    found = whitening.of(noise, (3, 2000), OPEN)
    assert found.rows == (3, 2000) and len(found.weights) == 1
