"""Columns of the equation of motion, piece by piece."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.identification.capture import Capture
from stagectl.identification.simultaneous.regressors import Part, _lightly_smoothed
from stagectl.identification.simultaneous.sensor_noise import current_noise
from stagectl.identification.simultaneous.windows import Rows

NOISE = 0.05  # A


def coarse(row: float, column: str = "command") -> Part:
    """A slow sine with steps of 1.5 mrad under a noisy current, one row each `row` (s), with a window of 10 ms."""
    time = np.arange(0.0, 4.0, row)
    position = 1.5e-3 * np.round(np.sin(2.0 * np.pi * time) / 1.5e-3)
    current = np.random.default_rng(1).normal(0.0, NOISE, len(time))
    wide = round(10e-3 / row)
    return Part(Capture("made", time, position, current, row, column), Rows(4 * wide, 20, wide), wide)


def test_a_command_has_no_sensor() -> None:
    """What is rough in a measured current may be its sensor's; what is rough in a command moved the axis."""
    assert current_noise([coarse(1e-3)], np.ones(1)) == 0.0
    measured = coarse(1e-3, "measured_current")
    assert current_noise([measured], np.array([1.0])) == pytest.approx(NOISE**2 * 0.394 / measured.q, rel=0.1)


def test_the_operators_follow_a_motion_and_a_third_of_the_rounding() -> None:
    """A cubic B-spline leaves a ramp as it is, and (4 - 2)/6 of what alternates from sample to sample."""
    ramp = 3.0 * np.arange(10.0)
    assert _lightly_smoothed(ramp) == pytest.approx(ramp)
    dither = np.where(np.arange(10) % 2, 1.0, -1.0)
    assert _lightly_smoothed(dither)[1:-1] == pytest.approx(dither[1:-1] / 3.0)
