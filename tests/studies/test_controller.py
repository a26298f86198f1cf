"""The deployed controller against the page's figures and the discrete plant."""

import numpy as np
import pytest
from scipy.linalg import expm
from stagectl_studies.machine.controller import Model, designed, prepared, stops, tracking, zero_order_hold

MODEL = Model(0.010, 0.14, 0.72, np.full(12, 1.0 / 12.0), np.geomspace(0.3, 9.0, 12) * 5.236e-4)


def test_gains_are_those_of_the_format_page() -> None:
    loop = designed(MODEL, 40.0)
    assert (loop.kp, loop.ki, loop.kd, loop.pole) == pytest.approx((833.297, 55900.7, 4.27489, 991.31), rel=2e-6)
    assert (loop.advance, loop.friction_advance) == pytest.approx((0.000659, 0.000909))


def test_four_poles_at_forty_hertz() -> None:
    """(J s^2 + D s)(s + a) s + Kt [Kp s (s + a) + Ki (s + a) + Kd a s^2] has one fourfold root."""
    loop = designed(MODEL, 40.0)
    a, kt = loop.pole, MODEL.force_constant
    plant = np.polymul([MODEL.inertia, MODEL.viscous, 0.0], [1.0, a, 0.0])
    numerator = kt * np.array([loop.kp + loop.kd * a, loop.kp * a + loop.ki, loop.ki * a])
    polynomial = np.polyadd(plant, numerator) / MODEL.inertia
    p = 2.0 * np.pi * 40.0
    assert polynomial == pytest.approx([1.0, 4.0 * p, 6.0 * p**2, 4.0 * p**3, p**4], rel=1e-9)


def test_zero_order_hold_is_the_matrix_exponential() -> None:
    d, kt, j = MODEL.viscous, MODEL.force_constant, MODEL.inertia
    ad, bd = zero_order_hold(MODEL, 0.0005)
    whole = expm(np.array([[0.0, 1.0, 0.0], [0.0, -d / j, kt / j], [0.0, 0.0, 0.0]]) * 0.0005)
    assert np.abs(ad - whole[:2, :2]).max() < 1e-14 and np.abs(bd - whole[:2, 2]).max() < 1e-14


def test_tracking_is_exact_on_the_discrete_plant() -> None:
    t = np.arange(401) * 0.001
    states = np.column_stack([np.sin(10.0 * t), 10.0 * np.cos(10.0 * t)])
    currents = tracking(MODEL, states, 0.0005).ravel()
    ad, bd = zero_order_hold(MODEL, 0.0005)
    x, worst = states[0], 0.0
    for k, current in enumerate(currents):
        x = ad @ x + bd * current
        if k % 2 == 1:
            worst = max(worst, float(np.abs(x - states[k // 2 + 1])[0]))
    assert worst < 1e-12


def test_at_constant_speed_only_friction_remains() -> None:
    """In the middle of a ramp the current is (D w + Tc)/Kt and the target is the reference."""
    reference = 3.0 * np.arange(2000, dtype=np.float64) * 0.0005
    rows = prepared(MODEL, designed(MODEL, 40.0), reference, np.zeros(2000))
    middle = slice(500, 1500)
    assert rows.feedforward[middle] == pytest.approx((0.14 * 3.0 + 1.0) / 0.72, abs=1e-6)
    assert np.abs(rows.target[middle] - reference[middle]).max() < 1e-12


def test_stop_operators_start_relaxed_and_slip() -> None:
    x = np.concatenate([[0.0], np.full(3, 1e-6), np.full(3, 0.1)])
    torque = stops(MODEL.weight, MODEL.slip, x)
    assert torque[0] == 0.0 and torque[1] == pytest.approx(1e-6 * float(np.sum(MODEL.weight / MODEL.slip)))
    assert torque[-1] == pytest.approx(1.0)
