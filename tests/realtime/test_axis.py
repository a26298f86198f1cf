"""One axis of the service against the stage model, without processes: every state reached, every fault in each."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives.brake import Brake
from stagectl.drives.drive import DriveError, Fault, Feedback, Power
from stagectl.drives.homing import Homing
from stagectl.drives.simulated import Plant, Simulated
from stagectl.kernels.effects import Harmonic
from stagectl.realtime.axis import Axis
from stagectl.realtime.shared_memory import REFUSED, TAKEN, Order, Status
from stagectl.realtime.states import Event, State
from stagectl.realtime.stops import STOPS, Category
from stagectl.service.axis_controller import COLUMNS, AxisController
from stagectl.service.job_from_stage import calm
from stagectl.service.planning import laid_out
from stagectl.trajectories.motion import TrajectoryError
from tests.conftest import varied

ABSOLUTE = Homing()
GONE = (Fault.FEEDBACK_LOST, Fault.BUS, Fault.REBOOTED)


class Drive(Simulated):
    """The stage model with a ramp of its own, which reports what a test says."""

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant)
        self.fault, self.frozen, self.statusword, self.power = Fault.NONE, math.nan, 0x27, Power.OFF
        self.jump = 0.0

    def ask(self, power: Power) -> None:
        self.power = power
        if power is not Power.HOME:
            super().ask(power)

    def sample(self) -> Feedback:
        position, current, _, fault, *_ = super().sample()
        position = self.frozen if not math.isnan(self.frozen) else position + self.jump
        return Feedback(position, current, self.statusword, self.fault or fault, busy=self.power is Power.HOME)

    def explain(self) -> str:
        return "the drive says why"


class Bench:
    """An axis, its service's side, and its drive."""

    def __init__(self, setup: Setup, homing: Homing = ABSOLUTE) -> None:
        setup = varied(setup, substeps=1)
        self.manned = AxisController("axis", setup)
        self.drive = Drive(Plant(setup.stage, setup.file.simulation, setup.dt))
        self.refuses = False
        orders = self.manned.orders()._replace(homing=homing)
        self.axis = Axis(orders, self.manned.board, self.manned.ring, self._connect)

    def _connect(self, _: Any) -> Drive:
        if self.refuses:
            raise DriveError("no drive; is it powered?")
        return self.drive

    def run(self, periods: int, late: bool = False) -> None:
        for _ in range(periods):
            if self.axis.drive is None:
                return
            self.axis.sense()
            self.axis.act(1)
            self.axis.record(0.0, late)

    def until(self, state: State, most: int = 20000) -> int:
        for k in range(most):
            if self.axis.state is state:
                return k
            self.run(1)
        raise AssertionError(f"{self.axis.state.name} instead of {state.name} after {most} periods")

    def until_still(self) -> int:
        for k in range(30000):
            if self.axis.state in (State.FAULT, State.DISABLED, State.OFFLINE) or self.axis.drive is None:
                return k
            if self.axis.state in (State.QUICK_STOPPING, State.COASTING) and self.drive.fault in GONE:
                self.axis.lost = -1e9
            self.run(1)
        raise AssertionError(self.axis.state.name)

    def order(self, order: Order) -> bool:
        board = self.manned.board
        number = board.order(order)
        next_order = self.axis.board.next_order()
        assert next_order == order
        self.axis.board.answer(self.axis.take(next_order))
        self.axis.show()
        assert board.verdict(number) in (TAKEN, REFUSED)
        return board.verdict(number) == TAKEN

    def to(self, state: State) -> None:
        """Bring the axis there by orders."""
        self.axis.happen(Event.CONNECT)
        if state is State.DISABLED:
            return
        assert self.order(Order(Event.ENABLE))
        if state is State.ENABLING:
            return
        self.until(State.STANDING)
        self.run(50)
        if state in (State.MOVING, State.STOPPING, State.QUICK_STOPPING, State.COASTING):
            assert self.order(self.manned.start(laid_out(self.manned.move(0.02, 0.05, None)), 1))
            self.run(250)  # at speed
        if state in (State.HOMING, State.DRIVE_HOMING):
            assert self.order(Order(Event.HOME))
            self.run(100)
        if state is State.STOPPING:
            assert self.order(Order(Event.STOP))
        if state is State.QUICK_STOPPING:
            assert self.order(Order(Event.QUICK_STOP))
        if state is State.COASTING:
            self.axis.happen(Event.COAST, Fault.JUMP)
        self.run(3)

    def rows(self) -> dict[str, Any]:
        ring = self.manned.ring
        table = np.frombuffer(ring.read(0, ring.capacity)[1]).reshape(-1, len(COLUMNS))
        return {name: table[:, k] for k, name in enumerate(COLUMNS)}


BY_DRIVE = Homing("drive", 6.0, 2.0, position=1.0, number=34)
SEARCH = Homing("index", 6.0, 100.0, 0.0, 11, 0.0)
OTHERS = [(State.MOVING, Fault.FEEDBACK_LOST), (State.MOVING, Fault.REBOOTED), (State.DISABLED, Fault.DRIVE_FAULT)]
ELSEWHERE = (State.OFFLINE, State.CONNECTING, State.FAULT, State.ENGAGING)  # the last only with a brake
REACHED = [state for state in State if state not in ELSEWHERE]


@pytest.mark.parametrize(
    ("state", "fault"),
    [*((state, fault) for state in REACHED for fault in (Fault.BUS, Fault.EMERGENCY)), *OTHERS],
)
def test_a_fault_of_the_drive_ends_without_power_in_every_state(ball_screw: Setup, state: State, fault: Fault) -> None:
    bench = Bench(ball_screw, {State.HOMING: SEARCH, State.DRIVE_HOMING: BY_DRIVE}.get(state, Homing()))
    bench.to(state)
    assert bench.axis.state is state
    before = bench.axis.faults
    bench.run(2001 if state is State.DISABLED else 0)  # an emergency sooner is of the time before
    bench.drive.fault = fault
    if state is State.DISABLED and fault is Fault.DRIVE_FAULT:
        bench.run(100)
        assert bench.axis.state is State.DISABLED  # without power that is how it should be
        return
    if fault in GONE:
        bench.axis.lost = -1e9  # the second that a lost drive is waited for has passed
    took = bench.until_still()
    assert bench.axis.state in (State.FAULT, State.DISABLED)
    assert not bench.drive.plant.powered
    assert took * ball_screw.dt < (5.1 if state is State.ENABLING else 1.0)
    if state in (State.STANDING, State.MOVING, State.HOMING, State.STOPPING):
        assert (bench.axis.fault, bench.axis.faults) == (fault, before + 1)
        assert STOPS[fault].words in bench.manned.board.words
        assert "the drive says why" in bench.manned.board.words
        assert bench.rows()["current"][-1] == 0.0


@pytest.mark.parametrize(
    ("fault", "provoke"),
    [
        (Fault.JUMP, lambda drive: setattr(drive, "jump", 0.2)),
        (Fault.FREEZE, lambda drive: setattr(drive, "frozen", drive.plant.position)),
    ],
)
def test_an_encoder_that_lies_ends_in_coasting(
    ball_screw: Setup, fault: Fault, provoke: Callable[[Drive], None]
) -> None:
    bench = Bench(ball_screw)
    bench.to(State.MOVING)
    provoke(bench.drive)
    assert bench.until(State.COASTING) < 40
    assert bench.drive.power is Power.OFF
    bench.until(State.FAULT)
    assert bench.axis.fault is fault
    assert STOPS[fault].category is Category.COAST
    assert not bench.order(Order(Event.ENABLE))
    assert not bench.order(Order(Event.MOVE, (0.0, 10.0, 0.0, 0.0, 1.0)))
    bench.drive.jump, bench.drive.frozen = 0.0, math.nan
    assert bench.order(Order(Event.RESET))
    assert bench.axis.state is State.DISABLED
    assert bench.order(Order(Event.ENABLE))
    bench.until(State.STANDING)


def test_an_axis_that_leaves_its_place_while_its_brake_engages_loses_its_power(ball_screw: Setup) -> None:
    bench = Bench(ball_screw.having(brake=Brake("output", 0.03, 0.5)))
    bench.to(State.STANDING)
    assert bench.order(Order(Event.DISABLE))
    bench.run(20)
    assert bench.axis.state is State.ENGAGING
    bench.drive.jump = 0.2
    bench.run(1)
    assert (bench.axis.state, bench.axis.fault) == (State.FAULT, Fault.FOLLOWING_ERROR)
    assert bench.drive.power is Power.OFF


def test_a_move_arrives_and_the_next_one_goes_on_without_a_bump(ball_screw: Setup) -> None:
    """The friction state survives between motions: no error of a reversal at the beginning of the second move."""
    bench = Bench(ball_screw)
    bench.to(State.STANDING)
    scale = ball_screw.file.axis.travel_per_unit
    for distance in (0.002, 0.003):
        motion = laid_out(bench.manned.move(distance, None, None))
        assert bench.order(bench.manned.start(motion, 1))
        bench.until(State.STANDING)
        bench.manned.finished(True)
        bench.run(200)
        assert bench.manned.status.settled > 0.09
    rows = bench.rows()
    assert rows["measured"][-1] * scale == pytest.approx(0.005, abs=2e-7)
    second = (rows["state"] == State.MOVING) & (rows["reference"] * scale > 0.0020001)
    assert np.sum(second) > 100
    assert np.max(np.abs(rows["error"][second])) * scale < 3e-7
    assert np.max(np.abs(rows["error"])) * scale > 1e-8


def test_an_axis_with_a_map_comes_to_a_place_from_both_sides_and_stays_there(ball_screw: Setup) -> None:
    """A place is where the encoder shows it plus its error there; the target jumps neither at an end nor at a start."""
    wave = Harmonic(0.005, 1.0, 0.3)  # rad: 10 um of the table
    known = ball_screw.stage._replace(encoder=ball_screw.stage.encoder._replace(eccentricity=wave))
    bench = Bench(ball_screw._replace(stage=known))
    bench.to(State.STANDING)
    places, there = (1.0, 4.0, 1.0), []
    for place in places:
        distance = (place - bench.manned.status.reference) * ball_screw.file.axis.travel_per_unit
        assert bench.order(bench.manned.start(laid_out(bench.manned.move(distance, None, None)), 1))
        bench.until(State.STANDING)
        bench.manned.finished(True)
        bench.run(200)
        there.append(bench.axis.seen.position)
    step = 2.0 * ball_screw.stage.encoder.step
    assert there == pytest.approx([place + 0.005 * math.sin(place + 0.3) for place in places], abs=step)
    rows = bench.rows()
    stands = rows["state"] == State.STANDING
    jumps = np.abs(np.diff(rows["target"] - rows["reference"]))[stands[1:] | stands[:-1]]
    assert len(jumps) > 600 and np.max(jumps) < step


def test_a_stop_in_mid_motion_holds_where_it_ends(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.to(State.MOVING)
    speed = bench.axis.watch.speed
    assert speed > 10.0
    assert bench.order(Order(Event.STOP))
    took = bench.until(State.STANDING) * ball_screw.dt
    assert took == pytest.approx(speed / calm(ball_screw), rel=0.1)
    bench.run(400)
    assert bench.manned.status.settled > 0.05
    rows = bench.rows()
    assert np.max(np.abs(rows["error"])) < ball_screw.file.limits.following_error / 4.0
    assert bench.axis.fault is Fault.NONE


def test_an_ordered_quick_stop_ends_disabled_and_is_measured(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.to(State.MOVING)
    assert bench.order(Order(Event.QUICK_STOP))
    bench.until(State.DISABLED)
    time, distance = bench.axis.stopped
    assert bench.axis.fault is Fault.NONE
    assert 0.0 < time < 1.0
    assert 0.0 < distance * ball_screw.file.axis.travel_per_unit < 0.02


def test_setpoints_that_run_out_are_a_stop_under_control(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.to(State.STANDING)
    motion = laid_out(bench.manned.move(0.02, 0.05, None))
    half = motion._replace(rows=motion.rows[: len(motion.rows) // 2], length=motion.length // 2)
    order = bench.manned.start(half, 1)
    first, count, low, high, together = order.numbers
    assert bench.order(Order(order.kind, (first, 2.0 * count, low, high, together)))
    bench.until(State.STOPPING)
    assert bench.axis.fault is Fault.STARVED
    bench.until(State.STANDING)
    assert np.max(np.abs(bench.rows()["error"])) < ball_screw.file.limits.following_error / 4.0


def test_a_motion_that_would_leave_the_travel_is_refused_with_figures(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.to(State.STANDING)
    high = ball_screw.file.limits.travel[1]
    assert not bench.order(Order(Event.MOVE, (0.0, 10.0, 0.0, 1.01 * high, 1.0)))
    assert "limits.travel is" in bench.manned.board.words
    assert not bench.axis.take(Order(Event.MOVE, (0.0, 10.0, math.nan, math.nan, 1.0)))
    assert bench.axis.state is State.STANDING


def test_late_cycles_in_a_row_stop_the_axis(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.to(State.MOVING)
    limit = bench.axis.p.envelope.late_limit
    bench.axis.late_in_a_row = limit - 3
    bench.run(2, late=True)
    assert bench.axis.state is State.MOVING
    bench.run(1, late=True)
    assert (bench.axis.state, bench.axis.fault) == (State.QUICK_STOPPING, Fault.LATE)


def test_other_gains_while_it_moves_leave_the_current_alone(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.to(State.MOVING)
    bench.run(20)
    gains = bench.manned.changed({"bandwidth": "25 Hz"})
    assert bench.order(gains.order)
    bench.manned.adopt(gains)
    bench.run(20)
    current = bench.rows()["current"][-40:]
    assert np.max(np.abs(np.diff(current))) < 0.1
    assert bench.axis.law.feedback.proportional < bench.manned.orders().law.feedback.proportional * 1.0001


def test_the_status_comes_with_each_change_of_state_and_every_4_ms(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.to(State.STANDING)
    ages = []
    for _ in range(40):
        bench.run(1)
        ages.append(bench.axis.cycles - int(bench.manned.status.cycles))
    assert (min(ages), max(ages)) == (0, 7)  # periods of 0.5 ms
    while bench.axis.cycles % 8 != 1:
        bench.run(1)
    bench.drive.fault = Fault.EMERGENCY
    bench.run(1)
    assert bench.manned.status.state == State.QUICK_STOPPING
    assert bench.manned.status.cycles == bench.axis.cycles


def test_no_drive_is_offline_and_told(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.refuses = True
    bench.axis.happen(Event.CONNECT)
    assert bench.axis.state is State.OFFLINE
    assert bench.manned.board.words == "no drive; is it powered?"
    assert not bench.order(Order(Event.ENABLE))


@pytest.mark.parametrize("method", ["index", "limit"])
def test_homing_on_a_signal_counts_from_there(ball_screw: Setup, method: Any) -> None:
    """The signal comes at 1 rad; the place is the period's, at 6 rad/s within 3 mrad."""
    bench = Bench(ball_screw, Homing(method, 6.0, 100.0, 0.0, 11, 1.0))
    bench.to(State.STANDING)
    assert not bench.axis.homed
    assert not bench.order(Order(Event.MOVE, (0.0, 10.0, 0.0, 0.0, 1.0)))
    assert "no home yet" in bench.manned.board.words
    assert bench.order(Order(Event.HOME))
    for _ in range(4000):
        bench.drive.statusword = 0x27 | (bench.drive.plant.position > 1.0) << 11
        bench.run(1)
        if bench.axis.state is State.STANDING:
            break
    assert bench.axis.homed
    bench.run(400)
    assert bench.axis.seen.position == pytest.approx(bench.drive.plant.position - 1.0 + 1.0, abs=0.0035)
    assert bench.manned.status.settled > 0.05
    assert np.max(np.abs(np.diff(bench.rows()["current"][200:]))) < 3.0  # the friction's reversal at the start, no jump
    assert bench.axis.fault is Fault.NONE


def test_a_home_that_does_not_come_is_a_fault_at_its_distance(ball_screw: Setup) -> None:
    bench = Bench(ball_screw, Homing("limit", -6.0, 2.0, 0.0, 11, 0.0))
    bench.to(State.STANDING)
    assert bench.order(Order(Event.HOME))
    bench.until(State.QUICK_STOPPING)
    assert bench.axis.fault is Fault.HOMING
    assert -2.1 < bench.drive.plant.position < -2.0
    bench.until(State.FAULT)
    assert not bench.axis.homed


def test_homing_on_an_end_stop_feels_the_current(ball_screw: Setup) -> None:
    bench = Bench(ball_screw, Homing("current", -6.0, 100.0, 4.0, 11, 0.0))
    bench.to(State.STANDING)
    assert bench.order(Order(Event.HOME))
    for _ in range(8000):
        plant = bench.drive.plant
        if plant.state.position < -1.5:  # a stop: it goes no further
            plant.state = plant.state._replace(position=-1.5, velocity=0.0)
        bench.run(1)
        if bench.axis.state is not State.HOMING:
            break
    assert bench.axis.state is State.STANDING
    assert bench.axis.homed
    assert bench.axis.offset == pytest.approx(-1.5, abs=0.01)


def test_the_drive_finds_the_home_and_the_axis_is_counted_from_there(ball_screw: Setup) -> None:
    """The drive moves it, sets its origin anew on the way, and gives it back at rest: the home is at 1 rad."""
    bench = Bench(ball_screw, BY_DRIVE)
    bench.to(State.DRIVE_HOMING)
    assert not bench.axis.homed
    for place in np.linspace(0.0, 1.5, 100):
        bench.drive.plant.state = bench.drive.plant.state._replace(position=float(place), velocity=0.0)
        bench.run(1)
    bench.drive.jump = -1.25  # its home is at 1.25 rad of what it counted before
    bench.run(3)
    assert bench.axis.state is State.DRIVE_HOMING
    bench.drive.power = Power.ON
    bench.run(2)
    assert bench.axis.state is State.STANDING
    bench.run(400)
    assert bench.axis.homed
    assert bench.axis.seen.position == pytest.approx(bench.drive.plant.position - 1.25 + 1.0, abs=1e-5)
    assert bench.drive.plant.position == pytest.approx(1.5, abs=2e-5)
    assert bench.manned.status.settled > 0.05


@pytest.mark.parametrize(("moved", "fault"), [(1.9, Fault.NONE), (2.1, Fault.HOMING)])
def test_the_drives_search_ends_at_its_distance(ball_screw: Setup, moved: float, fault: Fault) -> None:
    bench = Bench(ball_screw, BY_DRIVE)
    bench.to(State.DRIVE_HOMING)
    for _ in range(100):
        state = bench.drive.plant.state
        bench.drive.plant.state = state._replace(position=state.position + 0.01 * moved, velocity=0.0)
        bench.run(1)
    assert bench.axis.fault is fault
    assert (bench.axis.state is State.DRIVE_HOMING) is (fault is Fault.NONE)


def test_the_motor_cools_down_without_power_and_warms_up_in_the_drives_search(ball_screw: Setup) -> None:
    limits = ball_screw.file.limits._replace(continuous_current=5.0, thermal_time=1.0)
    bench = Bench(ball_screw.having(limits=limits), BY_DRIVE)
    bench.to(State.DISABLED)
    bench.axis.watch = bench.axis.watch._replace(heat=25.0)
    bench.run(round(3.0 / bench.axis.dt))
    assert bench.axis.watch.heat == pytest.approx(25.0 * math.exp(-3.0), rel=1e-2)
    assert bench.order(Order(Event.ENABLE))
    bench.until(State.STANDING)
    assert bench.order(Order(Event.HOME))
    bench.axis.now = lambda: bench.axis.entered
    sample = bench.drive.sample
    bench.drive.sample = lambda: sample()._replace(current=8.0)  # type: ignore[method-assign]
    bench.run(round(3.0 / bench.axis.dt))
    assert bench.axis.fault is Fault.OVERLOAD


def test_the_drives_search_ends_at_its_time(ball_screw: Setup) -> None:
    bench = Bench(ball_screw, BY_DRIVE)
    bench.to(State.DRIVE_HOMING)
    bench.axis.now = lambda: bench.axis.entered  # by its periods, however busy this computer is
    periods = round(BY_DRIVE.longest / bench.axis.dt)
    bench.run(periods - 120)  # of which it has had a hundred
    assert bench.axis.state is State.DRIVE_HOMING
    bench.run(40)
    assert bench.axis.fault is Fault.HOMING


def test_the_drives_search_has_one_origin_and_all_else_is_speed(ball_screw: Setup) -> None:
    """An axis that runs away faster than any motion goes must not look like an origin that jumps again and again."""
    bench = Bench(ball_screw, BY_DRIVE)
    bench.to(State.DRIVE_HOMING)
    for _ in range(20):
        bench.drive.jump += 0.9 * BY_DRIVE.distance
        bench.run(1)
        if bench.axis.state is not State.DRIVE_HOMING:
            break
    assert (bench.axis.state, bench.axis.fault) == (State.QUICK_STOPPING, Fault.SPEED)
    assert bench.drive.jump == pytest.approx(2 * 0.9 * BY_DRIVE.distance)


@pytest.mark.parametrize("stop", [Event.STOP, Event.QUICK_STOP, Event.DISABLE])
def test_a_stop_of_the_drives_search_is_the_drives_ramp(ball_screw: Setup, stop: Event) -> None:
    bench = Bench(ball_screw, BY_DRIVE)
    bench.to(State.DRIVE_HOMING)
    assert bench.order(Order(stop))
    assert bench.axis.state is State.QUICK_STOPPING
    assert bench.drive.power is Power.QUICK_STOP
    bench.until_still()
    assert bench.axis.state is State.DISABLED
    assert not bench.axis.homed


def test_home_here_needs_no_motion(ball_screw: Setup) -> None:
    bench = Bench(ball_screw, Homing("here", position=2.0))
    bench.to(State.STANDING)
    assert bench.order(Order(Event.HOME))
    assert bench.axis.state is State.STANDING
    bench.run(10)
    assert bench.axis.seen.position == pytest.approx(2.0, abs=1e-3)


def test_a_move_may_use_the_travel_that_is_left_from_where_the_axis_stands(ball_screw: Setup) -> None:
    manned, scale = AxisController("axis", ball_screw), ball_screw.file.axis.travel_per_unit
    manned.board.show(Status(reference=-0.04 / scale))  # of +-50 mm
    assert laid_out(manned.move(0.08, 0.1, None)).span[1] * scale == pytest.approx(0.08)
    assert laid_out(manned.move(-0.009, 0.1, None)).span[0] * scale == pytest.approx(-0.009)
    for distance in (0.0901, -0.0101):
        with pytest.raises(TrajectoryError, match=r"limits\.travel"):
            laid_out(manned.move(distance, 0.1, None))


def test_one_lost_answer_without_power_is_no_fault(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.to(State.DISABLED)
    for _ in range(3):  # one at a time
        bench.drive.fault = Fault.FEEDBACK_LOST
        bench.run(1)
        bench.drive.fault = Fault.NONE
        bench.run(1)
    assert (bench.axis.state, bench.axis.faults) == (State.DISABLED, 0)
    bench.drive.fault = Fault.FEEDBACK_LOST
    bench.run(2)
    assert (bench.axis.state, bench.axis.faults) == (State.FAULT, 1)


def test_a_refusal_names_the_state_and_the_fault_that_the_loop_saw(ball_screw: Setup) -> None:
    bench = Bench(ball_screw)
    bench.to(State.DISABLED)
    bench.drive.statusword = 0x08
    bench.drive.fault = Fault.DRIVE_FAULT
    bench.run(5)
    assert not bench.order(Order(Event.ENABLE))
    refusal = bench.manned.refusal(Event.ENABLE)
    assert "fault" in refusal and "the drive says why" in refusal
    assert STOPS[Fault.DRIVE_FAULT].words not in refusal  # it never had power
