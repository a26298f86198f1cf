"""Columns of the equation of motion, piece by piece."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.identification.capture import Capture
from stagectl.identification.simultaneous.regressors import _lightly_smoothed
from stagectl.identification.simultaneous.windows import KNOTS, knots, widest


def test_the_operators_follow_a_motion_and_a_third_of_the_rounding() -> None:
    """A cubic B-spline leaves a ramp as it is, and (4 - 2)/6 of what alternates from sample to sample."""
    ramp = 3.0 * np.arange(10.0)
    assert _lightly_smoothed(ramp) == pytest.approx(ramp)
    dither = np.where(np.arange(10) % 2, 1.0, -1.0)
    assert _lightly_smoothed(dither)[1:-1] == pytest.approx(dither[1:-1] / 3.0)


@pytest.mark.parametrize("noise", [1e-6, 3e-6, 1e-4])
def test_no_window_is_wider_than_the_reversals_allow(noise: float) -> None:
    """At 100 Hz noise of 3 um had asked for 180 ms, where 120 ms are the most, and the capture was refused for it."""
    time = 0.01 * np.arange(3000)
    position = 5e-3 * np.sin(2.0 * np.pi * 1.2 * time) + noise * np.random.default_rng(1).standard_normal(len(time))
    capture = Capture("log", time, np.asarray(position, dtype=np.float64), np.zeros_like(time), 0.01)
    assert 2.0 * KNOTS * knots(capture) * capture.dt <= widest(capture)
