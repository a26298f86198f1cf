"""One case of the self-test: a fault in one state of the axis, and how long and how far it may go on.

Every state of `realtime.states` can be tried.  The controller's end is the service's: orders by the board, and whatever
is under power when nothing more is to be seen is disabled by an order, which must be obeyed.
"""

import math
from collections.abc import Callable

from stagectl.drives import faults
from stagectl.drives.drive import DriveError, Fault
from stagectl.drives.faults import FaultType
from stagectl.realtime.shared_memory import PENDING, TAKEN, Order
from stagectl.realtime.states import STOPS_GOING_ON, Event, State
from stagectl.selftest.limits import Limit, coast, larger, limit, ramp, turned
from stagectl.selftest.rig import BaseRig, RigLoop, Service
from stagectl.service import job_from_stage

BEFORE = 0.15  # s of standing or moving before the fault
AFTER = 0.3  # s that a motion which must go on is watched, and an axis after its stop
PATIENCE = 30.0  # s in which connecting must succeed or be given up
TRIP = 0x2310  # emergency code of the fault that brings the axis to State.FAULT
_STARTED = 0.4  # s in which a drive has taken the homing mode, and moves
_MIDST = 0.005  # s after which a connection is in the middle of its requests
_MARGIN, _CONTROLLED = 1.5, 0.15  # on braking under control, and s of it beyond its ramp
_FEW = 3  # periods in which a stop has begun

MOVES = (State.MOVING, State.HOMING, State.DRIVE_HOMING)
GOVERNED = (State.STANDING, *MOVES)  # where a fault must be noticed, or be without effect
_UNPOWERED = (State.OFFLINE, State.DISABLED, State.FAULT)
_NOT_MOVED = (*_UNPOWERED, State.CONNECTING)
_HELD = (State.STANDING, State.ENABLING, State.ENGAGING)
_ENDS = {  # where a fault may leave the axis, once it has been disabled if it still had power
    State.DISABLED: (State.DISABLED, State.FAULT),
    **dict.fromkeys((*GOVERNED, State.COASTING, State.FAULT), (State.FAULT,)),
}


class Case:
    """One fault in one state."""

    def __init__(self, rig: BaseRig, service: Service, row: FaultType, state: State) -> None:
        self.setup, self.rig, self.row, self.state = rig.setup, rig, row, state
        self._service, self._speed = service, service.speed
        self.block = faults.default(row.name)
        self.reason, self.begun, self.fault = "", math.nan, Fault.NONE
        self.where = 0.0  # rad | m, of the axis when the fault began
        self.dead = False
        self.until = math.inf  # s, when what is judged of the motion ends
        self.wrong = ""  # what else is not as it must be, in words
        self._faults = 0  # of the axis before it
        self._powered = False  # it got power under the fault
        orders = {State.HOMING: service.searching, State.DRIVE_HOMING: service.delegating}.get(state, service.orders)
        self._loop = RigLoop(rig, orders)
        (self._axis,) = self._loop.axes

    def run(self) -> None:
        """Bring the axis there by orders, let the fault begin, and see what becomes of it."""
        self._axis.show()
        self._to(self.state)
        if math.isnan(self.begun):
            self._faults = self._axis.faults
            self.begin()
        self._hear_out()
        if not self.dead:
            self.rig.let_go(self._loop)
        self.rig.settle()

    def begin(self) -> None:
        """The fault, now."""
        seen = self.rig.seen
        self.begun, self.where = seen.time, seen.position
        name = self.row.name
        if name == "interface-down":
            self.rig.cut_off()
        elif name == "controller-dead":
            self.dead = True
            self.rig.left_alone()
        elif name == "loop-stalled":
            self._loop.metronome.extra = self.block.delay
        else:
            self.rig.begin(self.block)

    # what is admitted

    @property
    def admitted(self) -> Limit | None:
        """The most that is admitted; None where the motion goes on.  A stop that had begun may go its way."""
        state, speed, stops = self.state, self._speed, self.row.required.category is not None
        if state in _NOT_MOVED and not self._powered:
            return Limit(PATIENCE, self._creep())
        if state in _HELD or self._powered:
            return Limit(PATIENCE, self._limit(0.0).distance + self._creep())
        if state in MOVES:
            return self._limit(speed) if stops else None
        if state is State.STOPPING:
            return self._braking(speed)
        own = coast(self.setup.stage, speed) if state is State.COASTING else ramp(self.setup, speed)
        return larger(own, self._limit(speed)) if stops else own

    @property
    def may_go_on(self) -> bool:
        """Whether the axis may go on in this state as if nothing were."""
        must = self.row.required
        if self.state is State.STANDING:
            return must.holding in ("go on", "either")
        return self.state in MOVES and must.category is None

    def _limit(self, speed: float) -> Limit:
        """For an axis at this speed (rad/s | m/s)."""
        return limit(self.setup, self.row, self.block, speed)

    def _braking(self, speed: float) -> Limit:
        """Under control, or as the fault leaves it: from its speed on, or turned round; whichever allows most."""
        calm, error = job_from_stage.calm(self.setup), self.setup.file.limits.following_error
        own = Limit(_MARGIN * speed / calm + _CONTROLLED, _MARGIN * speed * speed / (2.0 * calm) + error)
        if self.row.required.category is None:
            return own
        names = tuple(name for name in self.row.required.noticed if name != "motion")  # the motion has come to that
        row = self.row._replace(required=self.row.required._replace(noticed=names))
        back = turned(self.setup, row, self.block, calm)
        return larger(own, larger(limit(self.setup, row, self.block, speed), back))

    def _creep(self) -> float:
        """What an axis that nobody moves may seem to move (rad | m): the relaxing of its friction."""
        return 4.0 * self.setup.stage.encoder.step + 1e-3 * self.setup.file.limits.following_error

    def _patience(self) -> float:
        if self.row.required.category is None:
            return AFTER
        return min(self._limit(self._speed).time + AFTER, PATIENCE)

    # to the state

    def _to(self, state: State) -> None:
        if state is State.OFFLINE:
            self._connect_under_the_fault()
            return
        if state is State.CONNECTING:
            self.rig.later(_MIDST, self.begin)
        self._axis.happen(Event.CONNECT)
        if state in (State.CONNECTING, State.DISABLED):
            self._run(0.0 if state is State.CONNECTING else BEFORE)
            return
        self._take(Order(Event.ENABLE))
        if state is not State.ENABLING:
            self._until(State.STANDING)
            self._run(BEFORE)
            self._from_standing(state)
        self._must_be(state)

    def _connect_under_the_fault(self) -> None:
        """Where that succeeds, power is tried, too."""
        self.begin()
        if not self.dead and self._order(Order(Event.RESET)) and self._order(Order(Event.ENABLE)):
            self._powered = True
            while self._axis.state is State.ENABLING:
                self._loop.period()
            self._order(Order(Event.DISABLE))

    def _from_standing(self, state: State) -> None:
        if state is State.FAULT:
            self.rig.trip(TRIP)
            self._until(State.FAULT)
        elif state is State.ENGAGING:
            self._take(Order(Event.DISABLE))
        elif state is not State.STANDING:
            homes = state in (State.HOMING, State.DRIVE_HOMING)
            self._take(Order(Event.HOME) if homes else self._service.controller.start(self._service.motion, 1))
            self._run(BEFORE if state is not State.DRIVE_HOMING else _STARTED)
        if state is State.STOPPING:
            self._take(Order(Event.STOP))
        elif state is State.QUICK_STOPPING:
            self._take(Order(Event.QUICK_STOP))
        elif state is State.COASTING:
            self._axis.happen(Event.COAST, Fault.JUMP)
        if state in (State.STOPPING, *STOPS_GOING_ON):
            self._run(_FEW * self.setup.dt)

    # after the fault

    def _hear_out(self) -> None:
        """Until it has come to its end, or has had its time; then without power."""
        if self.dead:
            self.rig.time.sleep(self._patience() + AFTER)
            return
        end = self.rig.time.now() + max(self._patience(), AFTER)
        while self._axis.state is State.ENABLING or (self.rig.time.now() < end and self._axis.state not in _UNPOWERED):
            self._loop.period()
        self._run(AFTER)
        if self._axis.faults != self._faults:
            self.fault = self._axis.fault
            self.reason = self.fault.name
        if self.may_go_on and not self.fault:
            return
        if self._axis.powered:
            self.until = self.rig.time.now()  # what friction gives back without power is no part of the stop
            self._order(Order(Event.DISABLE))
            self._run(PATIENCE, lambda: self._axis.powered)
            self._run(AFTER)
        end, allowed = self._axis.state, _ENDS.get(self.state, _UNPOWERED)
        if end not in allowed:
            self.wrong = f"ended in state {named(end)}; must be: {' or '.join(map(named, allowed))}"

    # periods and orders

    def _run(self, seconds: float, going_on: Callable[[], bool] = lambda: True) -> None:
        """Period after period for so long, or while this holds."""
        end = self.rig.time.now() + seconds
        while going_on() and self.rig.time.now() < end:
            self._loop.period()

    def _until(self, state: State) -> None:
        self._run(PATIENCE, lambda: self._axis.state is not state)
        self._must_be(state)

    def _must_be(self, state: State) -> None:
        if self._axis.state is not state:
            raise DriveError(f"the axis is in state {named(self._axis.state)}, must be {named(state)} before the fault")

    def _order(self, order: Order) -> bool:
        """Give an order; whether it was taken."""
        board = self._service.controller.board
        number = board.order(order)
        while board.verdict(number) == PENDING:
            self._loop.period()
        return board.verdict(number) == TAKEN

    def _take(self, order: Order) -> None:
        if not self._order(order):
            raise DriveError(f"{Event(order.kind).name.lower()} was refused in state {named(self._axis.state)}")


def named(state: State) -> str:
    """The state as the self-test calls it."""
    return state.name.lower().replace("_", " ")
