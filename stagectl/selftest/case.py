"""One case of the self-test: a fault in one state of a single motion, and how long and how far it may go on."""

from __future__ import annotations

import math

from stagectl.drives import faults
from stagectl.drives.drive import DriveError, Fault
from stagectl.drives.faults import FaultType
from stagectl.realtime.axis import Axis
from stagectl.realtime.scheduling import Metronome
from stagectl.realtime.shared_memory import Order
from stagectl.realtime.states import STOPS_GOING_ON, Event, State
from stagectl.selftest.limits import Limit, limit, ramp
from stagectl.selftest.rig import BaseRig, OversleepingMetronome, RigLoop

STATES = ("connecting", "enabling", "holding", "moving", "stopping", "faulted")
BEFORE = 0.15  # s of holding or moving before the fault
AFTER = 0.3  # s that a motion which must go on is watched
REST = 0.2  # s that an axis is watched after the loop has let go of it
PATIENCE = 30.0  # s in which connecting must succeed or be given up
TRIP = 0x2310


class Case:
    """One fault in one state."""

    def __init__(self, rig: BaseRig, row: FaultType) -> None:
        self.setup, self.row, self.rig = rig.setup, row, rig
        self.block = faults.default(row.name)
        self.reason, self.begun, self.fault = "", math.nan, Fault.NONE
        self.where = 0.0  # rad | m, of the axis when the fault began
        self.dead = False
        self.until = math.inf  # s, when what is judged of the motion ends
        self.wrong = ""  # what else is not as it must be, in words
        self._loop: RigLoop
        self._axis: Axis

    def run(self, state: str) -> None:
        """Go to the state, let the fault begin, and hear out what follows.  Raises nothing."""
        try:
            {"connecting": self._connecting, "enabling": self._enabling}.get(state, lambda: self._enabled(state))()
        except DriveError as error:
            self.reason = str(error)
            self._loop.leave()
        alone = "supervision" in self.row.required.noticed  # then the drive stops by its own time-outs
        self.rig.time.sleep(REST + alone * self.limit(self.rig.laid_out.speed).time)
        self.rig.settle()

    def kind(self, state: str) -> str:
        """What the state is judged as."""
        return state

    def begin(self, metronome: Metronome | None = None) -> None:
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
            if isinstance(metronome, OversleepingMetronome):
                metronome.extra = self.block.delay
        else:
            self.rig.begin(self.block)

    def _connecting(self) -> None:
        self.begin()
        self._connect()
        self._power()
        self._loop.leave()

    def _enabling(self) -> None:
        self._connect()
        self.begin()
        if not self.dead:
            self._power()
            self._loop.leave()

    def _enabled(self, state: str) -> None:
        self._connect()
        laid_out = self.rig.laid_out
        self._power(laid_out.holding if state in ("holding", "faulted") else laid_out.moving)
        self._go(BEFORE)
        if state == "faulted":
            self.rig.trip(TRIP)
            self._go(AFTER)
            self.begin()
        else:
            self.begin(self._loop.metronome)
            self._follow(state)
        if self.dead:
            self.rig.time.sleep(self._patience())
        elif self.row.required.category is not None or state not in ("holding", "moving") or self.fault:
            self._loop.leave()
        else:
            self.rig.let_go(self._loop)

    def _follow(self, state: str) -> None:
        """What follows from the fault; a stop is ordered before it is looked for."""
        if self.dead:
            return
        if state == "stopping":
            self._loop.abandon()
        self._go(self._patience())
        if state != "stopping" and self._axis.faults:
            self.fault = self._axis.fault
            self.reason = self.fault.name

    def _connect(self) -> None:
        """Raises DriveError."""
        self._loop = self.rig.loop()
        (self._axis,) = self._loop.axes
        self._loop.connect()
        if self._axis.drive is None:
            raise DriveError(self._axis.board.words)

    def _power(self, motion: Order | None = None) -> None:
        """Switch power on, for this motion.  Raises DriveError where it does not come."""
        board = self.rig.laid_out.board
        for order in (Order(Event.ENABLE), motion):
            if order is not None:
                board.order(order)
        self._loop.begin()
        while self._axis.state is State.ENABLING:
            self._loop.period()
        if self._axis.state is not (State.MOVING if motion else State.STANDING):
            raise DriveError(self._axis.reason or self._axis.board.words)

    def _go(self, seconds: float) -> None:
        """Let the motion go on so long, or to its end; a stop that has begun comes to its end."""
        end = self.rig.time.now() + seconds
        while self._axis.state in STOPS_GOING_ON or (self.rig.time.now() < end and self._axis.state is State.MOVING):
            self._loop.period()

    def _patience(self) -> float:
        if self.row.required.category is None:
            return AFTER
        return min(self.limit(self.rig.laid_out.speed).time + AFTER, PATIENCE)

    def limit(self, speed: float) -> Limit:
        """What is admitted for an axis at this speed (rad/s | m/s)."""
        return limit(self.setup, self.row, self.block, speed)

    def admitted(self, state: str) -> Limit | None:
        """The most that is admitted in this state; None where the motion goes on."""
        speed = self.rig.laid_out.speed
        if state in ("connecting", "enabling", "faulted"):
            return Limit(PATIENCE, self._creep())
        if state == "holding":
            return Limit(PATIENCE, self.limit(0.0).distance + self._creep())
        if self.row.required.category is None:
            return ramp(self.setup, speed) if state == "stopping" else None
        return self.limit(speed)

    def may_go_on(self, state: str) -> bool:
        """Whether the axis may go on in this state as if nothing were."""
        must = self.row.required
        if state == "holding":
            return must.holding in ("go on", "either")
        return state == "moving" and must.category is None

    def _creep(self) -> float:
        """What an axis that nobody moves may seem to move (rad | m): the relaxing of its friction."""
        return 4.0 * self.setup.stage.encoder.step + 1e-3 * self.setup.file.limits.following_error
