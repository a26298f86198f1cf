"""Where positions come from: homing from anywhere, and an origin that does not move in silence."""

from __future__ import annotations

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Fault
from stagectl.drives.homing import Homing
from stagectl.realtime.shared_memory import Move, Order
from stagectl.realtime.states import Event, State
from tests.realtime.test_axis import Bench

LIMITS = (10.0, 100.0)  # rad; the drive counts from 0


@pytest.fixture
def far(ball_screw: Setup) -> Setup:
    return ball_screw.having(limits=ball_screw.file.limits._replace(travel=LIMITS))


def moved(low: float, high: float) -> Order:
    """A motion between these places (rad), from where the axis stands."""
    return Order(Event.MOVE, Move(0.0, 1.0, low, high, 1.0))


def test_an_axis_without_a_home_gets_power_wherever_it_stands(far: Setup) -> None:
    bench = Bench(far, Homing("here", position=20.0))
    bench.to(State.STANDING)
    bench.run(200)
    assert (bench.axis.state, bench.axis.fault) == (State.STANDING, Fault.NONE)
    assert not bench.axis.homed
    assert not bench.axis.may_begin(moved(0.0, 1.0))  # no motion before the home
    assert bench.order(Order(Event.HOME))
    bench.run(200)
    assert bench.axis.homed
    assert bench.axis.limits.low == LIMITS[0]  # the travel holds from now on
    assert bench.axis.seen.position == pytest.approx(20.0, abs=1e-3)


def test_an_axis_with_absolute_positions_is_refused_outside_its_travel(far: Setup) -> None:
    bench = Bench(far)
    bench.axis.happen(Event.CONNECT)
    assert bench.order(Order(Event.ENABLE))
    bench.until(State.FAULT)
    assert bench.axis.fault is Fault.TRAVEL


def test_a_home_beside_the_travel_may_be_left_inwards_only(far: Setup) -> None:
    bench = Bench(far, Homing("here", position=9.0))
    bench.to(State.STANDING)
    assert bench.order(Order(Event.HOME))
    bench.run(100)
    assert (bench.axis.state, bench.axis.fault) == (State.STANDING, Fault.NONE)
    assert not bench.axis.may_begin(moved(-0.5, 0.0))
    assert "from 17.1887 mm the motion would go to [16.2338 mm, 17.1887 mm]" in bench.axis.board.words
    assert bench.axis.may_begin(moved(0.0, 5.0))
    assert bench.axis.limits.low == pytest.approx(9.0 - bench.axis.p.envelope.following_error, abs=1e-3)


def test_a_position_that_jumps_without_power_takes_the_home(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.to(State.DISABLED)
    bench.run(100)
    assert bench.axis.homed
    bench.drive.jump = 1.0
    bench.run(2)
    assert (bench.axis.state, bench.axis.fault) == (State.FAULT, Fault.JUMP)
    assert not bench.axis.homed


@pytest.mark.parametrize(("jump", "homed"), [(0.0, True), (1.0, False)])
def test_a_drive_that_comes_back_elsewhere_takes_the_home(ball_screw: Setup, jump: float, homed: bool) -> None:
    bench = Bench(ball_screw)
    bench.to(State.DISABLED)
    bench.run(100)
    bench.axis.state = State.FAULT
    bench.drive.jump = jump
    assert bench.order(Order(Event.RESET))
    bench.run(10)
    assert (bench.axis.state, bench.axis.homed) == (State.DISABLED, homed)
    assert bench.axis.fault is (Fault.NONE if homed else Fault.JUMP)
    assert homed or "1" in bench.manned.board.words
    assert bench.order(Order(Event.ENABLE))
    bench.until(State.STANDING)
    assert bench.order(Order(Event.HOME))  # a person says that the position is right
    assert bench.axis.homed


def test_a_drive_that_is_found_in_fault_is_reset_by_a_person(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    pending = ["it is too warm"]
    bench.drive.pending_fault = lambda: pending[0]  # type: ignore[method-assign]
    bench.drive.reset_fault = lambda: pending.__setitem__(0, "")  # type: ignore[method-assign]
    bench.axis.happen(Event.CONNECT)
    assert (bench.axis.state, bench.axis.fault) == (State.FAULT, Fault.DRIVE_FAULT)
    assert not bench.order(Order(Event.ENABLE))
    assert pending[0]
    assert bench.order(Order(Event.RESET))
    assert (bench.axis.state, pending[0]) == (State.DISABLED, "")
