"""One motion in the real-time process, with a drive that does what a test says and a clock that stands still."""

from __future__ import annotations

import io
import math
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest

from stagectl import design
from stagectl.config.stage_file import Setup
from stagectl.drives.brake import NO_BRAKE
from stagectl.drives.canopen import drive as canopen_drive
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.clock import WALL
from stagectl.drives.drive import Canopen, DriveError, Fault, Feedback, Power
from stagectl.drives.simulated import Plant, Simulated
from stagectl.kernels import rollout
from stagectl.plan import Plan, plan
from stagectl.realtime import axes, drive_opening, scheduling
from stagectl.realtime.axes import Loop, Post
from stagectl.realtime.axis_data import Orders
from stagectl.realtime.safety import Envelope, words
from stagectl.realtime.setpoint_sources import Rows, held
from stagectl.realtime.shared_memory import Board, Move, Order
from stagectl.realtime.single_axis import SingleAxis
from stagectl.realtime.states import Event, State
from stagectl.realtime.stops import STOPS
from stagectl.recording.ring import Ring
from stagectl.service.single_motion import Motion, Shared, event_of, laid_on, posted
from stagectl.simulation import simulate
from stagectl.trajectories import Sine

SINE = Sine(0.001, 3.2, 0.5, 0.5)


class Clock:
    """A monotonic clock that only sleeping and `spend` move."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr(time, "monotonic", lambda: self.now)
        monkeypatch.setattr(WALL, "now", lambda: self.now, raising=False)
        monkeypatch.setattr(time, "sleep", self.spend)
        monkeypatch.setattr(WALL, "sleep", self.spend, raising=False)

    def spend(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


class Scripted(Simulated):
    """The simulated stage, with a fault, a jump or a delay in a given cycle of the motion."""

    def __init__(self, setup: Setup, script: dict[int, Any], clock: Clock) -> None:
        super().__init__(Plant(setup.stage, setup.file.simulation, setup.dt))
        self.script, self.clock, self.cycle = script, clock, -2  # the period in which power comes is -1
        self.applied: list[float] = []
        self.asked: list[Power] = []
        self.closed = False

    def sample(self) -> Feedback:
        self.cycle += 1
        event = self.script.get(self.cycle)
        feedback = super().sample()
        if isinstance(event, float):
            self.clock.spend(event)
        if isinstance(event, Feedback):
            return event
        return feedback._replace(fault=event) if isinstance(event, Fault) else feedback

    def apply(self, current: float) -> None:
        self.applied.append(current)
        super().apply(current)

    def ask(self, power: Power) -> None:
        self.asked.append(power)
        super().ask(power)

    def explain(self) -> str:
        return "because"

    def close(self) -> None:
        self.closed = True
        super().close()

    @property
    def stopped(self) -> int:
        return self.asked.count(Power.QUICK_STOP)


class Tally(NamedTuple):
    """How the motion went."""

    cycles: int
    late: int
    fault: Fault


class Moved(NamedTuple):
    tally: Tally
    drive: Scripted
    rows: dict[str, Any]
    took: float  # s, of the motion's periods until its end or its fault


def laid_out(setup: Setup) -> Plan:
    return plan(setup, SINE, design.design(setup.stage, setup.file.control).feedforward)


def ordered(setup: Setup, by_clock: bool = False, **changes: Any) -> tuple[Shared, Post]:
    """Memory and order of a process for the motion, with a plain envelope."""
    running = design.design(setup.stage, setup.file.control).law
    motion = Motion(setup, laid_out(setup), running, {}, Path())
    shared = Shared(Ring.create(rollout.WIDTH), Board.create(len(motion.plan.setpoints)))
    envelope = Envelope(*setup.file.limits.travel, 1e3, setup.file.limits.following_error, 3)
    post = posted(motion, shared)
    job = post.axes[0]._replace(wire=None, by_clock=by_clock, envelope=envelope._replace(**changes))
    return shared, post._replace(axes=(job,))


class Given(Loop):
    """The loop of the process, on a drive that is there."""

    drive: Scripted

    def _connect(self, p: Orders) -> Scripted:
        return self.drive


def single(loop: Loop) -> SingleAxis:
    (axis,) = loop.axes
    assert isinstance(axis, SingleAxis)
    return axis


def moved(
    setup: Setup, drive: Scripted, clock: Clock, by_clock: bool = False, envelope: dict[str, float] | None = None
) -> Moved:
    """The motion with this drive."""
    (ring, board), post = ordered(setup, by_clock, **(envelope or {}))
    loop = Given(post)
    loop.drive, axis = drive, single(loop)
    loop.connect()
    board.order(Order(Event.ENABLE))
    board.order(laid_on(board, laid_out(setup).setpoints))
    loop.begin()
    loop.period()
    began, took = clock.now, 0.0
    assert axis.state is State.MOVING
    while not axis.over:
        moving = axis.state is State.MOVING
        loop.period()
        took = clock.now - began if moving else took
    loop.leave()
    rows = np.frombuffer(ring.read(0, ring.capacity)[1]).reshape(-1, rollout.WIDTH)
    tally = Tally(ring.written, axis.late_rows, axis.fault)
    return Moved(tally, drive, {name: rows[:, k] for k, name in enumerate(rollout.COLUMNS)}, took)


def scripted(setup: Setup, clock: Clock, script: dict[int, Any], by_clock: bool = False) -> Moved:
    return moved(setup, Scripted(setup, script, clock), clock, by_clock)


def test_a_whole_motion_is_what_simulate_gives(ball_screw: Setup, clock: Clock) -> None:
    tally, drive, rows, _ = scripted(ball_screw, clock, {})
    law = design.design(ball_screw.stage, ball_screw.file.control).law
    expected = simulate(ball_screw, laid_out(ball_screw), law)
    assert tally == Tally(len(expected), 0, Fault.NONE)
    for name in ("time", "measured", "target", "command", "current"):
        assert np.array_equal(rows[name], expected[name]), name
    assert drive.stopped == 0
    assert len(drive.applied) == len(expected)  # and nothing after the last row but the end of power
    assert drive.closed


@pytest.mark.parametrize("fault", [Fault.FEEDBACK_LOST, Fault.DRIVE_FAULT, Fault.EMERGENCY, Fault.BUS])
def test_a_fault_of_the_drive_ends_the_motion_at_once(ball_screw: Setup, clock: Clock, fault: Fault) -> None:
    tally, drive, rows, _ = scripted(ball_screw, clock, {100: fault})
    assert tally == Tally(101, 0, fault)
    assert set(drive.applied[100:]) == {0.0}  # no command is computed from feedback that cannot be trusted
    assert drive.stopped == 1
    assert rows["fault"][-1] == fault
    assert np.all(rows["fault"][:-1] == 0)


def test_a_jump_of_the_encoder_is_a_following_error(ball_screw: Setup, clock: Clock) -> None:
    tally, drive, _, _ = scripted(ball_screw, clock, {50: Feedback(1.0, 0.0, 0x27, Fault.NONE)})
    assert tally.fault is Fault.FOLLOWING_ERROR
    assert set(drive.applied[50:]) == {0.0}


def test_late_cycles_are_counted_and_the_grid_moves_on_in_whole_periods(ball_screw: Setup, clock: Clock) -> None:
    dt = ball_screw.dt
    tally, drive, rows, took = scripted(ball_screw, clock, {10: 1.5 * dt, 20: 0.9 * dt, 30: 7.2 * dt})
    assert (tally.late, tally.fault) == (2, Fault.NONE)
    assert np.flatnonzero(rows["late"]).tolist() == [10, 30]
    assert rows["lateness"] == pytest.approx(np.zeros(len(rows["late"])), abs=1e-9)  # each begins on the grid
    assert took == pytest.approx((len(rows["late"]) + 1 + 7) * dt, rel=1e-9)
    assert drive.stopped == 0


def test_too_many_late_cycles_in_a_row_stop_the_axis(ball_screw: Setup, clock: Clock) -> None:
    late = 1.5 * ball_screw.dt
    assert scripted(ball_screw, clock, {10: late, 11: late, 13: late, 14: late}).tally.fault is Fault.NONE
    tally, drive, rows, _ = scripted(ball_screw, clock, {10: late, 11: late, 12: late})
    assert tally == Tally(13, 3, Fault.LATE)
    assert rows["fault"][-1] == Fault.LATE
    assert drive.stopped == 1


class Coasting(Scripted):
    """A machine: while the controller stalls after its command, time goes on and that current acts."""

    def apply(self, current: float) -> None:
        super().apply(current)
        if self.cycle == 312:  # at 20 mm/s
            self.clock.spend(3.05e-3)
            for _ in range(6):
                self.plant.advance(current)


@pytest.mark.parametrize(("by_clock", "worst"), [(True, 2e-6), (False, 50e-6)])
def test_where_time_runs_by_the_clock_missed_periods_are_missed_rows(
    ball_screw: Setup, clock: Clock, by_clock: bool, worst: float
) -> None:
    """A stall of 3 ms at full speed: the reference must not wait for us, as the axis did not."""
    tally, _, rows, _ = moved(ball_screw, Coasting(ball_screw, {}, clock), clock, by_clock)
    error = np.abs(rows["reference"] - rows["measured"])
    assert (tally.late, tally.fault) == (1, Fault.NONE)
    assert np.max(np.diff(rows["time"])) == pytest.approx((7 if by_clock else 1) * ball_screw.dt, rel=1e-6)
    largest = float(np.max(error[313:])) * ball_screw.file.axis.travel_per_unit
    assert (largest < worst) if by_clock else (largest > worst)


def test_a_motion_from_elsewhere_is_the_same_motion(ball_screw: Setup) -> None:
    """References are relative to where the axis stands."""
    table, board = laid_out(ball_screw).setpoints, Board.create(10000)
    laid_on(board, table)
    source = Rows(board, 0, len(table), 0.25)
    for k in range(len(table)):
        assert source.next(1) == tuple((table[k] + [0.25, 0.25, *[0.0] * 6]).tolist())
        assert source.over == (k == len(table) - 1)
        if k % 2:  # prepared beforehand or not: the same row
            source.prepare()


def test_cycles_begin_on_the_grid(ball_screw: Setup, clock: Clock) -> None:
    tally, _, _, took = scripted(ball_screw, clock, {})
    assert took == pytest.approx(tally.cycles * ball_screw.dt, rel=1e-9)


def test_a_motion_that_would_leave_the_travel_never_starts(ball_screw: Setup, clock: Clock) -> None:
    (_, board), post = ordered(ball_screw)
    axis = single(Given(post))
    axis.state = State.STANDING
    low, high = ball_screw.file.limits.travel
    for origin, fits in ((0.0, True), (high - 0.5, True), (high - 0.499, False), (low + 0.499, False)):
        axis.asked = held(origin, 0.0)
        assert axis.may_begin(Order(Event.MOVE, Move(0.0, 10.0, -0.5, 0.5, 1.0))) == fits
    assert f"the axis is at {axis.p.limits.place(low + 0.499)}" in board.words
    assert "limits.travel is" in board.words and board.words.endswith(": move the axis back, then run again")


class Overslept(Clock):
    """A clock whose sleep ends late once: the kernel gave the processor to somebody else."""

    late_at, by = -1, 0.0

    def spend(self, seconds: float) -> None:
        super().spend(seconds)
        self.late_at -= 1
        if self.late_at == 0:
            super().spend(self.by)


@pytest.mark.parametrize("by_clock", [True, False])
def test_to_oversleep_is_late_and_by_the_clock_skips_rows(
    ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, by_clock: bool
) -> None:
    """Woken 3.25 periods late in cycle 200: late by that much, with the setpoint of the row that is due then."""
    clock, dt = Overslept(monkeypatch), ball_screw.dt
    clock.late_at, clock.by = 202, 3.25 * dt  # the first period is that in which power comes
    tally, _, rows, _ = scripted(ball_screw, clock, {}, by_clock)
    skipped = 3 if by_clock else 0
    assert tally == Tally(len(laid_out(ball_screw).setpoints) - skipped, 1, Fault.NONE)
    assert np.flatnonzero(rows["late"]).tolist() == [200]
    assert rows["lateness"][200] == pytest.approx(3.25 * dt, rel=1e-6)
    row = np.rint(rows["time"] / dt).astype(int)
    assert row.tolist() == [k + (skipped if k >= 200 else 0) for k in range(len(row))]
    for column, name in enumerate(("reference", "target", "feedforward", "friction")):
        assert np.array_equal(rows[name], laid_out(ball_screw).setpoints[row, column]), name


def test_oversleeping_the_end_asks_for_the_last_row(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Overslept(monkeypatch)
    count = len(laid_out(ball_screw).setpoints)
    clock.late_at, clock.by = count + 1, 5.5 * ball_screw.dt
    tally, _, rows, _ = scripted(ball_screw, clock, {}, by_clock=True)
    assert (tally.cycles, tally.late, tally.fault) == (count, 1, Fault.NONE)
    assert rows["reference"][-1] == laid_out(ball_screw).setpoints[-1, 0]
    assert rows["time"][-1] == pytest.approx((count - 1) * ball_screw.dt)


def test_a_motion_begins_with_its_first_row_however_late(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Overslept(monkeypatch)
    clock.late_at, clock.by = 2, 5.5 * ball_screw.dt
    tally, _, rows, _ = scripted(ball_screw, clock, {}, by_clock=True)
    assert (rows["time"][0], rows["late"][0], tally.late) == (0.0, 1.0, 1)
    assert tally.cycles == len(laid_out(ball_screw).setpoints)


def test_the_speed_is_taken_over_the_periods_that_passed(ball_screw: Setup, clock: Clock) -> None:
    """A stall of six periods at 20 mm/s is no speed of 140 mm/s; 20 mm/s over a limit of 19 is one."""
    for limit, fault in ((0.030, Fault.NONE), (0.019, Fault.SPEED)):
        speed = limit / ball_screw.file.axis.travel_per_unit
        drive = Coasting(ball_screw, {}, clock)
        assert moved(ball_screw, drive, clock, True, {"speed": speed}).tally.fault is fault


class Performed(NamedTuple):
    events: list[dict[str, Any]]
    drive: Scripted
    ring: Ring
    prepared: list[Any]  # what was asked of the kernel


def performed(
    setup: Setup, monkeypatch: pytest.MonkeyPatch, drive: Scripted, *, low: float = -0.5, **changes: Any
) -> Performed:
    """`axes.perform` in this process; `stopped`: the signals that have come before it begins."""
    (ring, board), post = ordered(setup)
    events, prepared = list[dict[str, Any]](), list[Any]()
    stopped: list[int] = changes.pop("stopped", [])

    def say(event: str, **facts: Any) -> None:
        events.append({"event": event, **facts})
        if event == "ready":
            move = laid_on(board, laid_out(setup).setpoints)
            board.order(Order(Event.ENABLE))
            board.order(move._replace(numbers=Move(*move.numbers)._replace(low=low)))

    def prepare(*order: Any) -> list[str]:
        prepared.append(order)
        return ["no real time"]

    monkeypatch.setattr(Loop, "_connect", lambda _, p: drive)
    monkeypatch.setattr(axes, "_say", say)
    monkeypatch.setattr(scheduling, "prepare", prepare)
    monkeypatch.setattr(axes, "_stops", lambda: stopped)
    monkeypatch.setattr(sys, "stdin", io.StringIO("go\n"))
    axes.perform(post._replace(**changes))
    return Performed(events, drive, ring, prepared)


def test_a_motion_is_told_step_by_step(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    drive = Scripted(ball_screw, {}, clock)
    events, _, ring, prepared = performed(ball_screw, monkeypatch, drive, priority=42, cpu=1)
    assert [event["event"] for event in events] == ["ready", "ended"]
    ready = {"event": "ready", "refused": ["no real time"], "drive": drive.describe(), "position": 0.0}
    assert events[0] == ready
    assert events[1] == {
        **{"event": "ended", "cycles": ring.written, "late": 0, "fault": 0, "words": "", "reason": ""},
    }
    assert prepared == [(42, 1)]
    assert drive.closed
    assert ring.closed


@pytest.mark.parametrize("fault", [Fault.FEEDBACK_LOST, Fault.DRIVE_FAULT, Fault.EMERGENCY, Fault.BUS])
def test_a_fault_of_the_drive_is_explained_by_the_drive(
    ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, clock: Clock, fault: Fault
) -> None:
    events, drive, ring, _ = performed(ball_screw, monkeypatch, Scripted(ball_screw, {50: fault}, clock))
    assert (events[-1]["fault"], events[-1]["words"], events[-1]["reason"]) == (fault, words(fault), "because")
    assert events[-1]["cycles"] == 51
    assert drive.stopped == 1
    assert ring.closed


def test_a_fault_of_ours_is_not_the_drives_to_explain(
    ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    jump = Feedback(1.0, 0.0, 0x27, Fault.NONE)
    events, _, _, _ = performed(ball_screw, monkeypatch, Scripted(ball_screw, {50: jump}, clock))
    causes = STOPS[Fault.FOLLOWING_ERROR].causes  # ours, and nothing of the drive
    assert (events[-1]["fault"], events[-1]["reason"]) == (Fault.FOLLOWING_ERROR, causes)


def test_the_operator_stops_it(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    """Before its first row: then power goes again."""
    drive = Scripted(ball_screw, {}, clock)
    events, _, ring, _ = performed(ball_screw, monkeypatch, drive, stopped=[2])
    facts = {"cycles": 0, "late": 0, "fault": Fault.OPERATOR, "words": words(Fault.OPERATOR), "reason": ""}
    assert events[-1] == {"event": "ended", **facts}
    assert drive.closed and not drive.plant.powered
    assert ring.closed


def test_what_does_not_fit_ends_without_power(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    drive = Scripted(ball_screw, {}, clock)
    with pytest.raises(DriveError, match=r"limits\.travel"):
        performed(ball_screw, monkeypatch, drive, low=-1e3)
    assert drive.closed and not drive.plant.powered


def test_power_that_does_not_come_is_explained_and_nothing_moves(
    ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    drive = Scripted(ball_screw, dict.fromkeys(range(-1, 20000), Fault.DRIVE_FAULT), clock)
    with pytest.raises(DriveError, match="because"):
        performed(ball_screw, monkeypatch, drive)
    assert 5.0 < clock.now - 100.0 < 5.1
    assert drive.closed
    assert set(drive.applied) == {0.0}


@pytest.mark.parametrize("expected", ["ready", "ended"])
def test_a_loop_that_dies_before_it_is_ready_has_reached_no_drive(expected: str) -> None:
    with pytest.raises(DriveError) as caught:
        event_of(cast("Any", SimpleNamespace(line=lambda: "")), expected)
    assert ("heartbeat" in str(caught.value)) is (expected == "ended")


def test_a_drive_that_is_not_there_is_the_reason(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Loop, p: Orders) -> Any:
        raise DriveError("no drive; is it powered?")

    _, post = ordered(ball_screw)
    monkeypatch.setattr(Loop, "_connect", refuse)
    monkeypatch.setattr(axes, "_stops", list)
    with pytest.raises(DriveError, match="no drive; is it powered"):
        axes.perform(post)


def test_the_canopen_drive_gets_the_stages_step_and_period(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    wire = ball_screw.file.drive.wire
    assert isinstance(wire, Canopen)
    _, post = ordered(ball_screw)
    monkeypatch.setattr(drive_opening, "open_bus", lambda *names: names)
    monkeypatch.setattr(drive_opening, "listen", lambda wire, bus: None)
    monkeypatch.setattr(canopen_drive, "CanopenDrive", lambda *order: order)
    opening = drive_opening.Opening(False)
    axis = post.axes[0]._replace(wire=wire)
    drive: Any = opening.drive(axis)
    opening.close()
    wishes = Wishes(wire, 2.0 * math.pi / 2**20, 5e-4, axis.limits, axis.homing)
    assert drive == (wishes, ("embedded", "stage", 1e6), NO_BRAKE)


@pytest.mark.parametrize("error", [DriveError("it refuses"), OSError("the interface went down")])
def test_a_drive_that_is_not_opened_leaves_the_bus(
    ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    """Or else its port would go on being the one that sends SYNC, and no other axis of the bus would get any."""
    _, post = ordered(ball_screw)
    bus: Any = SimpleNamespace(closed=False)
    bus.close = lambda: setattr(bus, "closed", True)

    def fail(*_: Any, **__: Any) -> Any:
        raise error

    monkeypatch.setattr(drive_opening, "open_bus", lambda *names: bus)
    monkeypatch.setattr(drive_opening, "listen", lambda wire, bus: None)
    monkeypatch.setattr(canopen_drive, "CanopenDrive", fail)
    opening = drive_opening.Opening(True)
    with pytest.raises(type(error)):
        opening.drive(post.axes[0]._replace(wire=ball_screw.canopen))
    opening.close()
    assert bus.closed
