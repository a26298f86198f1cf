"""What one axis of the real-time process consists of: its job, drive, law, memory and counts; `axis` lets it act."""

import math
import time
from collections.abc import Callable
from typing import NamedTuple

from stagectl.drives.brake import NO_BRAKE, Brake
from stagectl.drives.canopen.braking_monitor import ConsecutiveCycles
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.power_states import Standstill
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, Drive, Fault, Feedback, Odrive, Simulation
from stagectl.drives.homing import Homing
from stagectl.drives.limits import CERTAIN_FAULT_CYCLES, SILENT_CYCLES
from stagectl.drives.run_on import AxisLimits
from stagectl.kernels import law, stage
from stagectl.kernels.effects import NO_TABLE, Harmonic
from stagectl.kernels.plant import Cable
from stagectl.realtime import bumpless_transfer, safety
from stagectl.realtime.homing import DriveSearch, Search
from stagectl.realtime.setpoint_sources import Hold, Model, Ramp, Rows, Source, caught, held, stopped
from stagectl.realtime.shared_memory import Board
from stagectl.realtime.states import POWERED, STOPS_GOING_ON, State
from stagectl.recording.ring import Ring, RingPlace

LAW = 40  # an order beside the events: other gains
NO_OUTPUT = law.Output(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
GONE = (Fault.FEEDBACK_LOST, Fault.BUS, Fault.REBOOTED)  # the drive is not there as it was
_NOT_GOVERNED = (State.ENABLING, State.ENGAGING, State.DRIVE_HOMING)  # powered, but our law does not act
_STATE_MASK, _STATE_FAULT = DriveState.FAULT.value
_ENABLED_MASK, _ENABLED = DriveState.OPERATION_ENABLED.value
_HOME = "check the position, then `stagectl enable` and `stagectl home`"
_UNKNOWN = Feedback(math.nan, math.nan, 0, Fault.NONE)
_SHOWN = 0.004  # s between two signs of life of a state that goes on: the service looks every 5 ms at most
_PATIENCE = 1.0  # s that a sign of life may take, beyond two time-outs of the drive


class StopLength(NamedTuple):
    """How long a stop took."""

    time: float  # s
    distance: float  # rad | m


class Orders(NamedTuple):
    """The job of one axis: all that the real-time process must know of it."""

    name: str
    law: law.Law
    ramp: Model
    envelope: safety.Envelope
    homing: Homing
    window: float  # rad | m, of in position
    own_ramp: float  # rad/s^2 | m/s^2, of the drive's own stop
    by_clock: bool  # a missed period is a missed row; False where the plant waits for our SYNC
    wire: Canopen | Odrive | None  # None: the stage model in this process
    stage: stage.Stage
    simulation: Simulation
    limits: AxisLimits  # that the drive's own limits must agree with
    ring: RingPlace
    board: int
    brake: Brake = NO_BRAKE
    placed: bool = True  # whether the model knows the place once the axis has a home, or needs none


Connect = Callable[[Orders], Drive]


class AxisData:
    """The memory of one axis."""

    def __init__(self, p: Orders, board: Board, ring: Ring, connect: Connect, clock: Clock = WALL) -> None:
        self.p, self.board, self.ring, self.connect, self.now = p, board, ring, connect, clock.now
        self.dt = p.ramp.dt
        self.state, self.fault, self.faults = State.OFFLINE, Fault.NONE, 0
        self.reason = ""  # of the last fault: what the drive says of it, or the probable causes
        self.governed = False  # our law acts
        self.limits = p.envelope  # those that hold now
        self.drive: Drive | None = None
        self.law, self.x, self.watch = p.law, law.AT_REST, safety.FRESH
        self.source: Source = Hold(held(0.0, 0.0))
        self.asked = held(0.0, 0.0)
        self.speed = 0.0  # rad/s | m/s, of the reference
        self.seen, self.output, self.current = _UNKNOWN, NO_OUTPUT, 0.0
        self.holding = 0.0  # A, carries the axis as its brake is released
        self.verdict = Fault.NONE  # on this period
        self.offset, self.homed = 0.0, p.homing.method == "none"
        self.search: Search | None = None
        self.delegated = DriveSearch(p.homing, math.nan)
        self.cycles, self.late, self.late_in_a_row, self.motions = 0, 0, 0, 0
        self.settled, self.stopped = 0.0, StopLength(0.0, 0.0)
        self.ordered = False  # the stop that goes on is an order, no fault
        self.resetting = False  # the connection that is made is to reset the drive's fault
        self.left_at = math.nan  # rad | m, position as the drive counted it when the last connection ended
        self.lost_origin = ""  # why the axis has lost its home, in words
        self.judged = ""  # what the judge saw of a fault, in numbers
        self.faulty = ConsecutiveCycles(CERTAIN_FAULT_CYCLES)  # the drive shows state Fault
        self.silent = ConsecutiveCycles(SILENT_CYCLES)  # the drive does not answer
        self.since, self.entered, self.start, self.lost = 0, 0.0, 0.0, math.nan
        self.still = Standstill(0.0)
        self.shown = max(1, round(_SHOWN / self.dt))  # periods between two signs of life
        self._patience = _PATIENCE + (2.0 * p.wire.feedback_timeout if p.wire else 0.0)

    @property
    def powered(self) -> bool:
        """Whether the axis is held, moves, or is being stopped."""
        return self.state in POWERED or self.state in STOPS_GOING_ON or self.state in _NOT_GOVERNED

    def carrying(self) -> float:
        """Current (A) with which the brake is released here; without a home nothing is known of what the place does.

        A place outside the travel asks for no more than the end of it: the reading may be wrong.
        """
        p, limits = self.p.stage, self.p.envelope
        if not (self.homed and self.p.placed):
            body = p.mechanics._replace(cable=Cable(), gravity=Harmonic())
            p = p._replace(motor=stage.Motor(p.motor.force_constant), mechanics=body, residual=NO_TABLE)
        return self.p.brake.holding(p, min(max(self.seen.position, limits.low), limits.high))

    def adrift(self) -> bool:
        """Whether the axis leaves the place where it got power: as its brake is released no law holds it yet."""
        limits = self.limits
        first = math.isnan(self.start) and not math.isnan(self.seen.position)
        if first:  # answer of the drive on its way to power
            self.start, self.holding = self.seen.position, self.carrying()
        most = 2.0 * (limits.following_error + limits.error_ramp * limits.speed)
        return self.p.brake.present and abs(self.seen.position - self.start) > most

    def show(self, patience: float = 0.0) -> None:
        """The status, for whoever gives the orders; the next one may take `patience` (s)."""
        seen, asked, output, source, watch = self.seen, self.asked, self.output, self.source, self.watch
        row, rows = (source.row + 1, source.count) if isinstance(source, Rows) else (0, 0)
        self.board.show((
            self.state, self.fault, self.faults, self.cycles, self.late,
            time.monotonic(), max(patience, self._patience),
            seen.position, watch.speed, asked.reference, asked.target, output.error, output.current, seen.statusword,
            self.homed, row, rows, self.motions, self.settled, watch.heat, *self.stopped, self.governed,
        ))  # fmt: skip

    def count_from(self, by: float) -> None:
        """Positions are smaller by `by` (rad | m) from now on; the law does not notice."""
        self.offset += by
        self.homed, self.lost_origin = True, ""
        self.seen = self.seen._replace(position=self.seen.position - by)
        self.x = bumpless_transfer.shifted(self.x, by)
        self.watch = safety.FRESH._replace(heat=self.watch.heat)
        self.asked = stopped(self.asked, by)

    def choose_limits(self, fresh: bool = True) -> None:
        """The limits that hold from now on: travel and braking once the axis is homed.

        A home may lie beside the travel: an axis that stands there, `fresh` from homing or power, may come back.
        """
        p, position = self.p.envelope, self.seen.position
        inside = p.low <= position <= p.high
        if self.search is not None:
            self.limits = safety.searching(p)
        elif not self.homed:
            self.limits = safety.unhomed(p)
        elif inside or self.p.homing.method == "none":
            self.limits = p
        elif fresh:
            self.limits = safety.containing(p, position)

    def brake(self) -> None:
        """Come to rest from the reference; where no feedback acted it says nothing, and the axis itself is taken."""
        if self.asked.closed == 0.0:
            self.speed = self.watch.speed
            self.asked = caught(self.p.ramp, self.seen.position, self.speed)
            self.watch = self.watch._replace(reference=self.asked.reference)
            self.x = law.AT_REST._replace(observer=law.AT_REST.observer._replace(velocity=self.speed))
        self.source = Ramp(self.p.ramp, self.asked, self.speed, 0.0)

    def lose_origin(self, words: str) -> None:
        """Positions no longer mean what they did: the axis needs its home again."""
        self.homed, self.lost_origin = False, words

    def drive_holds(self) -> bool:
        """Whether the drive holds the axis under power although its brake's time is over: we work it, and it waits."""
        return self.p.brake.control == "output" and self.seen.statusword & _ENABLED_MASK == _ENABLED

    def found_faulty(self) -> bool:
        """Whether the drive has been in state Fault for some periods."""
        return self.faulty.certain(self.seen.statusword & _STATE_MASK == _STATE_FAULT)

    def compare_origin(self) -> None:
        """The first position of a new connection against the last one of the connection before."""
        before, now = self.left_at, self.seen.position + self.offset
        if self.seen.fault in GONE or math.isnan(before):
            return
        self.left_at = math.nan
        if abs(now - before) > self.limits.jump:
            was, place = map(self.p.limits.place, (before, now))
            self.lose_origin(f"the drive's position was {was} when it was left, and is {place} now")
            self.fault, self.reason = Fault.JUMP, self.lost_origin
            self.faults += 1
            self.board.say(f"the origin has moved: {self.lost_origin}. Next: {_HOME}")

    def hang_up(self) -> None:
        """Leave the drive, which stops by its own time-outs if it moves at all."""
        self.leave()
        if not math.isnan(self.seen.position):
            self.left_at = self.seen.position + self.offset
        self.drive, self.seen = None, _UNKNOWN
        self.homed = self.homed and self.p.homing.method == "none"

    def leave(self) -> None:
        """Close the drive; the process ends."""
        if self.drive is not None:
            self.drive.close()
