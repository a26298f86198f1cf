"""The gap of the effort: in its own unit, over half strokes, and its floor from repeats."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.gap.residuals import sensitivities
from stagectl.gap.residuals.thresholds import BAND
from stagectl.gap.residuals.whitening import Whitener
from stagectl.gap.validation import closure

DT = 1e-3
FLAT = Whitener(np.arange(2.0), np.ones(2), np.ones(2))
RUN: Any = SimpleNamespace(cluster=np.array([0, 0, 1, 1]), weight=np.array([1.0, 1.0, 1.0, 0.0]))
NOTHING: Any = None


@pytest.fixture
def repeats(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two repeats of one run, 1 and 3 everywhere, in units of density."""
    columns = [np.stack([np.full(4, value), np.zeros(4)], axis=1) for value in (1.0, 3.0)]
    monkeypatch.setattr(sensitivities, "residuals_of", lambda *_: [columns])


@pytest.mark.usefixtures("repeats")
def test_squares_in_the_band_over_half_strokes() -> None:
    sums = closure.effort(NOTHING, [RUN], FLAT, DT)
    band = BAND / DT
    assert sums.squares == pytest.approx(band * np.array([20.0, 10.0]))
    assert sums.samples.tolist() == [4.0, 2.0]


@pytest.mark.usefixtures("repeats")
def test_the_floor_is_the_variance_of_a_single_repeat() -> None:
    """Of 1 and 3: 2 a sample."""
    sums = closure.effort_floor(NOTHING, [RUN], FLAT, DT)
    assert sums.squares == pytest.approx(BAND / DT * 2.0 * np.array([4.0, 2.0]))
