"""The loop is open while a current experiment goes on: how it closes, with the axis elsewhere and in motion."""

from __future__ import annotations

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Fault
from stagectl.realtime.setpoint_sources import Model, caught
from stagectl.realtime.shared_memory import Order
from stagectl.realtime.states import Event, State
from stagectl.service.planning import laid_out
from stagectl.trajectories import Experiment
from stagectl.trajectories.currents import CurrentSine
from tests.realtime.test_axis import Bench

SWINGING = CurrentSine(3.0, 1.6, 16.0, 1.0)
ENDING = CurrentSine(3.0, 1.6, 0.25, 0.1)  # a push to one side


def following(bench: Bench, experiment: Experiment) -> None:
    """Begin it."""
    bench.to(State.STANDING)
    assert bench.order(bench.manned.start(laid_out(bench.manned.task("experiment", experiment)), 1))


def off(bench: Bench) -> float:
    """How far (rad) the axis is from its reference."""
    return abs(bench.axis.seen.position - bench.axis.asked.reference)


def held_well(bench: Bench, limit: float) -> None:
    """It must come to stand without a fault, with a following error below `limit` (rad)."""
    peak = 0.0
    for _ in range(2000):
        bench.run(1)
        peak = max(peak, abs(bench.axis.output.error))
    assert (bench.axis.state, bench.axis.fault, bench.axis.homed) == (State.STANDING, Fault.NONE, True)
    assert off(bench) < bench.axis.p.window
    assert peak < limit


@pytest.mark.parametrize("periods", [1540, 2100, 4000])
@pytest.mark.parametrize("event", [Event.STOP, Event.HOLD])
def test_a_stop_takes_the_axis_where_it_is_and_brakes_it(ball_screw: Setup, periods: int, event: Event) -> None:
    bench = Bench(ball_screw)
    following(bench, SWINGING)
    for _ in range(periods // 100):
        bench.run(100)
        bench.manned.fill()
    limit = ball_screw.file.limits.following_error
    assert off(bench) > 2.0 * limit and abs(bench.axis.watch.speed) > 1.0
    assert bench.order(Order(Event.STOP)) if event is Event.STOP else bench.axis.happen(event)
    assert bench.axis.state is State.STOPPING
    held_well(bench, 0.1 * limit)


def test_setpoints_that_run_out_brake_it_as_well(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    following(bench, SWINGING)
    bench.run(1540)
    bench.axis.source.next = lambda passed: None  # type: ignore[method-assign]
    bench.run(2000)
    assert (bench.axis.state, bench.axis.fault, bench.axis.homed) == (State.STANDING, Fault.STARVED, True)


def test_an_experiment_that_ends_elsewhere_ends_there(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    following(bench, ENDING)
    bench.run(1)
    while bench.axis.asked.closed == 0.0 and not bench.axis.source.over:
        away = off(bench)
        bench.run(1)
    limit = ball_screw.file.limits.following_error
    assert away > 2.0 * limit
    held_well(bench, 0.1 * limit)


def test_the_reference_is_the_axis_as_it_is_now() -> None:
    p = Model(5e-4, 100.0, 1.0, 1.0, friction=0.5, late=1e-3)
    assert caught(p, 2.0, -3.0)[:4] == (1.997, 1.997, 0.0, -0.5)
    assert caught(p, 2.0, 0.0)[:4] == (2.0, 2.0, 0.0, 0.0)
