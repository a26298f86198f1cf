"""What the steps share: the stage as it is tried, where the axis began, and what earlier steps have found."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.bus.other_masters import alone
from stagectl.drives.drive import Canopen, DriveError
from stagectl.kernels import equilibrium, stage
from stagectl.motion_limits import check_current
from stagectl.service.virtual_timeouts import patient
from stagectl.workflows.acceptance import limits
from stagectl.workflows.acceptance.drive_reader import UNREAD, DriveReader, Protection, Stop
from stagectl.workflows.acceptance.result import Outcome
from stagectl.workflows.acceptance.traces import Mark, Path, Trace, traced
from stagectl.workflows.acceptance.trial import Push, Seen, Trial, ramp, trying


class Found(NamedTuple):
    """How a step ended; the distances in m of the table, or in rad."""

    outcome: Outcome
    words: str
    facts: Mapping[str, Any] = MappingProxyType({})
    measured: float | None = None
    bound: float | None = None


class StepError(DriveError):
    """A step that was done and not passed."""

    def __init__(self, words: str, facts: Mapping[str, Any] = MappingProxyType({}), *distances: float) -> None:
        super().__init__(words)
        self.found = Found(Outcome.FAILED, words, facts, *distances)


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
        friction, p = stage.sliding(setup.stage.friction), setup.stage.mechanics
        if (pull := equilibrium.weight(p)) > friction:
            place, value = ("mechanics.bias", p.bias) if p.bias else ("mechanics.gravity", p.gravity.amplitude)
            raise DriveError(
                f"{place} = {value:g}: the weight, {pull:g}, is more than the friction, {friction:g}: this axis"
                " falls without current, and the tests in open loop would let it. Lock it, or take the load"
                " off, and state a weight of 0 for the acceptance",
                place=place,
                value=value,
            )
        if current is None:
            check_current(setup, current := _test_current(setup), "the current that the friction needs")
        else:
            check_current(setup, current, "--current")
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
        return limits.WINDOW_SHARE * (high - low)

    @property
    def narrow(self) -> float:
        """The same where little is known yet."""
        return limits.NARROW_SHARE * self.window

    @property
    def test_speed(self) -> float:
        """Speed (rad/s | m/s) at which stops are tried."""
        return limits.SPEED_SHARE * self.setup.file.limits.speed

    def table(self, way: float) -> float:
        """A distance of the axis (rad | m) as one of the table."""
        return way * self.setup.file.axis.travel_per_unit

    def words(self, way: float) -> str:
        """A distance of the axis as a person reads it."""
        return self.setup.file.axis.travel.length(way)

    @contextlib.contextmanager
    def reading(self, beside_a_loop: bool = True) -> Iterator[DriveReader]:
        """The drive on a bus of its own, to which nothing is sent but what is asked for.

        Raises OtherMasterError where a master is at work, unless that is our loop.
        """
        wire = self.wire
        with (
            contextlib.closing(open_bus(wire.interface, wire.channel, wire.bitrate)) as bus,
            contextlib.nullcontext() if beside_a_loop else alone(wire, bus, self.setup.file.name),
        ):
            yield DriveReader(wire, bus, self.step)

    def ready(self) -> float:
        """The position (rad | m) before a trial."""
        with self.reading() as drive:
            return drive.position()

    @contextlib.contextmanager
    def creeping(self, direction: int, room: float) -> Iterator[tuple[Trial, float]]:
        """The axis begins to creep in a `direction`, with `room` (rad | m) to either side of where it is."""
        here = self.ready()
        currents = direction * ramp(self.current, limits.RAMP_TIME, self.setup.dt)
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
        seen = trial.until(lambda now: direction * now.speed >= self.test_speed, limits.RAMP_TIME)
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

    def judged(self, distance: float, bound: float, **facts: Any) -> Found:
        """A measured distance (rad | m) against its bound."""
        outcome = Outcome.PASSED if distance <= bound else Outcome.FAILED
        relation = "within" if outcome is Outcome.PASSED else "BEYOND"
        words = f"it stood after {self.words(distance)}, {relation} the bound of {self.words(bound)}"
        return Found(outcome, words, facts, self.table(distance), self.table(bound))


def passed(words: str, **facts: Any) -> Found:
    """A step without a distance that is as it must be."""
    return Found(Outcome.PASSED, words, facts)


def _test_current(setup: Setup) -> float:
    p = setup.stage
    breakaway = stage.sliding(p.friction) * (1.0 + p.friction.stribeck.rise) / p.motor.force_constant
    return min(p.drive.current_limit, limits.CURRENT_FACTOR * breakaway or limits.CURRENT_SHARE * p.drive.current_limit)
