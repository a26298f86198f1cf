"""What the steps share: the stage as it is tried, where the axis began, and what earlier steps have found."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from stagectl.config.stage_file import Setup
from stagectl.drives.bus.other_masters import alone
from stagectl.drives.drive import Canopen, DriveError
from stagectl.kernels import stage
from stagectl.motion_limits import check_current
from stagectl.number_format import length
from stagectl.service.virtual_timeouts import patient
from stagectl.workflows.acceptance.drive_reader import DriveReader, Stop, reading
from stagectl.workflows.acceptance.limits import (
    CURRENT_FACTOR,
    CURRENT_SHARE,
    NARROW_SHARE,
    RAMP_TIME,
    SPEED_SHARE,
    WINDOW_SHARE,
)
from stagectl.workflows.acceptance.result import Outcome
from stagectl.workflows.acceptance.stop_bounds import UNREAD, Protection
from stagectl.workflows.acceptance.traces import Mark, Path, Trace, traced
from stagectl.workflows.acceptance.trial import Push, Seen, Trial, ramp, trying


class StepError(DriveError):
    """A step that was done and not passed; `facts` and the distances (m of the table | rad) go into its result."""

    def __init__(
        self,
        words: str,
        facts: dict[str, Any] | None = None,
        measured: float | None = None,
        bound: float | None = None,
    ) -> None:
        super().__init__(words)
        self.facts, self.measured, self.bound = facts or {}, measured, bound


@dataclass
class Workbench:
    """One axis that is being accepted; positions in rad | m."""

    setup: Setup  # with reset none: what a test left must be seen by the next one
    current: float  # A, the largest of all tests
    start: float = 0.0
    protection: Protection = UNREAD
    drive: dict[str, str] = field(default_factory=dict)
    moving_current: float = 0.0  # A, at which the axis began to move
    mark: Mark = field(default_factory=Mark)  # of the trial at hand
    path: Path = field(default_factory=list)  # the same, once its controller is gone
    traces: list[Trace] = field(default_factory=list)  # of the step's trials

    @classmethod
    def of(cls, setup: Setup, current: float | None) -> Workbench:
        """For a stage with a CANopen drive.  Raises DriveError where it cannot be tried so; LimitError."""
        friction, bias = stage.sliding(setup.stage.friction), abs(setup.stage.mechanics.bias)
        if bias > friction:
            raise DriveError(
                f"mechanics.bias = {setup.stage.mechanics.bias:g} is more than the friction, {friction:g}: this axis"
                " falls without current, and the tests in open loop would let it. Lock it, or take the load"
                " off, and state mechanics.bias: 0 for the acceptance",
                place="mechanics.bias",
                value=setup.stage.mechanics.bias,
            )
        current = _test_current(setup) if current is None else current
        check_current(setup, current)
        return cls(setup.with_wire(reset="none"), current)

    @property
    def wire(self) -> Canopen:
        """The wire, with the time-outs that the loop takes."""
        return patient(self.setup).canopen

    @property
    def step(self) -> float:
        """One encoder count (rad | m)."""
        return self.setup.stage.encoder.step

    @property
    def window(self) -> float:
        """Room to either side of the start (rad | m)."""
        low, high = self.setup.file.limits.travel
        return WINDOW_SHARE * (high - low)

    @property
    def narrow(self) -> float:
        """The same where little is known yet."""
        return NARROW_SHARE * self.window

    @property
    def test_speed(self) -> float:
        """Speed (rad/s | m/s) at which stops are tried."""
        return SPEED_SHARE * self.setup.file.limits.speed

    def table(self, way: float) -> float:
        """A distance of the axis (rad | m) as one of the table."""
        return way * self.setup.file.axis.travel_per_unit

    def words(self, way: float) -> str:
        """A distance of the axis as a person reads it."""
        return length(self.table(way), self.setup.file.axis.travel_unit)

    def reading(self) -> contextlib.AbstractContextManager[DriveReader]:
        """The drive, with or without a loop on the bus."""
        return reading(self.wire, self.step)

    @contextlib.contextmanager
    def reading_alone(self) -> Iterator[DriveReader]:
        """The drive, where no master may be at work.  Raises OtherMasterError."""
        from stagectl.drives.bus.interfaces import open_bus

        wire = self.wire
        bus = open_bus(wire.interface, wire.channel, wire.bitrate)
        with contextlib.closing(bus), alone(wire, bus, self.setup.file.name):
            yield DriveReader(wire, bus, self.step)

    def ready(self) -> float:
        """The position (rad | m) before a trial."""
        with self.reading() as drive:
            return drive.position()

    @contextlib.contextmanager
    def creeping(self, direction: int, room: float) -> Iterator[tuple[Trial, float]]:
        """The axis begins to creep in a `direction`, with `room` (rad | m) to either side of where it is."""
        here = self.ready()
        currents = direction * ramp(self.current, RAMP_TIME, self.setup.dt)
        with self.pushed(Push(currents, self.current, here - room, here + room), here, Mark()) as trial:
            yield trial, here

    @contextlib.contextmanager
    def pushed(self, push: Push, here: float, mark: Mark) -> Iterator[Trial]:
        """A trial that begins at `here` (rad | m); its trace is kept, however it ends."""
        self.mark, self.path = mark, []
        with trying(self.setup, push) as trial:
            try:
                yield trial
            finally:
                first, rows = trial.all_rows()
                grid = (self.setup.dt, here, self.setup.file.axis.travel_per_unit)
                self.traces.append(traced(rows, first, grid, self.mark, self.path))

    def left(self, event: str, seen: Seen) -> None:
        """What happened in the period that was `seen` last: the bound counts from there."""
        self.mark = Mark(event=event, row=seen.rows - 1, origin=seen.position)

    def at_speed(self, trial: Trial, direction: int) -> Seen:
        """The axis once it moves at the test speed.  Raises StepError where the loop ended before."""
        seen = trial.until(lambda now: direction * now.speed >= self.test_speed, RAMP_TIME)
        if seen is None:
            ended = trial.end()
            reason = ended.words or f"the current rose to {self.current:g} A, and the axis did not reach the test speed"
            raise StepError(f"{reason}; with a larger --current it may", {"fault": ended.fault.name})
        return seen

    def stopped(self, seen: Seen, timeout: float, bound: float) -> Stop:
        """Watch the axis, left alone with `seen`.  Raises StepError where it does not come to rest."""
        with self.reading() as drive:
            stop = drive.watch_stop(seen.position, timeout, self.window)
        self.path = stop.path
        if not (stop.stands and stop.without_power):
            raise StepError(
                f"the drive did not stop by itself within {stop.time:.2f} s: {stop.state.words},"
                f" {self.words(stop.distance)} away; its power was cut over SDO",
                {"state": stop.state.words}, self.table(stop.distance), self.table(bound),
            )  # fmt: skip
        return stop

    def judged(self, distance: float, bound: float, **facts: Any) -> tuple[Outcome, str, float, float, dict[str, Any]]:
        """A measured distance (rad | m) against its bound."""
        outcome = Outcome.PASSED if distance <= bound else Outcome.FAILED
        relation = "within" if outcome is Outcome.PASSED else "BEYOND"
        words = f"it stood after {self.words(distance)}, {relation} the bound of {self.words(bound)}"
        return outcome, words, self.table(distance), self.table(bound), facts


Found = tuple[Outcome, str, float | None, float | None, dict[str, Any]]


def passed(words: str, **facts: Any) -> Found:
    """A step without a distance that is as it must be."""
    return Outcome.PASSED, words, None, None, facts


def _test_current(setup: Setup) -> float:
    p = setup.stage
    breakaway = stage.sliding(p.friction) * (1.0 + p.friction.stribeck.rise) / p.motor.force_constant
    return min(p.drive.current_limit, CURRENT_FACTOR * breakaway or CURRENT_SHARE * p.drive.current_limit)
