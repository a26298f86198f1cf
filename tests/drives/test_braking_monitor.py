"""The judge of a stop by the drive's own ramp: against ramps in closed form, noise, and what does not brake at all."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from stagectl.drives.canopen.braking_monitor import BrakingFailure, BrakingMonitor, SpeedEstimate

DT, RAMP = 5e-4, 5.0  # s, m/s^2


def first(
    speed: Callable[[float], float], v: float, seconds: float = 1.0, noise: float = 0.0
) -> tuple[BrakingFailure, float]:
    """First failure of a stop from `v` (m/s) that goes by `speed` (s -> m/s), and when (s)."""
    source, pace, x, t = random.Random(3), SpeedEstimate(DT), 0.0, 0.0
    for _ in range(20):
        x += v * DT
        pace.add(x + source.gauss(0.0, noise))
    braking = BrakingMonitor(pace, RAMP)
    while t < seconds:
        t += DT
        x += speed(t) * DT
        pace.add(x + source.gauss(0.0, noise))
        if (failure := braking.step(silent=False)) is not BrakingFailure.NONE:
            return failure, t
    return BrakingFailure.NONE, t


@pytest.mark.parametrize("v", [0.001, 0.03, 0.3])
def test_a_ramp_that_is_followed_late_and_softly_is_a_stop(v: float) -> None:
    assert first(lambda t: max(v - RAMP * max(t - 0.02, 0.0) / 1.2, 0.0), v)[0] is BrakingFailure.NONE
    assert first(lambda t: max(v - RAMP * t, 0.0), v, noise=2e-8)[0] is BrakingFailure.NONE


@pytest.mark.parametrize("v", [0.006, 0.03, 0.3])
def test_an_axis_that_goes_on_as_before_is_found_out_when_half_its_speed_must_be_gone(v: float) -> None:
    failure, when = first(lambda _: v, v)
    assert failure is BrakingFailure.UNBRAKED
    assert 1.5 * v / RAMP + 0.06 < when < 1.5 * v / RAMP + 0.065
    assert first(lambda t: v * (1.0 - 0.3 * t), v)[0] is BrakingFailure.UNBRAKED  # a third of its speed in a second


def test_an_axis_that_gets_faster_is_found_out_sooner() -> None:
    failure, when = first(lambda t: 0.3 + RAMP * t, 0.3)
    assert failure is BrakingFailure.FASTER
    assert (0.15 + 0.025) / RAMP < when < (0.15 + 0.025) / RAMP + 0.006


def test_a_drive_that_is_silent_is_deaf_not_unbraked() -> None:
    braking = BrakingMonitor(SpeedEstimate(DT), RAMP)
    assert [braking.step(True), braking.step(True), braking.step(False)] == [
        BrakingFailure.NONE,
        BrakingFailure.SILENT,
        BrakingFailure.NONE,
    ]
