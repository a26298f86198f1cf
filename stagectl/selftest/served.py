"""A fault in each state of the service's axis: its own real-time loop (`realtime.axes`), in virtual time.

Every state of `realtime.states` is tried.  The controller's end is the service's: orders by the board, and whatever is
under power when nothing more is to be seen is disabled by an order, which must be obeyed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import DriveError, Fault
from stagectl.drives.faults import FaultType
from stagectl.drives.homing import Homing
from stagectl.realtime.axis_data import Orders
from stagectl.realtime.shared_memory import PENDING, TAKEN, Order
from stagectl.realtime.states import STOPS_GOING_ON, Event, State
from stagectl.selftest.case import AFTER, BEFORE, PATIENCE, TRIP, Case
from stagectl.selftest.limits import Limit, coast, larger, limit, ramp, turned
from stagectl.selftest.rig import Rig, RigLoop, in_virtual_time, usual
from stagectl.service import planning
from stagectl.service.axis_controller import AxisController

_STARTED = 0.4  # s in which a drive has taken the homing mode, and moves
_MIDST = 0.005  # s after which a connection is in the middle of its requests
_MARGIN, _CONTROLLED = 1.5, 0.15  # on braking under control, and s of it beyond its ramp
_FEW = 3  # periods in which a stop has begun

# What each state is judged as: a state of a single motion, or one of the three below.
KINDS = {
    State.OFFLINE: "connecting",
    State.CONNECTING: "connecting",
    State.DISABLED: "faulted",
    State.ENABLING: "powering",
    State.STANDING: "holding",
    State.MOVING: "moving",
    State.HOMING: "moving",
    State.STOPPING: "braking",
    State.QUICK_STOPPING: "stopping",
    State.COASTING: "coasting",
    State.FAULT: "faulted",
    State.ENGAGING: "powering",
    State.DRIVE_HOMING: "moving",
}
STATES = {f"service {state.name.lower().replace('_', ' ')}": state for state in KINDS}
OF_A_BRAKE = "service engaging"  # an axis without one is in it for no period
OF_THE_DRIVE = "service drive homing"  # reached where homing.method is drive
_UNPOWERED = (State.OFFLINE, State.DISABLED, State.FAULT)
_ENDS = {  # where a fault may leave the axis, once it has been disabled if it still had power
    State.DISABLED: (State.DISABLED, State.FAULT),
    State.STANDING: (State.FAULT,),
    State.MOVING: (State.FAULT,),
    State.HOMING: (State.FAULT,),
    State.DRIVE_HOMING: (State.FAULT,),
    State.COASTING: (State.FAULT,),
    State.FAULT: (State.FAULT,),
}


class Service(NamedTuple):
    """What is laid out once for all cases."""

    controller: AxisController
    motion: planning.Motion
    orders: Orders
    searching: Orders  # for a home that does not come
    delegating: Orders  # whose drive finds the home


def laid_out(setup: Setup) -> Service:
    """The service's side of the stage, with the self-test's motion."""
    controller, pace, scale = AxisController("axis", setup), usual(setup), setup.file.axis.travel_per_unit
    motion = planning.laid_out(controller.move(pace.distance * scale, pace.speed * scale, pace.acceleration * scale))
    job = in_virtual_time(controller.orders(), setup)
    search = Homing("limit", pace.speed, math.inf)
    by_drive = search._replace(method="drive", number=34)  # upwards, to a mark that is behind it
    return Service(controller, motion, job, job._replace(homing=search), job._replace(homing=by_drive))


class ServedCase(Case):
    """One fault in one state of the service's axis."""

    def __init__(self, rig: Rig, row: FaultType, service: Service) -> None:
        super().__init__(rig, row)
        self._virtual, self._service, self._faults = rig, service, 0

    def run(self, state: str) -> None:
        """Bring the axis there by orders, let the fault begin, and see what becomes of it."""
        wanted = STATES[state]
        service = self._service
        searches = {State.HOMING: service.searching, State.DRIVE_HOMING: service.delegating}
        orders = searches.get(wanted, service.orders)
        self._loop = RigLoop(self._virtual, orders, self._service.controller.ring, False)
        self._axis = self._loop.axes[0]
        self._axis.show()
        self._to(wanted)
        if math.isnan(self.begun):
            self._faults = self._axis.faults
            self.begin(self._loop.metronome)
        self._hear_out(wanted)
        self.rig.settle()

    def kind(self, state: str) -> str:
        """What the state is judged as."""
        return KINDS[STATES[state]]

    def admitted(self, kind: str) -> Limit | None:
        """The most that is admitted; a stop that had begun before the fault may go its way."""
        speed = self.rig.laid_out.speed
        if kind == "powering":
            return super().admitted("holding")
        if kind == "braking":
            return self._braking(speed)
        if kind not in ("coasting", "stopping"):
            return super().admitted(kind)
        own = coast(self.setup.stage, speed) if kind == "coasting" else ramp(self.setup, speed)
        return own if self.row.required.category is None else larger(own, self.limit(speed))

    def _braking(self, speed: float) -> Limit:
        """Under control, or as the fault leaves it: from its speed on, or turned round; whichever allows most."""
        calm, error = self._service.controller.calm, self.setup.file.limits.following_error
        own = Limit(_MARGIN * speed / calm + _CONTROLLED, _MARGIN * speed * speed / (2.0 * calm) + error)
        if self.row.required.category is None:
            return own
        names = tuple(name for name in self.row.required.noticed if name != "motion")  # the motion has come to that
        row = self.row._replace(required=self.row.required._replace(noticed=names))
        back = turned(self.setup, row, self.block, calm)
        return larger(own, larger(limit(self.setup, row, self.block, speed), back))

    # to the state

    def _to(self, state: State) -> None:
        if state is State.OFFLINE:
            self.begin(self._loop.metronome)
            self._order(Order(Event.RESET))
            return
        if state is State.CONNECTING:
            self._virtual.later(_MIDST, lambda: self.begin(self._loop.metronome))
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

    def _from_standing(self, state: State) -> None:
        if state is State.FAULT:
            self.rig.trip(TRIP)
            self._until(State.FAULT)
        elif state is State.ENGAGING:
            self._take(Order(Event.DISABLE))
        elif state is not State.STANDING:
            homes = state in (State.HOMING, State.DRIVE_HOMING)
            self._take(Order(Event.HOME) if homes else self._move())
            self._run(BEFORE if state is not State.DRIVE_HOMING else _STARTED)
        if state is State.STOPPING:
            self._take(Order(Event.STOP))
        elif state is State.QUICK_STOPPING:
            self._take(Order(Event.QUICK_STOP))
        elif state is State.COASTING:
            self._axis.happen(Event.COAST, Fault.JUMP)
        if state in (State.STOPPING, *STOPS_GOING_ON):
            self._run(_FEW * self.setup.dt)

    def _move(self) -> Order:
        service = self._service
        return service.controller.start(service.motion, 1)

    # after the fault

    def _hear_out(self, state: State) -> None:
        """Until it has come to its end, or has had its time; then without power."""
        if self.dead:
            self.rig.time.sleep(self._patience() + AFTER)
            return
        end = self.rig.time.now() + max(self._patience(), AFTER)
        while self._axis.state is State.ENABLING or (self.rig.time.now() < end and self._axis.state not in _UNPOWERED):
            self._loop.period()
        self._run(AFTER)
        self._note()
        if self.may_go_on(KINDS[state]) and not self.fault:
            return
        if self._axis.powered:
            self.until = self.rig.time.now()  # what friction gives back without power is no part of the stop
            self._order(Order(Event.DISABLE))
            end = self.rig.time.now() + PATIENCE
            while self._axis.powered and self.rig.time.now() < end:
                self._loop.period()
            self._run(AFTER)
        self._check(state)

    def _note(self) -> None:
        if self._axis.faults != self._faults:
            self.fault = self._axis.fault
            self.reason = self.fault.name

    def _check(self, state: State) -> None:
        """Whether it ended in a state that the table of states leads to."""
        end, allowed = self._axis.state, _ENDS.get(state, _UNPOWERED)
        if end not in allowed:
            self.wrong = f"ended in state {_name(end)}; must be: " + " or ".join(
                state.name.lower() for state in allowed
            )

    # periods and orders

    def _run(self, seconds: float) -> None:
        end = self.rig.time.now() + seconds
        while self.rig.time.now() < end:
            self._loop.period()

    def _until(self, state: State) -> None:
        end = self.rig.time.now() + PATIENCE
        while self._axis.state is not state and self.rig.time.now() < end:
            self._loop.period()
        self._must_be(state)

    def _must_be(self, state: State) -> None:
        if self._axis.state is not state:
            raise DriveError(f"the axis is in state {_name(self._axis.state)}, must be {_name(state)} before the fault")

    def _order(self, order: Order) -> bool:
        """Give an order; whether it was taken."""
        board = self._service.controller.board
        number = board.order(order)
        while board.verdict(number) == PENDING:
            self._loop.period()
        return board.verdict(number) == TAKEN

    def _take(self, order: Order) -> None:
        if not self._order(order):
            raise DriveError(f"{Event(order.kind).name.lower()} was refused in state {_name(self._axis.state)}")


def _name(state: State) -> str:
    return state.name.lower().replace("_", " ")
