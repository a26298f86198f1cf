"""One axis of the real-time process: what it does in one period, whoever ordered its motion.

::

    sense()   SYNC latches the position     act()   setpoint -> law -> judge -> apply
                                            record()   row, then what follows from the period, then status
    happen()  one event: the table in `states` says what follows, `entries` does it

Nothing in here raises: what goes wrong is an event.
"""

import math

from stagectl.drives.drive import Fault
from stagectl.drives.limits import BRAKE_PATIENCE, ENABLE_TIME, STANDSTILL_CYCLES
from stagectl.kernels import law
from stagectl.realtime import bumpless_transfer, safety
from stagectl.realtime.axis_data import GONE, LAW, NO_OUTPUT, AxisData, StopLength
from stagectl.realtime.setpoint_sources import Ramp, Rows, held
from stagectl.realtime.shared_memory import Move, Order
from stagectl.realtime.state_entry_actions import enter
from stagectl.realtime.states import STOPS_GOING_ON, Event, State, event_of, following
from stagectl.realtime.stops import STOPS, without_power

_NAN = math.nan
# A member of an enumeration takes Python 90 ns to look up by its name: here it is done once.
_NONE = Fault.NONE
_DISABLED, _ENABLING, _STANDING, _MOVING = State.DISABLED, State.ENABLING, State.STANDING, State.MOVING
_HOMING, _STOPPING, _FAULT, _ENGAGING = State.HOMING, State.STOPPING, State.FAULT, State.ENGAGING
_DRIVE_HOMING, _UNLOADED = State.DRIVE_HOMING, (State.ENABLING, State.DRIVE_HOMING)
_OLD_TIME = 1.0  # s without power in which an emergency is of the time before, and is taken back
_STOP_TIME, _LOST_TIME = 10.0, 1.0  # s


class Axis(AxisData):
    """One axis that acts, period by period."""

    def sense(self) -> None:
        """Latch the position."""
        assert self.drive is not None
        seen = self.drive.sample()
        if self.offset != 0.0:
            seen = seen._replace(position=seen.position - self.offset)
        self.seen = seen

    def act(self, passed: int) -> None:
        """Law, judgement, command: for the setpoint that is due `passed` periods after the last one."""
        self.verdict = self._controlled(passed) if self.governed else self._watched(passed)

    def record(self, lateness: float, late: bool) -> None:
        """The row of this period; then what follows from it, and the status."""
        fault = self.verdict
        self.cycles += 1
        if late:
            fault = fault or self._delayed()
        else:
            self.late_in_a_row = 0
        self.write(lateness, late, fault)
        state = self.state
        if fault is not _NONE:
            self.happen(event_of(fault), fault)
        else:
            self._progress()
        self.source.prepare()
        if self.state is not state or self.cycles % self.shown == 0:
            self.show()

    def write(self, lateness: float, late: bool, fault: Fault) -> None:
        """A row of each period, whatever the axis does in it."""
        seen = self.seen
        self.ring.write((
            self.cycles * self.dt, *self.asked, *self.output,
            seen.position, _NAN, seen.current, lateness, late, seen.statusword, fault, self.state,
        ))  # fmt: skip

    def rest(self) -> None:
        """The command where our law does not act; as power comes, what carries the axis once its brake is released."""
        assert self.drive is not None
        self.drive.apply(self.holding if self.state in _UNLOADED else 0.0)

    def _delayed(self) -> Fault:
        """Count a late period; too many in a row are a fault where our law acts."""
        self.late += 1
        self.late_in_a_row += 1
        return Fault.LATE if self.governed and self.late_in_a_row >= self.limits.late_limit else _NONE

    def _controlled(self, passed: int) -> Fault:
        """The law's command, as long as nothing speaks against it."""
        assert self.drive is not None
        before, seen, time = self.asked, self.seen, passed * self.dt
        due = self.source.next(passed)
        asked = held(before.reference, before.friction)._replace(closed=before.closed) if due is None else due
        self.output, self.x = output, _ = law.step(self.law, self.x, asked, seen.position)
        now = safety.Observation(seen, asked.reference, output.error, self.current, time)
        fault, self.watch = safety.judge(self.limits, self.watch, now)
        self.current = current = output.current if fault is _NONE else 0.0
        self.drive.apply(current)
        if fault is not _NONE:
            self.judged = safety.detail(fault, self.watch, now)
        self.asked = asked
        near = self.state is _STANDING and abs(output.error) <= self.p.window
        self.settled = self.settled + time if near else 0.0
        if due is None:  # a motion goes on from its last speed, not from the standstill of one that ran dry
            return fault or Fault.STARVED
        self.speed = (asked.reference - before.reference) / time
        return fault

    def _watched(self, passed: int) -> Fault:
        """Without our law: zero goes out; what ends the connection is a fault here, and a jump of the origin."""
        if self.state is _ENGAGING:
            return self._held()
        self.rest()
        jump = safety.leap(self.limits, self.seen.position - self.asked.reference, passed * self.dt)
        self.watch = safety.cooled(self.limits, self.watch, self.seen.current, passed * self.dt)
        self.current, self.output = 0.0, NO_OUTPUT
        self.asked, self.speed = held(self.seen.position, 0.0), 0.0
        if self.state is _DRIVE_HOMING:
            return self.delegated.judge(self.limits, self.seen, self.watch.heat, passed * self.dt, self._elapsed())
        fault = self.seen.fault
        if jump is not _NONE:
            self.lose_origin("the position jumped while the axis had no power")
        if self.state is _DISABLED:
            self.compare_origin()
            return jump or self._unpowered(fault)
        return (fault if fault is Fault.BUS else jump) if self.state is _ENABLING else _NONE

    def _held(self) -> Fault:
        """Our law holds the axis while its brake engages; the drive may leave Operation enabled meanwhile."""
        assert self.drive is not None
        self.output, self.x = output, _ = law.step(self.law, self.x, self.asked, self.seen.position)
        fault = _NONE if abs(output.error) <= self.limits.following_error else Fault.FOLLOWING_ERROR
        self.drive.apply(output.current if fault is _NONE else 0.0)
        return fault

    def _unpowered(self, fault: Fault) -> Fault:
        """What is a fault where no power was asked for: not the drive's want of it, but state Fault."""
        if not self.silent.certain(fault is Fault.FEEDBACK_LOST) and fault is Fault.FEEDBACK_LOST:
            return _NONE  # one lost frame, where nothing can move: the next SYNC shows
        if fault is Fault.DRIVE_FAULT:
            return fault if self.found_faulty() else _NONE
        old = fault is Fault.EMERGENCY and (self.cycles - self.since) * self.dt < _OLD_TIME
        return _NONE if old else fault

    def _progress(self) -> None:
        """Whether what goes on has come to its end."""
        state = self.state
        if self.source.over and self.asked.closed == 0.0:  # it may be elsewhere, and in motion
            self.brake()
        elif self.source.over and (state is _MOVING or state is _STOPPING):
            self.happen(Event.DONE)
        elif state is _HOMING or state is _DRIVE_HOMING:
            self._seek()
        elif state is _ENABLING:
            self._enabling()
        elif state in STOPS_GOING_ON:
            self._stopping()
        elif state is _ENGAGING:
            self._engaging()
        elif state is _FAULT and self.seen.fault in GONE:
            self.hang_up()

    def _enabling(self) -> None:
        if self.adrift():
            self.happen(Event.FAILED, Fault.FOLLOWING_ERROR)
        elif self.seen.fault is Fault.NONE:
            self.happen(Event.DONE)
        elif self.found_faulty() or self._elapsed() > ENABLE_TIME + self.p.brake.release:
            self.happen(Event.FAILED, Fault.DRIVE_FAULT)

    def _engaging(self) -> None:
        """Until the brake's time is over, and a drive that confirms it has let go; what is not confirmed is told."""
        over = self._elapsed() - self.p.brake.engage - 2.0 * self.dt
        if over > BRAKE_PATIENCE and self.drive_holds():
            self.happen(Event.RAMP, Fault.DRIVE_FAULT)
        elif over >= 0.0 and not self.drive_holds():
            self.happen(Event.DONE)

    def _stopping(self) -> None:
        """Until it stands; a drive that does not answer stops by its own time-outs, and is given up."""
        gone, now = self.seen.fault in GONE, self.now()
        self.lost = (now if math.isnan(self.lost) else self.lost) if gone else _NAN
        stands = now - self.lost > _LOST_TIME if gone else self.still.stands(self.seen.position)
        if stands:
            moved = max(self.cycles - self.since - STANDSTILL_CYCLES, 0)
            self.stopped = StopLength(moved * self.dt, abs(self.seen.position - self.start))
            self.happen(Event.DONE if self.ordered else Event.FAILED)
        elif self._elapsed() > _STOP_TIME:
            self.happen(Event.FAILED if self.state is State.COASTING else Event.COAST)

    def _elapsed(self) -> float:
        """Time (s) in this state; a drive that does not answer makes a period as long as its time-out."""
        return max((self.cycles - self.since) * self.dt, self.now() - self.entered)

    def _seek(self) -> None:
        """A search that goes on: found, too far, or at rest behind it."""
        search, ramp, seen = self.search, self.source, self.seen
        if self.state is _DRIVE_HOMING and not seen.busy:
            self.count_from(-self.p.homing.position - self.offset)
            self.happen(Event.DONE)
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
            self.resetting = event is Event.RESET
            self.entered = self.now()
            follows = enter(self, old)
            if follows is not None:
                self.happen(follows, Fault.DRIVE_FAULT if follows is Event.FAULTED else Fault.NONE)
        return True

    def _note(self, fault: Fault) -> None:
        self.fault = fault
        self.faults += 1
        row = STOPS[fault]
        if fault is Fault.JUMP:
            self.lose_origin("the encoder jumped")
        told = fault < Fault.FOLLOWING_ERROR or fault is self.seen.fault
        self.reason = self.drive.explain() if self.drive is not None and told else row.causes
        self.reason = f"{self.judged}{self.reason}"
        under_power = self.powered and self.state is not _ENABLING
        head = f"{row.words}; {row.category.words}" if under_power else without_power(fault, self.state is _ENABLING)
        self.board.say(f"{head}. {self.reason}. Next: {row.next}".replace(". . ", ". "))

    def take(self, order: Order) -> bool:
        """An order of the service; False where it cannot be given now."""
        if order.kind == LAW:
            new: law.Law = bumpless_transfer.rebuilt(self.law, iter(order.numbers))
            if self.governed:
                self.x = bumpless_transfer.transferred(self.law, new, self.x, self.asked, self.seen.position)
            self.law = new
            return True
        event = Event(order.kind)
        if event is Event.MOVE:
            return self._begin(order)
        if event is Event.HOME and self.state is State.STANDING:
            self.fault = Fault.NONE
        return self.happen(event)

    def may_begin(self, order: Order) -> bool:
        """Whether this motion can begin now; if not, the board says why where the state does not."""
        move, here = Move(*order.numbers), self.asked.reference
        low, high = here + move.low, here + move.high
        limits = self.limits
        if self.state is not State.STANDING:
            return False
        if not self.homed:
            lost = f" ({self.lost_origin})" if self.lost_origin else ""
            self.board.say(f"the axis has no home yet{lost}: `stagectl home`")
            return False
        if not (low >= limits.low and high <= limits.high):  # nor places that are no numbers
            first, last, place, lowest, highest = map(self.p.limits.place, (limits.low, limits.high, here, low, high))
            travel = f"limits.travel is [{first}, {last}]"
            self.board.say(self.refusal(place, f"[{lowest}, {highest}]", travel))
            return False
        return True

    def refusal(self, here: str, goes: str, travel: str) -> str:
        """Why a motion from `here` that goes to the places `goes` is not begun."""
        return f"from {here} the motion would go to {goes}; {travel}"

    def _begin(self, order: Order) -> bool:
        if not self.may_begin(order):
            return False
        move = Move(*order.numbers)
        self.source = Rows(self.board, int(move.first), int(move.rows), self.asked.reference)
        self.fault = Fault.NONE
        self.motions += 1
        return self.happen(Event.MOVE)
