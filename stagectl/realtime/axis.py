"""One axis of the real-time process: its state, and what it does in one period.

::

    sense()   SYNC latches the position          act()   setpoint -> law -> judge -> apply -> row, status
    happen()  one event: the table in `states` says what follows, `_enter` does it

Nothing in here raises: what goes wrong is an event.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

from stagectl.config.homing import Homing
from stagectl.drives.canopen.power_states import Standstill
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, Drive, Fault, Feedback, Odrive, Simulation
from stagectl.kernels import law, stage
from stagectl.realtime import bumpless_transfer, safety
from stagectl.realtime.homing import Search
from stagectl.realtime.setpoint_sources import Hold, Model, Ramp, Rows, Source, held
from stagectl.realtime.shared_memory import Board, Order
from stagectl.realtime.state_entry_actions import enter
from stagectl.realtime.states import POWERED, STOPS_GOING_ON, Event, State, event_of, following
from stagectl.realtime.stops import STOPS
from stagectl.recording.ring import Ring

LAW = 40  # an order beside the events: other gains
_NAN = math.nan
_NOTHING = law.Output(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_UNKNOWN = Feedback(_NAN, _NAN, 0, Fault.NONE)
_GONE = (Fault.FEEDBACK_LOST, Fault.BUS, Fault.REBOOTED)
_OLD_TIME = 1.0  # s without power in which an emergency is of the time before, and is taken back
_ENABLE_TIME, _STOP_TIME, _LOST_TIME = 5.0, 10.0, 1.0  # s


class Orders(NamedTuple):
    """All that the real-time process must know of one axis."""

    name: str
    law: law.Law
    ramp: Model
    envelope: safety.Envelope
    homing: Homing
    window: float  # rad | m, of in position
    standing: tuple[float, float]  # rad/s^2 | m/s^2 and rad | m: ramp and encoder step, see Standstill
    by_clock: bool
    wire: Canopen | Odrive | None
    stage: stage.Stage
    simulation: Simulation
    ring: int  # descriptors
    board: int


Connect = Callable[[Orders], Drive]


class Axis:
    """The state of one axis."""

    def __init__(self, p: Orders, board: Board, ring: Ring, connect: Connect, clock: Clock = WALL) -> None:
        self.p, self.board, self.ring, self.connect, self.now = p, board, ring, connect, clock.now
        self.dt = p.ramp.dt
        self.state, self.fault, self.faults = State.OFFLINE, Fault.NONE, 0
        self.drive: Drive | None = None
        self.law, self.x, self.watch = p.law, law.AT_REST, safety.FRESH
        self.source: Source = Hold(0.0)
        self.asked = held(0.0, 0.0)
        self.speed = 0.0  # rad/s | m/s, of the reference
        self.seen, self.output, self.current = _UNKNOWN, _NOTHING, 0.0
        self.offset, self.homed = 0.0, p.homing.method == "none"
        self.search: Search | None = None
        self.cycles, self.late, self.late_in_a_row, self.motions = 0, 0, 0, 0
        self.settled, self.stopped = 0.0, (0.0, 0.0)
        self.ordered = False  # the stop that goes on is an order, no fault
        self.since, self.entered, self.start, self.lost = 0, 0.0, 0.0, _NAN
        self.still = Standstill(0.0)

    @property
    def powered(self) -> bool:
        """Whether the axis is held, moves, or is being stopped."""
        return self.state in POWERED or self.state in STOPS_GOING_ON or self.state is State.ENABLING

    # one period

    def sense(self) -> None:
        """Latch the position."""
        assert self.drive is not None
        position, current, statusword, fault, age = self.drive.sample()
        self.seen = Feedback(position - self.offset, current, statusword, fault, age)

    def act(self, lateness: float, late: bool, passed: int) -> None:
        """Law, judgement, command; then the row and the status of this period."""
        fault = self._controlled(passed) if self.state in POWERED else self._watched(passed)
        self.cycles += 1
        self.late += late
        self.late_in_a_row = self.late_in_a_row + 1 if late else 0
        if self.late_in_a_row >= self.p.envelope.late_limit and self.state in POWERED:
            fault = fault or Fault.LATE
        seen = self.seen
        measured = (seen.position, _NAN, seen.current, lateness, late, seen.statusword, fault, self.state)
        self.ring.write((self.cycles * self.dt, *self.asked, *self.output, *measured))
        if fault is not Fault.NONE:
            self.happen(event_of(fault), fault)
        else:
            self._progress()
        self.show()

    def show(self, patience: float = 0.0) -> None:
        """The status, for the service; the next one may take `patience` (s)."""
        seen, source, wire = self.seen, self.source, self.p.wire
        patience = max(patience, 1.0 + (2.0 * wire.feedback_timeout if wire else 0.0))
        row, rows = (source.row + 1, source.count) if isinstance(source, Rows) else (0, 0)
        counts = (self.state, self.fault, self.faults, self.cycles, self.late, time.monotonic(), patience)
        place = (seen.position, self.watch.speed, self.asked.reference, self.output.error, self.output.current)
        motion = (seen.statusword, self.homed, row, rows, self.motions, self.settled, self.watch.heat)
        self.board.show((*counts, *place, *motion, *self.stopped, self.state in POWERED))

    def _controlled(self, passed: int) -> Fault:
        """The law's command, as long as nothing speaks against it."""
        assert self.drive is not None
        asked = self.source.next(passed)
        starved = asked is None
        if asked is None:
            asked = held(self.asked.reference, self.asked.friction)
        position = self.seen.position
        self.output, self.x = law.step(self.law, self.x, asked, position)
        now = safety.Seen(self.seen, asked.reference, self.output.error, self.current, passed * self.dt)
        limits = self.p.envelope if self.search is None else safety.searching(self.p.envelope)
        fault, self.watch = safety.judge(limits, self.watch, now)
        gone = fault is not Fault.NONE
        self.current = 0.0 if gone else self.output.current
        self.drive.apply(self.current)
        if not starved:  # a motion goes on from its last speed, not from the standstill of one that ran dry
            self.speed = (asked.reference - self.asked.reference) / (passed * self.dt)
        self.asked = asked
        near = abs(self.output.error) <= self.p.window and self.state is State.STANDING
        self.settled = self.settled + passed * self.dt if near else 0.0
        return Fault.STARVED if starved and not gone else fault

    def _watched(self, passed: int) -> Fault:
        """Without our law: zero goes out; only what ends the connection is a fault of its own here."""
        assert self.drive is not None
        self.drive.apply(0.0)
        jump = safety.leap(self.p.envelope, self.seen.position - self.asked.reference, passed * self.dt)
        self.current, self.output = 0.0, _NOTHING
        self.asked, self.speed = held(self.seen.position, 0.0), 0.0
        fault = self.seen.fault
        if self.state is State.DISABLED:
            old = fault is Fault.EMERGENCY and (self.cycles - self.since) * self.dt < _OLD_TIME
            return Fault.NONE if old or fault is Fault.DRIVE_FAULT else fault
        return (fault if fault is Fault.BUS else jump) if self.state is State.ENABLING else Fault.NONE

    # what is going on

    def _progress(self) -> None:
        """Whether what goes on has come to its end."""
        state = self.state
        if state in (State.MOVING, State.STOPPING) and self.source.over:
            self.happen(Event.DONE)
        elif state is State.HOMING:
            self._seek()
        elif state is State.ENABLING:
            self._enabling()
        elif state in STOPS_GOING_ON:
            self._stopping()
        elif state is State.FAULT and self.seen.fault in _GONE:
            self.hang_up()

    def _enabling(self) -> None:
        if self.seen.fault is Fault.NONE:
            self.happen(Event.DONE)
        elif self._elapsed() > _ENABLE_TIME:
            self.happen(Event.FAILED, Fault.DRIVE_FAULT)

    def _stopping(self) -> None:
        """Until it stands; a drive that does not answer stops by its own time-outs, and is given up."""
        stands = self.still.stands(self.seen.position)
        if self.seen.fault in _GONE:
            self.lost = self.now() if math.isnan(self.lost) else self.lost
            stands = self.now() - self.lost > _LOST_TIME
        if stands:
            moved = max(self.cycles - self.since - Standstill.CYCLES, 0)
            self.stopped = (moved * self.dt, abs(self.seen.position - self.start))
            self.happen(Event.DONE if self.ordered else Event.FAILED)
        elif self._elapsed() > _STOP_TIME:
            self.happen(Event.FAILED if self.state is State.COASTING else Event.COAST)

    def _elapsed(self) -> float:
        """Time (s) in this state; a drive that does not answer makes a period as long as its time-out."""
        return max((self.cycles - self.since) * self.dt, self.now() - self.entered)

    def _seek(self) -> None:
        """A search that goes on: found, too far, or at rest behind it."""
        search, ramp, seen = self.search, self.source, self.seen
        if search is None or not isinstance(ramp, Ramp):
            return
        current = self.output.current if math.isnan(seen.current) else seen.current
        if search.look(seen.position, current, seen.statusword):
            if self.p.homing.method == "current":  # it leans on a stop: no way on to brake in
                self.source = ramp = Ramp(self.p.ramp, held(seen.position, 0.0), 0.0, 0.0)
            ramp.brake()
        elif search.too_far(seen.position):
            self.happen(Event.FAILED, Fault.HOMING)
        elif ramp.over and search.found is not None:
            self.count_from(search.found - self.p.homing.position)
            self.happen(Event.DONE)

    def count_from(self, by: float) -> None:
        """Positions are smaller by `by` from now on; the law does not notice."""
        self.offset += by
        self.homed = True
        self.x = bumpless_transfer.shifted(self.x, by)
        self.watch = safety.FRESH._replace(heat=self.watch.heat)
        self.asked = held(self.asked.reference - by, self.asked.friction)

    # events

    def happen(self, event: Event, fault: Fault = Fault.NONE) -> bool:
        """Take an event; False where it is an order that cannot be given now."""
        new = following(self.state, event)
        if new is None:
            return False
        if fault is not Fault.NONE and new is not self.state:  # what comes after the first is its consequence
            self._note(fault)
        old, self.state = self.state, new
        if new is not old or new is State.CONNECTING:
            self.ordered = fault is Fault.NONE and event in (Event.DISABLE, Event.STOP, Event.QUICK_STOP)
            self.entered = self.now()
            enter(self, old)
        return True

    def _note(self, fault: Fault) -> None:
        self.fault = fault
        self.faults += 1
        row = STOPS[fault]
        own = self.drive.explain() if self.drive is not None and fault < Fault.FOLLOWING_ERROR else row.causes
        self.board.say(f"{row.words}; {row.category.words}. {own}. Next: {row.next}".replace(". . ", ". "))

    def take(self, order: Order) -> bool:
        """An order of the service; False where it cannot be given now."""
        if order.kind == LAW:
            self._take_law(order)
            return True
        event = Event(order.kind)
        if event is Event.MOVE:
            return self._begin(order)
        if event is Event.HOME and self.state is State.STANDING:
            self.fault = Fault.NONE
        return self.happen(event)

    def _take_law(self, order: Order) -> None:
        new: law.Law = bumpless_transfer.rebuilt(self.law, iter(order.numbers))
        if self.state in POWERED:
            self.x = bumpless_transfer.transferred(self.law, new, self.x, self.asked, self.seen.position)
        self.law = new

    def may_begin(self, order: Order) -> bool:
        """Whether this motion can begin now; if not, the board says why where the state does not."""
        low, high = (self.asked.reference + end for end in order.numbers[2:4])
        limits = self.p.envelope
        if self.state is not State.STANDING:
            return False
        if not self.homed:
            self.board.say("the axis has no home yet: `stagectl home`")
            return False
        if low < limits.low or high > limits.high:
            self.board.say(
                f"from {self.asked.reference:.6g} the motion would go to [{low:.6g}, {high:.6g}]; "
                f"limits.travel is [{limits.low:.6g}, {limits.high:.6g}] in axis units"
            )
            return False
        return True

    def _begin(self, order: Order) -> bool:
        if not self.may_begin(order):
            return False
        first, count = order.numbers[:2]
        self.source = Rows(self.board, int(first), int(count), self.asked.reference)
        self.fault = Fault.NONE
        self.motions += 1
        return self.happen(Event.MOVE)

    def hang_up(self) -> None:
        """Leave the drive, which stops by its own time-outs if it moves at all."""
        if self.drive is not None:
            self.drive.close()
        self.drive, self.seen = None, _UNKNOWN
        self.homed = self.p.homing.method == "none"

    def leave(self) -> None:
        """The process ends."""
        if self.drive is not None:
            self.drive.close()
