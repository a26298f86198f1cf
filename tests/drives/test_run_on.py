"""How far an axis goes on without its controller: against a simulation in small steps, and the inverse."""

from __future__ import annotations

import math

import pytest

from stagectl.drives.run_on import AxisLimits, RunOn
from stagectl.number_format import Travel


def simulated(run: RunOn, timeout: float, dt: float = 1e-6) -> float:
    """Way until it stands, summed up step by step: constant acceleration, then the ramp."""
    x, v, t = 0.0, run.speed, 0.0
    while v > 0.0 or t < timeout:
        a = run.acceleration if t < timeout else -run.deceleration
        x, v, t = x + v * dt + 0.5 * a * dt * dt, v + a * dt, t + dt
    return x


@pytest.mark.parametrize("run", [RunOn(0.3, 2.06, 2.06), RunOn(0.2, 16.7, 2.0), RunOn(0.0, 5.0, 1.0)])
@pytest.mark.parametrize("timeout", [0.0, 0.015, 0.2])
def test_the_way_is_that_of_a_simulation(run: RunOn, timeout: float) -> None:
    assert run.distance(timeout) == pytest.approx(simulated(run, timeout), rel=2e-3, abs=1e-6)
    assert run.cost(timeout) == pytest.approx(run.distance(timeout) - run.distance(0.0), abs=1e-12)


@pytest.mark.parametrize("free", [1e-5, 0.01, 3.0])
def test_the_longest_time_out_costs_the_free_distance(free: float) -> None:
    for run in (RunOn(0.3, 2.06, 5.0), RunOn(0.0, 2.06, 5.0), RunOn(0.3, 1e-9, 5.0)):
        assert run.cost(run.longest(free)) == pytest.approx(free, rel=1e-9)


def test_what_nothing_stops_has_no_time_out() -> None:
    run = RunOn(0.3, 2.0, 0.0)
    assert math.isinf(run.distance(0.01)) and math.isinf(run.cost(0.01)) and run.longest(0.01) == 0.0
    axis = AxisLimits(15.0, 0.3, Travel(1.0, "m", False), run, run)
    assert "nothing" in axis.words(0.01, True)


def test_words_in_the_unit_of_the_table() -> None:
    """157 rad/s on a lead of 12 mm are 300 mm/s."""
    run = RunOn(157.08, 1080.0, 1080.0)
    axis = AxisLimits(15.0, 157.08, Travel(0.012 / (2.0 * math.pi), "m", True), run, run)
    assert "300 mm/s" in axis.words(0.015, True) and "31.3 mm" in axis.words(0.015, True)
