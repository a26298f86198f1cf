"""Columns of the equation of motion, piece by piece."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.identification.simultaneous.regressors import _lightly_smoothed
from stagectl.identification.simultaneous.sensor_noise import _differences


def test_the_operators_follow_a_motion_and_a_third_of_the_rounding() -> None:
    """A cubic B-spline leaves a ramp as it is, and (4 - 2)/6 of what alternates from sample to sample."""
    ramp = 3.0 * np.arange(10.0)
    assert _lightly_smoothed(ramp) == pytest.approx(ramp)
    dither = np.where(np.arange(10) % 2, 1.0, -1.0)
    assert _lightly_smoothed(dither)[1:-1] == pytest.approx(dither[1:-1] / 3.0)


def test_fourth_differences_tell_noise_from_a_motion_that_is_sampled_slowly() -> None:
    """Of noise those of every second sample are as large, of jumps twice as large, of what is smooth far larger."""
    noise = np.random.default_rng(2).normal(0.0, 0.1, 20000)
    jumps = np.repeat(np.where(np.arange(200) % 2, 1.0, -1.0), 100)
    smooth = np.sin(0.3 * np.arange(20000))
    assert _differences(noise, 1) == pytest.approx(70.0 * 0.01, rel=0.05)
    assert _differences(noise, 2) == pytest.approx(_differences(noise, 1), rel=0.05)
    assert _differences(jumps, 2) == pytest.approx(2.0 * _differences(jumps, 1), rel=0.05)
    assert _differences(smooth, 2) > 100.0 * _differences(smooth, 1)
