"""Columns of the equation of motion, piece by piece."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.identification.simultaneous.regressors import _lightly_smoothed


def test_the_operators_follow_a_motion_and_a_third_of_the_rounding() -> None:
    """A cubic B-spline leaves a ramp as it is, and (4 - 2)/6 of what alternates from sample to sample."""
    ramp = 3.0 * np.arange(10.0)
    assert _lightly_smoothed(ramp) == pytest.approx(ramp)
    dither = np.where(np.arange(10) % 2, 1.0, -1.0)
    assert _lightly_smoothed(dither)[1:-1] == pytest.approx(dither[1:-1] / 3.0)
