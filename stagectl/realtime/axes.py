"""The real-time process: all axes of one bus, period by period, for months; or one axis for one motion.

Run as ``python -m stagectl.realtime.axes``; one pickled `Post` comes on standard input, one line goes out when it is
ready.  From then on orders come and status goes by each axis' board, rows by its ring; it ends on SIGTERM, which the
kernel also sends when its parent dies: then the axes are stopped first.

Interpreted kernels, and no other Python thread.
"""

import contextlib
import json
import os
import signal
import sys
from typing import Any, NamedTuple

from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Drive, DriveError, Fault
from stagectl.realtime import order_rules, safety, scheduling
from stagectl.realtime.axis import Axis
from stagectl.realtime.axis_data import Orders
from stagectl.realtime.drive_opening import Opening
from stagectl.realtime.shared_memory import Board, Order
from stagectl.realtime.single_axis import SingleAxis
from stagectl.realtime.states import Event, State
from stagectl.recording.beside import order_of
from stagectl.recording.ring import Ring
from stagectl.units import StageError

_IDLE = 0.02  # s between two looks where no drive is connected


class Post(NamedTuple):
    """The order of this process."""

    axes: tuple[Orders, ...]
    dt: float  # s, of all axes
    priority: int
    cpu: int | None
    coupled: bool  # a fault of one axis stops all
    spin: float = 0.0  # s, see `realtime.Metronome`
    single: bool = False  # one axis and one motion: the process ends with it
    reset: bool = False  # a drive that is in Fault is reset as it is connected: a person has asked for it


class Loop:
    """All axes; `period` is one of theirs."""

    def __init__(self, post: Post, clock: Clock = WALL) -> None:
        self._post, self._clock = post, clock
        self._opening = Opening(len(post.axes) > 1)
        self.axes = [self._axis(p) for p in post.axes]
        self._connected: list[Axis] = []
        self._metronome = scheduling.Metronome(post.dt, clock, post.spin)
        self._by_clock = all(p.by_clock for p in post.axes)
        self._coupled = post.coupled and len(post.axes) > 1
        self._missed, self._held_up = 0, False  # periods since the last setpoint; whether some were lost after the row
        self._faults = [0] * len(self.axes)

    def connect(self) -> None:
        """Find and configure all drives."""
        for axis in self.axes:
            axis.happen(Event.RESET if self._post.reset else Event.CONNECT)
            axis.show()

    def begin(self) -> None:
        """Begin with the orders that are on the boards; the grid of the periods begins now."""
        self._obey()
        self._look_round()
        self._metronome.restart()

    def period(self) -> None:
        """One period of all drives that are there; where there is none, a look at what was ordered."""
        connected = self._connected or self._look_round()
        if connected:
            self._cycle(connected)
        else:
            self._idle()

    def _cycle(self, connected: list[Axis]) -> None:
        """Wait, sense all, act all, write all down; then what one axis means to the others, and what was ordered."""
        metronome = self._metronome
        lateness = metronome.wait()
        overslept = metronome.missed() if lateness >= metronome.period else 0
        for axis in connected:
            axis.sense()
        passed = 1 + self._missed + overslept if self._by_clock else 1
        for axis in connected:
            axis.act(passed)
        self._missed = missed = metronome.missed()
        late = overslept + missed > 0 or self._held_up
        for axis in connected:
            axis.record(lateness, late)
            if axis.drive is None:
                self._look_round()
        self._held_up = False
        if self._coupled:
            self._couple()
        for axis in self.axes:
            if axis.board.called:
                self._interrupt()
                break

    def abandon(self) -> bool:
        """No orders come any more: stop what moves; whether all axes are without power."""
        for axis in self.axes:
            order_rules.give_up(axis, Fault.OPERATOR if self._post.single else Fault.UNATTENDED)
        return not any(axis.powered for axis in self.axes)

    def engage(self) -> None:
        """Let the brakes of axes that stand under power hold them, before power is cut."""
        for axis in self.axes:
            if axis.state is State.STANDING and axis.p.brake.present:
                axis.happen(Event.DISABLE)
        while any(axis.state is State.ENGAGING for axis in self.axes):
            self.period()

    def leave(self) -> None:
        """Leave all drives; no more rows will come."""
        for axis in self.axes:
            axis.leave()
            axis.ring.close()
        self._opening.close()

    def _axis(self, p: Orders) -> Axis:
        kind = SingleAxis if self._post.single else Axis
        return kind(p, Board(p.board), Ring(*p.ring), self._connect, self._clock)

    def _idle(self) -> None:
        self._clock.sleep(_IDLE)
        for axis in self.axes:
            axis.show()
        self._obey()
        self._look_round()
        self._metronome.restart()
        self._missed, self._held_up = 0, False

    def _couple(self) -> None:
        faults = [axis.faults for axis in self.axes]
        if faults != self._faults:
            for axis, before in zip(self.axes, self._faults, strict=True):
                if axis.faults == before:
                    order_rules.give_up(axis, Fault.PARTNER)
            self._faults = [axis.faults for axis in self.axes]

    def _interrupt(self) -> None:
        """See what was ordered; what is done then may take periods."""
        self._obey()
        self._look_round()
        lost = self._metronome.missed()
        self._missed += lost
        self._held_up = lost > 0

    def _look_round(self) -> list[Axis]:
        """The axes whose drive is there: each period is theirs."""
        self._connected = [axis for axis in self.axes if axis.drive is not None]
        return self._connected

    def _obey(self) -> None:
        """The stops, then one order an axis; moves that begin together wait for each other, and begin all or none.

        A move waits, too, for the power that its axis is getting.  Nothing else waits for them: an order behind one
        that waits is its end.
        """
        for axis in self.axes:
            order_rules.take_stops(axis)
        pending = [(axis, order) for axis in self.axes if (order := axis.board.next_order()) is not None]
        together = [(axis, order) for axis, order in pending if order_rules.joint(order)]
        complete = bool(together) and len(together) >= together[0][1].numbers[-1]
        possible = complete and all([axis.may_begin(order) for axis, order in together])
        for axis, order in pending:
            joint = order_rules.joint(order)
            early = order.kind == Event.MOVE and axis.state is State.ENABLING  # it waits for the axis' power
            if not complete if joint else early:
                if axis.board.waiting > 1:  # the others have not come, and behind it may be a stop
                    axis.board.answer(False)
                continue
            taken = (possible if joint else self._may(axis, order)) and axis.take(order)
            axis.show()  # before the answer: whoever gets it sees the state that follows
            axis.board.answer(taken)

    def _may(self, axis: Axis, order: Order) -> bool:
        connects = order.kind in (Event.CONNECT, Event.RESET)
        if connects and any(other.powered for other in self.axes):
            axis.board.say("a drive can only be configured while no axis has power: first run `stagectl disable`")
            return False
        return True

    def _connect(self, p: Orders) -> Drive:
        return self._opening.drive(p)


def serve(post: Post, clock: Clock = WALL) -> None:
    """Connect, then serve until asked to leave, in the periods of `clock`."""
    stopped, loop = _stops(), Loop(post, clock)
    loop.connect()
    _say("ready", refused=scheduling.prepare(post.priority, post.cpu))
    try:
        while not (stopped and loop.abandon()):
            loop.period()
    finally:
        loop.leave()


def perform(post: Post) -> None:
    """Connect, then make the motion whose orders are on the board at the word ``go``; each step is an event.

    Raises DriveError where the drive is not there or gets no power, or the motion does not fit the travel.
    """
    stopped, loop = _stops(), Loop(post)
    (axis,) = loop.axes
    assert isinstance(axis, SingleAxis)
    try:
        loop.connect()
        if axis.drive is None or axis.state is not State.DISABLED:
            raise DriveError(axis.reason or axis.board.words)
        facts = {"drive": axis.drive.describe(), "position": axis.drive.position()}
        _say("ready", refused=scheduling.prepare(post.priority, post.cpu), **facts)
        if sys.stdin.readline().strip() != "go":  # the recorder must be ready, with the drive's identity in its file
            return
        loop.begin()
        while not (axis.over or (stopped and loop.abandon())):
            loop.period()
        loop.engage()
    finally:
        loop.leave()
    _report(axis, bool(stopped))


def _report(axis: SingleAxis, stopped: bool) -> None:
    """How the motion went.  Raises DriveError where it has not begun."""
    fault = axis.fault or (Fault.OPERATOR if stopped and not axis.motions else Fault.NONE)
    if not axis.motions and fault is not Fault.OPERATOR:
        raise DriveError(axis.reason or axis.board.words)
    counts = {"cycles": axis.ring.written, "late": axis.late_rows, "fault": fault}
    _say("ended", **counts, words=safety.words(fault), reason=axis.reason.strip())


def _stops() -> list[int]:
    """Where the numbers of the signals come that end this process; one comes, too, when the parent dies."""
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopped.append(number))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT,))  # which who started us has blocked
    scheduling.follow_parent()
    return stopped


def _say(event: str, **facts: Any) -> None:
    with contextlib.suppress(BrokenPipeError):  # nobody reads any more: the axis is stopped anyway
        print(json.dumps({"event": event, **facts}), flush=True)


def main() -> None:
    """Entry of the process; exit 2 with the reason as an event where the motion could not begin."""
    post: Post | None = order_of()
    if post is None:
        return
    try:
        (perform if post.single else serve)(post)
    except StageError as error:
        _say("failed", reason=str(error))
        os._exit(2)
    os._exit(0)


if __name__ == "__main__":
    main()
