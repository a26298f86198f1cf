"""The real-time process of the service: all axes of one bus, period by period, for months.

Run as ``python -m stagectl.realtime.axes``; one pickled `Post` comes on standard input, one line goes out when it is
ready.  From then on orders come and status goes by each axis' board, rows by its ring; it ends on SIGTERM, which the
kernel also sends when the service dies: then the axes are stopped first.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import sys
from typing import NamedTuple

from stagectl.drives.bus.frames import Bus
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.bus.shared_bus import Ports
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, Drive, Fault, Odrive
from stagectl.drives.odrive import open_odrive
from stagectl.drives.simulated import Plant, Simulated
from stagectl.realtime import scheduling
from stagectl.realtime.axis import Axis, Orders
from stagectl.realtime.shared_memory import Board, Order
from stagectl.realtime.states import Event
from stagectl.recording.ring import Ring
from stagectl.units import StageError

_IDLE = 0.02  # s between two looks where no drive is connected


class Post(NamedTuple):
    """The order of this process."""

    axes: tuple[Orders, ...]
    dt: float  # s, of all axes
    priority: int
    cpu: int | None
    width: int  # of the rings
    capacity: int
    coupled: bool  # a fault of one axis stops all
    spin: float = 0.0  # s, see `realtime.Metronome`


class Loop:
    """All axes; `period` is one of theirs."""

    def __init__(self, post: Post, clock: Clock = WALL) -> None:
        self._post, self._clock = post, clock
        self._ports: dict[tuple[str, str], Ports] = {}
        self.axes = [self._axis(p) for p in post.axes]
        self._metronome = scheduling.Metronome(post.dt, clock, post.spin)
        self._by_clock = all(p.by_clock for p in post.axes)
        self._missed = 0
        self._faults = [0] * len(self.axes)

    def period(self) -> None:
        """Wait, sense all, act all; then what one axis means to the others, and what the service wants."""
        connected = [axis for axis in self.axes if axis.drive is not None]
        if not connected:
            self._idle()
            return
        lateness = self._metronome.wait()
        missed = self._missed + (self._metronome.missed() if lateness >= self._post.dt else 0)
        for axis in connected:
            axis.sense()
        passed = 1 + missed if self._by_clock else 1
        for axis in connected:
            axis.act(lateness, missed > 0, passed)
        self._couple()
        self._obey()
        self._missed = self._metronome.missed()

    def abandon(self) -> bool:
        """Nobody gives orders any more: stop what moves; whether all of it stands without power."""
        for axis in self.axes:
            if axis.powered:
                axis.happen(Event.RAMP, Fault.UNATTENDED)
        return not any(axis.powered for axis in self.axes)

    def leave(self) -> None:
        """Leave all drives."""
        for axis in self.axes:
            axis.leave()

    def _axis(self, p: Orders) -> Axis:
        ring = Ring(p.ring, self._post.width, self._post.capacity)
        return Axis(p, Board(p.board), ring, self._connect, self._clock)

    def _idle(self) -> None:
        self._clock.sleep(_IDLE)
        for axis in self.axes:
            axis.show()
        self._obey()
        self._metronome.restart()
        self._missed = 0

    def _couple(self) -> None:
        if not self._post.coupled:
            return
        faults = [axis.faults for axis in self.axes]
        if faults != self._faults:
            for axis in self.axes:
                if axis.powered and axis.fault is Fault.NONE:
                    axis.happen(Event.RAMP, Fault.PARTNER)
            self._faults = [axis.faults for axis in self.axes]

    def _obey(self) -> None:
        """One order an axis; moves that begin together wait for each other, and begin all or not at all.

        Nothing else waits for them: an order behind one that waits is its end.
        """
        pending = [(axis, order) for axis in self.axes if (order := axis.board.next_order()) is not None]
        if not pending:
            return
        together = [(axis, order) for axis, order in pending if order.kind == Event.MOVE and order.numbers[-1] > 1.0]
        complete = bool(together) and len(together) >= together[0][1].numbers[-1]
        possible = complete and all([axis.may_begin(order) for axis, order in together])
        for axis, order in pending:
            joint = (axis, order) in together
            if complete or not joint:
                taken = (possible if joint else self._may(axis, order)) and axis.take(order)
                axis.show()  # before the answer: whoever gets it sees the state that follows
                axis.board.answer(taken)
            elif axis.board.waiting > 1:  # the others have not come, and behind it may be a stop
                axis.board.answer(False)

    def _may(self, axis: Axis, order: Order) -> bool:
        connects = order.kind in (Event.CONNECT, Event.RESET)
        if connects and any(other.powered for other in self.axes):
            axis.board.say("an axis has power: a drive can only be configured when all are disabled")
            return False
        return True

    def _connect(self, p: Orders) -> Drive:
        if p.wire is None:
            return Simulated(Plant(p.stage, p.simulation, p.ramp.dt))
        if isinstance(p.wire, Odrive):
            return open_odrive(p.wire, p.ramp.dt)
        bus = self._bus(p.wire)
        try:
            return CanopenDrive(p.wire, bus, p.stage.encoder.step, p.ramp.dt)
        except StageError:
            bus.close()
            raise

    def _bus(self, wire: Canopen) -> Bus:
        """The bus of the wire; a port of it where several axes share it."""
        if len(self._post.axes) == 1:
            return open_bus(wire.interface, wire.channel, wire.bitrate)
        where = (wire.interface, wire.channel)
        if where not in self._ports:
            self._ports[where] = Ports(lambda: open_bus(wire.interface, wire.channel, wire.bitrate))
        return self._ports[where].port(wire.node)


def serve(post: Post, clock: Clock = WALL) -> None:
    """Connect, then serve until told to leave, in the periods of `clock`."""
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopped.append(number))
    scheduling.follow_parent()
    loop = Loop(post, clock)
    for axis in loop.axes:
        axis.happen(Event.CONNECT)
        axis.show()
    refused = scheduling.prepare(post.priority, post.cpu)
    print(json.dumps({"event": "ready", "refused": refused}), flush=True)
    try:
        while not (stopped and loop.abandon()):
            loop.period()
    finally:
        loop.leave()
        for axis in loop.axes:
            axis.ring.close()


def main() -> None:
    """Entry of the process."""
    post: Post = pickle.load(sys.stdin.buffer)
    serve(post)
    os._exit(0)


if __name__ == "__main__":
    main()
