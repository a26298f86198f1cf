"""The service: starts the real-time process and the black boxes, gives orders, and restarts what dies.

::

    HTTP (http.py) --> Service --- board: orders, setpoints ---> axes process ===== CAN ===== drives
                          ^   <--- board: status, words ----          |
    stop_path.py ---------|------- board: stops, of their own --------+
                          |                                           | ring
                       watch(): every 20 ms                           v
                       setpoints ahead, faults into the list,      black box ---> *.h5 on each fault
                       dead processes, systemd's watchdog

It comes up without power, whatever it did before.  The fault list names what ended it.
"""

import asyncio
import collections
import contextlib
import json
import os
import socket
import time
from collections.abc import Callable
from typing import Any

from stagectl.drives.drive import Canopen, Fault, accepted
from stagectl.realtime.shared_memory import PENDING, TAKEN, Order, Status
from stagectl.realtime.states import Event, State
from stagectl.service import job_from_stage, processes, single_instance, virtual_drive
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.service.axis_status import machine_json
from stagectl.service.child_process import rank, start
from stagectl.service.limits import LOOP, SERVICE
from stagectl.service.planner import Planner
from stagectl.service.recordings import Recordings
from stagectl.service.single_instance import notify, serving
from stagectl.service.stop_link import Probe
from stagectl.service.stop_link import ServicePaths as ServicePaths

LOOK = 0.02  # s between two looks at the processes
_ANSWER = 2.0  # s in which the loop takes an order; longer only while it configures a drive
_LEAVE = 15.0  # s that the real-time process may take to end
_UP = 120.0  # s that a new real-time process may take to start: imports, and the drives' answers
_READY = 60.0  # s for the stop path to be ready: its imports on a busy machine
_DEATHS, _DEATH_TIME = 5, 60.0  # more deaths of the real-time process within this time (s) end the service
_KEPT = 200  # entries of the fault list


class Service:
    """All axes of one machine."""

    def __init__(
        self, axes: dict[str, AxisController], paths: ServicePaths, coupled: bool, say: Callable[[str], None]
    ) -> None:
        self.axes, self.paths, self.coupled, self.say = axes, paths, coupled, say
        self.faults: collections.deque[dict[str, Any]] = collections.deque(maxlen=_KEPT)
        self.refused: list[str] = []
        self._seen = dict.fromkeys(axes, 0)
        self._deaths: list[float] = []
        self._restarting: asyncio.Task[None] | None = None
        self._ends = contextlib.ExitStack()  # undoes what has been begun, the last step first
        self.recordings = Recordings(paths.state)
        self.planner = Planner(lambda: [axis.rehearsal() for axis in axes.values()], say)
        self._companions = processes.Companions(axes, paths, self.note)

    # begin and end

    async def begin(self) -> None:
        """Lock the machine and start its processes; the drives are configured, nothing has power.

        It may be cancelled: `end` undoes what was begun.  Raises ServiceError.
        """
        self.paths.state.mkdir(parents=True, exist_ok=True)
        self._lock = await single_instance.take_lock(self.paths.state, self._ends, self.say)
        if single_instance.mark_running(self.paths.state, self._ends):
            self.note("", "service_died", "the last service was killed; the real-time process stopped its axes")
        for name in self.recordings.tidy():
            self.say(f"the writing of the black box {name} was interrupted; its rows so far are kept")
        rank(os.getpid(), SERVICE)
        self._stop_socket = self._ends.enter_context(serving(self.paths.stop, socket.SOCK_DGRAM))
        for axis in self.axes.values():
            self._ends.enter_context(virtual_drive.present(axis.setup, self.say))
            await asyncio.sleep(LOOK)  # a signal that has waited is heard
        self._spawn()
        self._ends.callback(self._stop)
        self.planner.start()
        self._ends.callback(self.planner.close)
        await self._up()
        self._probe = Probe(self.paths.stop)
        self._ends.callback(self._probe.close)
        if self.paths.foxglove and (address := await asyncio.to_thread(self._companions.address)):
            self.say(f"for Foxglove: {address}")

    def end(self) -> None:
        """Stop what moves, end the processes, release the machine."""
        if self._restarting is not None:
            self._restarting.cancel()
        self._ends.close()

    def _stop(self) -> None:
        self._loop.terminate()
        self._loop.wait(_LEAVE)
        for child, patience in [*self._companions.leaving(), *self.recordings.cut(), *self._companions.last()]:
            child.wait(patience)

    def _spawn(self) -> None:
        """Start the real-time process and its companions: from this thread, as they die with it."""
        self._alive, held = os.pipe()
        axes = list(self.axes.values())
        shared = [descriptor for axis in axes for descriptor in (axis.ring.descriptor, axis.board.descriptor)]
        self._loop = start("stagectl.realtime.axes", (*shared, held, self._lock), "interpreted")
        os.close(held)
        rank(self._loop.pid, LOOP)
        self._loop.send(job_from_stage.post(axes[0].setup, [axis.orders() for axis in axes], self.coupled))
        self._companions.spawn(self._alive, self._stop_socket.fileno())

    async def _up(self) -> None:
        """Wait until the real-time process has looked for its drives.  Raises ServiceError where it does not start."""
        if not await self.until(lambda: self._loop.readable(0.0), _UP):
            raise ServiceError(f"the real-time process did not start within {_UP:.0f} s; see the messages above")
        if line := self._loop.line():
            self.refused = json.loads(line)["refused"]
        elif not self._deaths:  # else it has died once more, and `watch` counts that
            raise ServiceError("the real-time process did not start; see the messages above")
        if not await self.until(self._stoppable, _READY):
            raise ServiceError(f"the stop path did not start within {_READY:.0f} s; see the messages above")
        for axis in self.axes.values():
            self._say_drive(axis)

    def _say_drive(self, axis: AxisController) -> None:
        wire = axis.setup.file.drive.wire
        for line in accepted(wire) if isinstance(wire, Canopen) else ():
            self.say(f"{axis.name}: {line}")
        if axis.state is State.OFFLINE:
            self.say(f"{axis.name}: {axis.board.words}")

    def _stoppable(self) -> bool:
        """Whether stops are taken, or nothing can move: the loop has died, and `watch` starts another."""
        return self._loop.ended is not None or self._companions.takes_stops(self.refused)

    # supervision

    async def watch(self) -> None:
        """Look every 20 ms, until cancelled; raises ServiceError where the real-time process dies again and again."""
        triggered = 0.0
        while True:
            await asyncio.sleep(LOOK)
            for axis in self.axes.values():
                axis.fill()
                self._notice(axis)
            self._revive()
            for name in self.recordings.look():
                self.note(
                    name, "recorder_died", "the recorder failed; see the messages above, then check the disk with `df`"
                )
            for words in self.recordings.expire(self.axes.values()):
                self.say(words)
            self._probe.look()
            well = self.alive() and self._probe.well
            if (well or self._restarting) and time.monotonic() - triggered > 0.5:
                triggered = time.monotonic()
                notify("WATCHDOG=1", f"STATUS={self.words()}")

    def alive(self) -> bool:
        """Whether the real-time process makes progress: by its own sign of life, not by ours."""
        now = time.monotonic()
        return any(now - status.tick < status.patience for status in (axis.status for axis in self.axes.values()))

    def machine_json(self) -> dict[str, Any]:
        """The machine now, as JSON values."""
        axes = [(axis.shown, axis.board) for axis in self.axes.values()]
        return {**machine_json(axes, self.refused), "alive": self.alive()}

    def words(self) -> str:
        """The states of all axes in one line."""
        return "; ".join(f"{axis.name} {axis.state.words}" for axis in self.axes.values())

    def note(self, axis: str, fault: str, words: str) -> None:
        """Append to the fault list, and report it."""
        self.faults.append({"time": time.strftime("%Y-%m-%dT%H:%M:%S%z"), "axis": axis, "fault": fault, "words": words})
        self.say(f"{axis or 'service'}: {words}")

    def _notice(self, axis: AxisController) -> None:
        status = axis.status
        if int(status.faults) != self._seen[axis.name]:
            self._seen[axis.name] = int(status.faults)
            self.note(axis.name, Fault(int(status.fault)).name.lower(), axis.board.words)
            axis.finished(False)

    def _revive(self) -> None:
        """Start again what died; a status request in between is answered, see `axis_status`."""
        self.planner.look()
        if self._loop.ended is None:
            self._companions.look()
            if self._restarting is None:
                self._companions.takes_stops(self.refused)
        if self._restarting is not None and self._restarting.done():
            self._restarting.result()
            self._restarting = None
        if self._restarting is None and self._loop.ended is not None:
            self._restarting = asyncio.create_task(self._restart(self._loop.ended))

    async def _restart(self, ended: int) -> None:
        """A new real-time process; the axes come back without power, after the drives have stopped."""
        now = time.monotonic()
        self._deaths = [when for when in self._deaths if now - when < _DEATH_TIME] + [now]
        words = f"the real-time process died ({await processes.heard_of(ended)}); the drive stops on its own time-outs"
        self.note("", "process_died", f"{words}. A new process starts after them; next: `stagectl enable`")
        if len(self._deaths) > _DEATHS:
            raise ServiceError(
                f"the real-time process died {len(self._deaths)} times in {_DEATH_TIME:.0f} s; run `stagectl doctor`"
            )
        for axis in self.axes.values():  # at once: the last status of the dead process is no longer true
            axis.renew()
            axis.board.show(Status(state=State.CONNECTING))
            self._seen[axis.name] = 0
        for child, patience in [(self._loop, _LEAVE), *self._companions.leaving(), *self.recordings.cut()]:
            await asyncio.to_thread(child.wait, patience)
        await asyncio.sleep(max(map(processes.silence, self.axes.values())))
        os.close(self._alive)
        self._spawn()
        await self._up()

    # orders

    def chosen(self, name: str) -> list[AxisController]:
        """The axis called `name`; all axes where it is empty.  Raises ServiceError."""
        if name and name not in self.axes:
            raise ServiceError(f"no axis {name}; the axes are: {', '.join(self.axes)}")
        return [self.axes[name]] if name else list(self.axes.values())

    def axis(self, name: str) -> AxisController:
        """The axis called `name`; the only one where it is empty.  Raises ServiceError."""
        axes = self.chosen(name)
        if len(axes) > 1:
            raise ServiceError(f"the order must name its axis; the axes are: {', '.join(self.axes)}")
        return axes[0]

    async def order(self, axis: AxisController, order: Order) -> None:
        """Give an order and wait until the loop has taken it; a stop that comes from now on makes it void.

        Raises ServiceError with the reason where it cannot be given now.
        """
        board = axis.board
        order = order._replace(stops=board.stops if order.stops is None else order.stops)
        if not axis.status.tick:  # it would never see an order from before its start
            raise ServiceError(f"{axis.name}: the real-time process is starting; see `stagectl status`")
        if self._restarting is not None:  # nothing may begin before the stop path takes stops again
            await asyncio.wait({self._restarting})
        gone = ServiceError(f"{axis.name}: the real-time process does not answer; see `stagectl status`")
        if axis.board is not board:
            raise gone
        number = board.order(order)
        end = time.monotonic() + _ANSWER
        while (verdict := board.verdict(number)) == PENDING:
            if axis.board is not board or (time.monotonic() > end and not self.alive()):
                raise gone
            await asyncio.sleep(0.002)
        if verdict != TAKEN:
            if order.stops != board.stops:
                raise ServiceError(f"{axis.name}: stopped before it began")
            raise ServiceError(f"{axis.name}: {axis.refusal(Event(order.kind))}")

    async def until(self, wanted: Callable[[], bool], timeout: float) -> bool:
        """Wait until it is as `wanted`; False where that takes longer than `timeout` (s)."""
        end = time.monotonic() + timeout
        while not wanted():
            if time.monotonic() > end:
                return False
            await asyncio.sleep(0.005)
        return True
