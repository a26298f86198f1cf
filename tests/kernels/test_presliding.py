"""States of stop operators along a sampled motion."""

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
        presliding.strains(1.0 / slip, np.zeros(3), track, out)
        return out[:, :: per_period // 50]

    coarse, fine = states(50), states(5000)
    inside = np.abs(fine) < 0.999  # where an element is between its ends, an overlooked travel would stay visible
    assert inside[1:].sum() > 10
    assert np.abs(coarse - fine)[inside].max() < 2e-3


def test_parts_of_a_motion_go_on() -> None:
    """The states at the end of one part are the start of the next."""
    x = np.cumsum(np.random.default_rng(3).standard_normal(400))
    track = np.concatenate([x[:1], x[:1], x, x[-1:]])
    whole, apart = np.zeros((1, 400)), np.zeros((1, 400))
    presliding.strains(np.array([0.3]), np.zeros(1), track, whole)
    states, first, second = np.zeros(1), np.zeros((1, 150)), np.zeros((1, 250))
    presliding.strains(np.array([0.3]), states, track[:153], first)
    presliding.strains(np.array([0.3]), states, track[150:], second)
    apart[:, :150], apart[:, 150:] = first, second
    assert np.array_equal(whole, apart)
