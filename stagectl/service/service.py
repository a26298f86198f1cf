"""The service: starts the real-time process and the black boxes, gives orders, and sees to it that both live.

::

    HTTP (http.py) --> Service --- board: orders, setpoints ---> axes process ===== CAN ===== drives
                          ^   <--- board: status, words ----          |
                          |                                           | ring
                       watch(): every 20 ms                           v
                       setpoints ahead, faults into the list,      black box ---> *.h5 on each fault
                       dead processes, systemd's watchdog

It comes up without power, whatever it was doing before; what ended it stands in the fault list.
"""

from __future__ import annotations

import asyncio
import collections
import contextlib
import fcntl
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.drives.drive import Canopen, Fault
from stagectl.evaluation import DWELL
from stagectl.realtime.shared_memory import PENDING, TAKEN, Order, Status
from stagectl.realtime.states import Event, State, why_not
from stagectl.service import processes, virtual_drive
from stagectl.service.axis_controller import Manned, ServiceError
from stagectl.service.child_process import Child, start
from stagectl.service.notify import notify
from stagectl.service.recordings import Recordings

LOOK = 0.02  # s between two looks at the processes
_ANSWER = 2.0  # s in which the loop takes an order; longer only while it configures a drive
_LOCK = 20.0  # s to wait for an earlier process that still stops its axes
_LEAVE, _WRITE = 15.0, 10.0  # s for the end of the real-time process, and of a black box
_UP = 120.0  # s that a new real-time process may take to be there: import, and the drives' answers
_SETTLE = 3.0  # s after a motion in which the axis must be in position
_DEATHS, _DEATH_TIME = 5, 60.0  # as many ends of the real-time process within that time, s, and the service gives up
_KEPT = 200  # entries of the fault list


class Where(NamedTuple):
    """Places of a running service."""

    socket: Path
    state: Path  # folder: black boxes, and the mark of a service that runs
    foxglove: tuple[str, int] | None = None  # host and port of its live view; None: there is none


class Service:
    """All axes of one machine."""

    def __init__(self, axes: dict[str, Manned], where: Where, coupled: bool, say: Callable[[str], None]) -> None:
        self.axes, self.where, self.coupled, self.say = axes, where, coupled, say
        self.faults: collections.deque[dict[str, Any]] = collections.deque(maxlen=_KEPT)
        self.refused: list[str] = []
        self._seen = dict.fromkeys(axes, 0)
        self._deaths: list[float] = []
        self._restarting: asyncio.Task[None] | None = None
        self._ends = contextlib.ExitStack()  # of what has been begun, the last one first
        self.recordings = Recordings(where.state)

    # begin and end

    async def begin(self) -> None:
        """Take the machine, start its processes; the drives are configured, nothing has power.

        It may be cancelled: `end` undoes what there is.  Raises ServiceError.
        """
        self.where.state.mkdir(parents=True, exist_ok=True)
        await self._take_lock()
        mark = self.where.state / "running"
        if mark.exists():
            self.note("", "service_died", "the service ended without being told to; the axes were stopped without it")
        mark.write_text(str(os.getpid()))
        self._ends.callback(_unlink, mark)
        for name in self.recordings.tidy():
            self.say(f"the black box {name} was cut off while it was written; the rows that it has are kept")
        self._present_drives()
        self._spawn()
        self._ends.callback(self._stop)
        await self._up()
        if self._live is not None and (address := await asyncio.to_thread(self._live.line)):
            self.say(f"for Foxglove: {address}")

    def end(self) -> None:
        """Stop what moves, end the processes, give the machine back."""
        if self._restarting is not None:
            self._restarting.cancel()
        self._ends.close()

    def _stop(self) -> None:
        self._loop.terminate()
        self._loop.wait(_LEAVE)
        for child, patience in self._companions():
            child.wait(patience)

    def _companions(self) -> list[tuple[Child, float]]:
        """All that lives by the real-time process, and how long (s) its end may take; recordings end here."""
        live = [(self._live, _LEAVE)] if self._live else []
        return [*((box, _WRITE) for box in self._boxes.values()), *self.recordings.cut(), *live]

    async def _take_lock(self) -> None:
        """One service a machine; the processes of an earlier one hold the lock until their axes stand."""
        self._lock = os.open(self.where.state / "lock", os.O_RDWR | os.O_CREAT, 0o600)
        self._ends.callback(os.close, self._lock)
        end = time.monotonic() + _LOCK
        while True:
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            except OSError as error:
                if time.monotonic() > end:
                    raise ServiceError(
                        f"{self.where.state} belongs to another service that runs: stop it first"
                    ) from error
                await asyncio.sleep(0.1)

    def _present_drives(self) -> None:
        """Virtual drives where the embedded bus has none."""
        for axis in self.axes.values():
            wire = axis.setup.file.drive.wire
            if isinstance(wire, Canopen) and wire.interface == "embedded" and not virtual_drive.answers(wire):
                self.say(f"no drive answers on the embedded bus {wire.channel}: starting a virtual one")
                drive = virtual_drive.start(axis.setup.path, wire.channel, axis.setup.file.simulation.seed)
                self._ends.callback(drive.wait)
                self._ends.callback(drive.terminate)

    def _spawn(self) -> None:
        """Start the real-time process and the black boxes: from this thread, whose end would be theirs."""
        self._alive, held = os.pipe()
        axes = list(self.axes.values())
        shared = [descriptor for axis in axes for descriptor in (axis.ring.descriptor, axis.board.descriptor)]
        self._loop = start("stagectl.realtime.axes", (*shared, held, self._lock), "interpreted")
        os.close(held)
        self._loop.send(processes.post(axes, self.coupled))
        self._boxes = {name: self._box(axis) for name, axis in self.axes.items()}
        self._live = processes.foxglove(axes, self.where.foxglove, self._alive) if self.where.foxglove else None

    async def _up(self) -> None:
        """Wait until the real-time process has looked for its drives.  Raises ServiceError where it does not come."""
        end = time.monotonic() + _UP
        while not self._loop.readable(0.0):
            if time.monotonic() > end:
                raise ServiceError(f"the real-time process was not there after {_UP:.0f} s; see the messages above")
            await asyncio.sleep(LOOK)
        line = self._loop.line()
        if not line:
            raise ServiceError("the real-time process did not start; see the messages above")
        self.refused = json.loads(line)["refused"]
        for axis in self.axes.values():
            if axis.state is State.OFFLINE:
                self.say(f"{axis.name}: {axis.board.words}")

    def _box(self, axis: Manned) -> Child:
        return processes.box(axis, self.where.state, self._alive)

    # what goes on by itself

    async def watch(self) -> None:
        """Look every 20 ms, until cancelled; raises ServiceError where the real-time process does not stay alive."""
        petted = 0.0
        while True:
            await asyncio.sleep(LOOK)
            for axis in self.axes.values():
                axis.fill()
                self._notice(axis)
            self._revive()
            for name in self.recordings.look():
                self.note(name, "recorder_died", "the recorder failed; see the messages above, and `df`")
            if (self.alive() or self._restarting) and time.monotonic() - petted > 0.5:
                petted = time.monotonic()
                notify("WATCHDOG=1", f"STATUS={self.words()}")

    def alive(self) -> bool:
        """Whether the real-time process makes progress: its own sign of life, not ours."""
        now = time.monotonic()
        return all(now - status.tick < status.patience for status in (axis.status for axis in self.axes.values()))

    def words(self) -> str:
        """The machine in a line."""
        return "; ".join(f"{axis.name} {axis.state.words}" for axis in self.axes.values())

    def note(self, axis: str, fault: str, words: str) -> None:
        """An entry of the fault list."""
        self.faults.append({"time": time.strftime("%Y-%m-%dT%H:%M:%S%z"), "axis": axis, "fault": fault, "words": words})
        self.say(f"{axis or 'service'}: {words}")

    def _notice(self, axis: Manned) -> None:
        status = axis.status
        if int(status.faults) != self._seen[axis.name]:
            self._seen[axis.name] = int(status.faults)
            self.note(axis.name, Fault(int(status.fault)).name.lower(), axis.board.words)
            axis.finished(False)

    def _revive(self) -> None:
        """Processes that died are started again; whoever asks meanwhile is answered, see `Manned.told`."""
        for name, box in self._boxes.items():
            if box.ended is not None and self._loop.ended is None:
                self.note(name, "blackbox_died", f"the black box ended ({box.ended}); a new one watches")
                box.wait()  # it has ended: its pipes go
                self._boxes[name] = self._box(self.axes[name])
        if self._live is not None and self._live.ended is not None and self._loop.ended is None:
            self._live.wait()
            self._live = None
            self.note("", "foxglove_ended", "Foxglove's server ended; see above, then start the service anew")
        if self._restarting is not None and self._restarting.done():
            self._restarting.result()
            self._restarting = None
        if self._restarting is None and self._loop.ended is not None:
            self._restarting = asyncio.create_task(self._restart(self._loop.ended))

    async def _restart(self, ended: int) -> None:
        """A new real-time process; the axes come back without power, after the drives have stopped."""
        now = time.monotonic()
        self._deaths = [when for when in self._deaths if now - when < _DEATH_TIME] + [now]
        words = f"the real-time process died ({processes.ending(ended)}); the drive stops by its own time-outs"
        self.note("", "process_died", f"{words}. A new one comes up after them; next: `stagectl enable`")
        if len(self._deaths) > _DEATHS:
            raise ServiceError(f"the real-time process died {len(self._deaths)} times in {_DEATH_TIME:.0f} s: given up")
        for axis in self.axes.values():  # at once: what the dead one showed last is true no more
            axis.renew()
            axis.board.show(Status(state=State.CONNECTING))
            self._seen[axis.name] = 0
        for child, patience in [(self._loop, _LEAVE), *self._companions()]:
            await asyncio.to_thread(child.wait, patience)
        await asyncio.sleep(max(map(processes.silence, self.axes.values())))
        os.close(self._alive)
        self._spawn()
        await self._up()

    # orders

    def chosen(self, name: str) -> list[Manned]:
        """The axis of this name, all where there is none.

        Raises ServiceError.
        """
        if name and name not in self.axes:
            raise ServiceError(f"no axis {name}; there are {', '.join(self.axes)}")
        return [self.axes[name]] if name else list(self.axes.values())

    async def order(self, axis: Manned, order: Order) -> None:
        """Give an order and wait until the loop has taken it.

        Raises ServiceError with the reason where it cannot be given now.
        """
        state, board = axis.state, axis.board
        if not axis.status.tick:  # it would never see an order that was there before it
            raise ServiceError(f"{axis.name}: the real-time process is being started; see `stagectl status`")
        number = board.order(order)
        end = time.monotonic() + _ANSWER
        while (verdict := board.verdict(number)) == PENDING:
            silent = time.monotonic() > end and time.monotonic() - axis.status.tick > axis.status.patience
            if silent or axis.board is not board:
                raise ServiceError(f"{axis.name}: the real-time process does not answer; see `stagectl status`")
            await asyncio.sleep(0.002)
        if verdict != TAKEN:
            event = Event(order.kind)
            own = event is Event.MOVE and state is State.STANDING
            raise ServiceError(f"{axis.name}: {axis.board.words if own else why_not(event, state)}")

    async def until(self, axis: Manned, wanted: Callable[[State], bool], timeout: float) -> bool:
        """Wait until its state is as `wanted`; False where it is not within `timeout` (s)."""
        end = time.monotonic() + timeout
        while not wanted(axis.state):
            if time.monotonic() > end:
                return False
            await asyncio.sleep(0.005)
        return True

    async def settle(self, axis: Manned) -> bool:
        """Wait for the end of the motion; whether the axis then stands in position, as long as the dwell asks."""
        motion, board = axis.motion, axis.board
        while axis.state in (State.MOVING, State.HOMING):
            await asyncio.sleep(0.005)
        end = time.monotonic() + _SETTLE
        while axis.state is State.STANDING and axis.board is board:
            status = axis.status
            if status.settled >= DWELL:
                if axis.motion is motion:
                    axis.finished(not status.fault)
                return not status.fault
            if time.monotonic() > end:
                return False
            await asyncio.sleep(0.005)
        return False


def _unlink(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()
