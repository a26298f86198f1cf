"""Ridge fits and floors, on matrices and repeats with known sums."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.gap.inference import coordinates


def gram(columns: np.ndarray, target: np.ndarray) -> np.ndarray:
    rows = np.vstack([columns, target])
    return np.asarray(rows @ rows.T)


def test_excited_columns_get_their_amplitudes() -> None:
    columns = np.random.default_rng(2).standard_normal((3, 5000))
    amplitudes = coordinates.ridge_fit(gram(columns, np.array([2.0, -1.0, 0.5]) @ columns), [1, 2], 1e-3, [0])
    assert amplitudes == pytest.approx([2.0, -1.0, 0.5], rel=2e-3)


def test_a_column_that_is_hardly_excited_is_drawn_to_zero_and_a_nuisance_is_not() -> None:
    """Its power is a hundredth of the ridge."""
    columns = np.random.default_rng(2).standard_normal((2, 5000)) * np.array([[1.0], [1e-2 * np.sqrt(1e-3) * 10.0]])
    g = gram(columns, columns[0] + 3.0 * columns[1])
    drawn = coordinates.ridge_fit(g, [0, 1], 1e-3)
    assert drawn[0] == pytest.approx(1.0, rel=0.01) and 0.0 < drawn[1] < 0.1
    assert coordinates.ridge_fit(g, [0], 1e-3, [1])[0] == pytest.approx(3.0, rel=2e-3)


def evidence(*deviations: float) -> Any:
    """One run of ten rows whose repeats deviate by these."""
    run = SimpleNamespace(weight=np.ones(10), paths=(None,) * len(deviations))
    return SimpleNamespace(runs=[run], deviations=[[np.full((10, 2), x) for x in deviations]])


def test_the_noise_of_a_mean_is_that_of_one_over_their_number() -> None:
    """Three repeats at -1, 0, 1: variance 1, of the mean 1/3 a row."""
    assert coordinates.floor_of_means(evidence(-1.0, 0.0, 1.0)) == pytest.approx([10.0 / 3.0] * 2)
    assert coordinates.floor_of_means(evidence(0.0)).tolist() == [0.0, 0.0]


def test_means_are_of_the_repeats_of_each_run() -> None:
    ((mean,),) = coordinates.means([[np.zeros((2, 2)), np.ones((2, 2))]])
    assert mean.tolist() == [[0.5, 0.5]] * 2


@pytest.mark.parametrize(("frequency", "share"), [(40.0, 1.0), (1.0, 0.0)])
def test_a_resonance_lies_in_a_band(frequency: float, share: float) -> None:
    """A sine of 40 Hz wholly; one of 1 Hz is a motion, and counts for nothing."""
    rows = 8192
    signal = np.sin(2.0 * np.pi * frequency * 1e-3 * np.arange(rows))
    residual = np.stack([signal, np.zeros(rows)], axis=1)
    mean = SimpleNamespace(dt=5e-4, rows=np.zeros((2 * rows, 3)))
    run = SimpleNamespace(weight=np.ones(rows), mean=mean, paths=(None,))
    e: Any = SimpleNamespace(
        runs=[run, run], base=SimpleNamespace(after=[[residual]] * 2), deviations=[[np.zeros((rows, 2))]] * 2
    )
    assert coordinates._share_in_a_band(e) == pytest.approx(share, abs=0.02)
