"""The PID's three terms against Tustin's rule as scipy applies it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from stagectl.kernels import feedback

DT = 5e-4
GAINS = feedback.Gains(833.3, 55901.0, 4.2749, 991.31)  # stage A, 40 Hz


@pytest.mark.parametrize("dt", [DT, 4 * DT])
def test_each_term_is_tustins_rule(dt: float) -> None:
    """Kp, Ki/s and Kd s a/(s + a), each bilinear at `dt`, driven by an arbitrary error."""
    error = np.random.default_rng(3).normal(size=200)
    kp, ki, kd, a = GAINS
    terms = [([kp], [1.0]), ([ki], [1.0, 0.0]), ([kd * a, 0.0], [1.0, a])]
    expected = np.stack([lfilter(*bilinear(*term, fs=1.0 / dt), error) for term in terms], axis=1)
    p, x, outputs = feedback.discretised(GAINS, dt), feedback.AT_REST, []
    for value in error.tolist():
        output, x = feedback.step(p, x, value)
        outputs.append(output)
    np.testing.assert_allclose(outputs, expected, rtol=1e-9, atol=1e-9 * kp)
