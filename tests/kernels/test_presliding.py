"""The state of a stop operator along a sampled motion."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.kernels import presliding


@pytest.mark.parametrize("phase", [-0.4, -0.1, 0.0, 0.25, 0.45])
def test_beyond_is_exact_on_a_parabola(phase: float) -> None:
    """``x = -(t - phase)^2`` turns at 0, sampled at -1, 0, 1: the outermost sample lies ``phase^2`` below."""
    before, middle, after = (-((t - phase) ** 2) for t in (-1.0, 0.0, 1.0))
    assert presliding.beyond(middle - before, after - middle) == pytest.approx(phase * phase, abs=1e-15)
    assert presliding.beyond(before - middle, middle - after) == pytest.approx(-phase * phase, abs=1e-15)


def test_no_turn_is_nothing_beyond() -> None:
    assert presliding.beyond(1.0, 2.0) == 0.0
    assert presliding.beyond(0.0, 2.0) == 0.0


def test_turns_between_samples_are_seen() -> None:
    """Coarsely sampled sine: after each turn the elements are where a hundred times finer sampling has them."""
    slip = np.array([0.01, 0.05, 0.3])

    def states(per_period: int) -> NDArray[np.float64]:
        x = np.sin(2.0 * np.pi * np.arange(2 * per_period + 1) / per_period + 0.1)
        track = np.concatenate([x[:1], x[:1], x, x[-1:]])
        out = np.zeros((3, len(x)))
        for one, row in zip(slip.tolist(), out, strict=True):
            presliding.strain(1.0 / one, track, row)
        return out[:, :: per_period // 50]

    coarse, fine = states(50), states(5000)
    inside = np.abs(fine) < 0.999  # where an element is between its ends, an overlooked travel would stay visible
    assert inside[1:].sum() > 10
    assert np.abs(coarse - fine)[inside].max() < 2e-3
