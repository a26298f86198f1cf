"""The cycle against a drive that does what a test says, and a clock that stands still."""

from __future__ import annotations

import io
import math
import signal
import sys
import time
from typing import Any, NamedTuple

import numpy as np
import pytest

from stagectl import design
from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Canopen, DriveError, Fault, Feedback
from stagectl.drives.simulated import Plant, Simulated
from stagectl.kernels import rollout
from stagectl.plan import Plan, plan
from stagectl.realtime import loop, scheduling
from stagectl.realtime.loop import Cycle, Job, run
from stagectl.realtime.safety import Envelope, words
from stagectl.recording.ring import Ring
from stagectl.simulation import simulate
from stagectl.trajectories import Sine

SINE = Sine(0.001, 3.2, 0.5, 0.5)


class Clock:
    """A monotonic clock that only sleeping and `spend` move."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr(time, "monotonic", lambda: self.now)
        monkeypatch.setattr(time, "sleep", self.spend)

    def spend(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


class Scripted(Simulated):
    """The simulated stage, with a fault, a jump or a delay at a given cycle."""

    def __init__(self, plant: Plant, script: dict[int, Any], clock: Clock) -> None:
        super().__init__(plant)
        self.script, self.clock, self.cycle, self.stopped = script, clock, -1, 0
        self.applied: list[float] = []

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

    def quick_stop(self) -> Feedback:
        self.stopped += 1
        return super().quick_stop()


def laid_out(setup: Setup) -> Plan:
    return plan(setup, SINE, design.design(setup.stage, setup.file.control).feedforward)


def job_for(setup: Setup, ring: Ring, by_clock: bool = False) -> Job:
    envelope = Envelope(*setup.file.limits.travel, 1e3, setup.file.limits.following_error, 3)
    return Job(
        law=design.design(setup.stage, setup.file.control).law,
        setpoints=laid_out(setup).setpoints.tobytes(),
        span=(-0.5, 0.5),
        dt=setup.dt,
        by_clock=by_clock,
        wire=None,
        stage=setup.stage,
        simulation=setup.file.simulation,
        envelope=envelope,
        priority=0,
        cpu=None,
        ring=ring.descriptor,
        width=ring.width,
        capacity=ring.capacity,
    )


class Moved(NamedTuple):
    tally: loop.Tally
    drive: Scripted
    rows: dict[str, Any]


def moved(setup: Setup, clock: Clock, script: dict[int, Any], by_clock: bool = False, stopped: bool = False) -> Moved:
    """Run with this script."""
    ring = Ring.create(rollout.WIDTH)
    drive = Scripted(Plant(setup.stage, setup.file.simulation, setup.dt), script, clock)
    drive.plant.powered = True
    tally = run(job_for(setup, ring, by_clock), drive, ring, 0.0, [2] if stopped else [])
    rows = np.frombuffer(ring.read(0, ring.capacity)[1]).reshape(-1, rollout.WIDTH)
    return Moved(tally, drive, {name: rows[:, k] for k, name in enumerate(rollout.COLUMNS)})


def test_a_whole_motion_is_what_simulate_gives(ball_screw: Setup, clock: Clock) -> None:
    tally, drive, rows = moved(ball_screw, clock, {})
    law = design.design(ball_screw.stage, ball_screw.file.control).law
    expected = simulate(ball_screw, laid_out(ball_screw), law)
    assert tally == loop.Tally(len(expected), 0, Fault.NONE)
    for name in ("time", "measured", "target", "command", "current"):
        assert np.array_equal(rows[name], expected[name]), name
    assert drive.stopped == 0


@pytest.mark.parametrize("fault", [Fault.FEEDBACK_LOST, Fault.DRIVE_FAULT, Fault.EMERGENCY, Fault.BUS])
def test_a_fault_of_the_drive_ends_the_motion_at_once(ball_screw: Setup, clock: Clock, fault: Fault) -> None:
    tally, drive, rows = moved(ball_screw, clock, {100: fault})
    assert tally == loop.Tally(101, 0, fault)
    assert drive.applied[-1] == 0.0  # no command is computed from feedback that cannot be trusted
    assert drive.stopped == 1
    assert rows["fault"][-1] == fault
    assert np.all(rows["fault"][:-1] == 0)


def test_a_jump_of_the_encoder_is_a_following_error(ball_screw: Setup, clock: Clock) -> None:
    tally, drive, _ = moved(ball_screw, clock, {50: Feedback(1.0, 0.0, 0x27, Fault.NONE)})
    assert tally.fault is Fault.FOLLOWING_ERROR
    assert drive.applied[-1] == 0.0


def test_late_cycles_are_counted_and_the_grid_moves_on_in_whole_periods(ball_screw: Setup, clock: Clock) -> None:
    dt = ball_screw.dt
    tally, drive, rows = moved(ball_screw, clock, {10: 1.5 * dt, 20: 0.9 * dt, 30: 7.2 * dt})
    assert (tally.late, tally.fault) == (2, Fault.NONE)
    assert np.flatnonzero(rows["late"]).tolist() == [10, 30]
    assert rows["lateness"] == pytest.approx(np.zeros(len(rows["late"])), abs=1e-9)  # each begins on the grid
    assert clock.now - 100.0 == pytest.approx((len(rows["late"]) + 1 + 7) * dt, rel=1e-9)
    assert drive.stopped == 0


def test_too_many_late_cycles_in_a_row_stop_the_axis(ball_screw: Setup, clock: Clock) -> None:
    late = 1.5 * ball_screw.dt
    assert moved(ball_screw, clock, {10: late, 11: late, 13: late, 14: late})[0].fault is Fault.NONE
    tally, drive, _ = moved(ball_screw, clock, {10: late, 11: late, 12: late})
    assert tally == loop.Tally(13, 3, Fault.LATE)
    assert drive.stopped == 1


def test_the_operator_stops_it(ball_screw: Setup, clock: Clock) -> None:
    tally, drive, _ = moved(ball_screw, clock, {}, stopped=True)
    assert tally == loop.Tally(0, 0, Fault.OPERATOR)
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
    ring = Ring.create(rollout.WIDTH)
    drive = Coasting(Plant(ball_screw.stage, ball_screw.file.simulation, ball_screw.dt), {}, clock)
    drive.plant.powered = True
    tally = run(job_for(ball_screw, ring, by_clock), drive, ring, 0.0, [])
    rows = np.frombuffer(ring.read(0, ring.capacity)[1]).reshape(-1, rollout.WIDTH)
    time, error = rows[:, 0], np.abs(rows[:, 1] - rows[:, rollout.COLUMNS.index("measured")])
    assert (tally.late, tally.fault) == (1, Fault.NONE)
    assert np.max(np.diff(time)) == pytest.approx((7 if by_clock else 1) * ball_screw.dt, rel=1e-6)
    found = float(np.max(error[313:])) * ball_screw.file.axis.travel_per_unit
    assert (found < worst) if by_clock else (found > worst)


def test_a_motion_from_elsewhere_is_the_same_motion(ball_screw: Setup) -> None:
    """References are relative to where the axis stands."""
    table = laid_out(ball_screw).setpoints
    for k in (0, 100, len(table) - 1):
        row = loop.setpoint(table.tobytes(), k, 0.25)
        shifted = (table[k] + [0.25, 0.25, *[0.0] * 6]).tolist()
        assert list(row) == shifted


def test_cycles_begin_on_the_grid(ball_screw: Setup, clock: Clock) -> None:
    ring = Ring.create(rollout.WIDTH)
    drive = Scripted(Plant(ball_screw.stage, ball_screw.file.simulation, ball_screw.dt), {}, clock)
    cycle = Cycle(job_for(ball_screw, ring), drive, ring, 0.0)
    began = clock.now
    for _ in range(100):
        cycle()
    assert clock.now - began == pytest.approx(100 * ball_screw.dt, rel=1e-9)


def test_a_motion_that_would_leave_the_travel_never_starts(ball_screw: Setup) -> None:
    job = job_for(ball_screw, Ring.create(rollout.WIDTH))
    low, high = ball_screw.file.limits.travel
    loop._fits(job, 0.0)
    loop._fits(job, high - 0.5)
    for origin in (high - 0.499, low + 0.499):
        with pytest.raises(DriveError, match=r"limits\.travel is .*: move it back, then run again"):
            loop._fits(job, origin)


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
    clock.late_at, clock.by = 201, 3.25 * dt
    tally, _, rows = moved(ball_screw, clock, {}, by_clock)
    skipped = 3 if by_clock else 0
    assert tally == loop.Tally(len(laid_out(ball_screw).setpoints) - skipped, 1, Fault.NONE)
    assert np.flatnonzero(rows["late"]).tolist() == [200]
    assert rows["lateness"][200] == pytest.approx(3.25 * dt, rel=1e-6)
    row = np.rint(rows["time"] / dt).astype(int)
    assert row.tolist() == [k + (skipped if k >= 200 else 0) for k in range(len(row))]
    for column, name in enumerate(("reference", "target", "feedforward", "friction")):
        assert np.array_equal(rows[name], laid_out(ball_screw).setpoints[row, column]), name


def test_oversleeping_the_end_asks_for_the_last_row(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Overslept(monkeypatch)
    count = len(laid_out(ball_screw).setpoints)
    clock.late_at, clock.by = count, 5.5 * ball_screw.dt
    tally, _, rows = moved(ball_screw, clock, {}, by_clock=True)
    assert (tally.cycles, tally.late, tally.fault) == (count, 1, Fault.NONE)
    assert rows["reference"][-1] == laid_out(ball_screw).setpoints[-1, 0]
    assert rows["time"][-1] == pytest.approx((count - 1) * ball_screw.dt)


def test_the_speed_is_taken_over_the_periods_that_passed(ball_screw: Setup, clock: Clock) -> None:
    """A stall of six periods at 20 mm/s is no speed of 140 mm/s; 20 mm/s over a limit of 19 is one."""
    for limit, fault in ((0.030, Fault.NONE), (0.019, Fault.SPEED)):
        ring = Ring.create(rollout.WIDTH)
        drive = Coasting(Plant(ball_screw.stage, ball_screw.file.simulation, ball_screw.dt), {}, clock)
        drive.plant.powered = True
        job = job_for(ball_screw, ring, by_clock=True)
        speed = limit / ball_screw.file.axis.travel_per_unit
        tally = run(job._replace(envelope=job.envelope._replace(speed=speed)), drive, ring, 0.0, [])
        assert tally.fault is fault


def served(
    setup: Setup,
    monkeypatch: pytest.MonkeyPatch,
    script: dict[int, Any],
    clock: Clock,
    told: list[Any] | None = None,
    **changes: Any,
) -> tuple[list[dict[str, Any]], Scripted, Ring, list[Any]]:
    """`loop.serve` in this process: (events, drive, ring, what was asked of the kernel)."""
    ring, events, asked = Ring.create(rollout.WIDTH), list[dict[str, Any]](), [] if told is None else told

    def prepared(*order: Any) -> list[str]:
        asked.append(order)
        return ["no real time"]

    drive = Scripted(Plant(setup.stage, setup.file.simulation, setup.dt), script, clock)
    monkeypatch.setattr(drive, "explain", lambda: "because", raising=False)
    monkeypatch.setattr(loop, "connect", lambda job: drive)
    monkeypatch.setattr(loop, "_say", lambda event, **facts: events.append({"event": event, **facts}))
    monkeypatch.setattr(scheduling, "prepare", prepared)
    monkeypatch.setattr(scheduling, "follow_parent", lambda: None)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr(sys, "stdin", io.StringIO("go\n"))
    monkeypatch.setattr(drive, "close", lambda: asked.append("closed"))
    loop.serve(job_for(setup, ring)._replace(**changes))
    return events, drive, ring, asked


def test_a_motion_is_told_step_by_step(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    events, _, ring, asked = served(ball_screw, monkeypatch, {}, clock, priority=42, cpu=1)
    assert [event["event"] for event in events] == ["connected", "moving", "ended"]
    assert events[1] == {"event": "moving", "refused": ["no real time"], "origin": 0.0}
    assert events[2] == {
        **{"event": "ended", "cycles": ring.written, "late": 0, "fault": 0, "words": "", "reason": ""},
    }
    assert asked == [(42, 1), "closed"]
    assert ring.closed


@pytest.mark.parametrize("fault", [Fault.FEEDBACK_LOST, Fault.DRIVE_FAULT, Fault.EMERGENCY, Fault.BUS])
def test_a_fault_of_the_drive_is_explained_by_the_drive(
    ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, clock: Clock, fault: Fault
) -> None:
    events, drive, ring, _ = served(ball_screw, monkeypatch, {50: fault}, clock)
    assert (events[-1]["fault"], events[-1]["words"], events[-1]["reason"]) == (fault, words(fault), "because")
    assert drive.stopped == 1
    assert ring.closed


def test_a_fault_of_ours_is_not_the_drives_to_explain(
    ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    jump = Feedback(1.0, 0.0, 0x27, Fault.NONE)
    events, _, _, _ = served(ball_screw, monkeypatch, {50: jump}, clock)
    assert (events[-1]["fault"], events[-1]["reason"]) == (Fault.FOLLOWING_ERROR, "")


def test_what_does_not_fit_ends_without_power(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    asked: list[Any] = []
    with pytest.raises(DriveError, match=r"limits\.travel"):
        served(ball_screw, monkeypatch, {}, clock, asked, span=(-1e3, 0.0))
    assert asked[-1] == "closed"


def test_the_canopen_drive_gets_the_stages_step_and_period(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    wire = ball_screw.file.drive.wire
    assert isinstance(wire, Canopen)
    monkeypatch.setattr(loop, "open_bus", lambda *names: names)
    monkeypatch.setattr(loop, "CanopenDrive", lambda *order: order)
    found: Any = loop.connect(job_for(ball_screw, Ring.create(rollout.WIDTH))._replace(wire=wire))
    assert found == (wire, ("embedded", "stage", 1e6), 2.0 * math.pi / 2**20, 5e-4)
