"""The service's processes: their orders at their start, who keeps them alive, and the meaning of their exit codes."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path

from stagectl.drives.drive import Canopen
from stagectl.realtime.axes import Post
from stagectl.service import job_from_stage
from stagectl.service.axis_controller import COLUMNS, AxisController
from stagectl.service.black_box import BlackBoxOrder
from stagectl.service.child_process import Child, start
from stagectl.service.confined import rank
from stagectl.service.foxglove_live import Feed, Source
from stagectl.service.limits import AT_ONCE, LOOP
from stagectl.service.recordings import about
from stagectl.service.stop_link import ServicePaths
from stagectl.service.stop_path import StopPost
from stagectl.service.virtual_timeouts import patient

_RAMP = 0.5  # s that a drive's own ramp may take
_LEAVE, _WRITE = 15.0, 10.0  # s that a process, and a black box, may take to end
Note = Callable[[str, str, str], None]  # axis, fault, words


def post(axes: list[AxisController], coupled: bool) -> Post:
    """The order of the real-time process."""
    return job_from_stage.post(axes[0].setup, [axis.orders() for axis in axes], coupled)


def _start_black_box(axis: AxisController, state: Path, alive: int) -> Child:
    """Start the black box of this axis; `alive` is the pipe that the real-time process holds."""
    meta = about(axis, "black box")
    folder = str(state / "blackbox" / axis.name)
    ring, board = axis.ring, axis.board.descriptor
    child = start("stagectl.service.black_box", (ring.descriptor, board, alive), "interpreted")
    dt, faults = axis.setup.dt, int(axis.status.faults)
    child.send(BlackBoxOrder(ring.place, board, alive, folder, meta, COLUMNS, dt, faults))
    return child


def _start_stop_path(axes: list[AxisController], socket: int, alive: int) -> Child:
    """Start the stop path of these axes on its bound `socket` (descriptors)."""
    boards = tuple(axis.board.descriptor for axis in axes)
    child = start("stagectl.service.stop_path", (socket, alive, *boards), "interpreted")
    rank(child.pid, LOOP)
    child.send(StopPost(socket, alive, tuple((axis.shown, axis.board.descriptor) for axis in axes)))
    return child


async def heard_of(exit_code: int) -> str:
    """How a process ended; where it did in order it was told to, and so is the service in a moment, which then ends."""
    if exit_code == 0:
        await asyncio.sleep(AT_ONCE)
    return ending(exit_code)


def _start_foxglove(axes: list[AxisController], address: tuple[str, int], alive: int) -> Child:
    """Start Foxglove's server for these axes at `address`."""
    child = start("stagectl.service.foxglove_live", (*(axis.ring.descriptor for axis in axes), alive), "interpreted")
    child.send(Feed(tuple(_source(axis) for axis in axes), *address, alive))
    return child


def _source(axis: AxisController) -> Source:
    from stagectl.recording.exports import described  # large imports, seldom needed
    from stagectl.recording.in_memory import units_of
    from stagectl.recording.mcap_log import definition

    ring, fields = axis.ring, described(units_of(COLUMNS, axis.setup.file.axis.kind))
    places = tuple(COLUMNS.index(name) for name in fields)
    return Source(axis.name, ring.place, places, definition(fields))


def silence(axis: AxisController) -> float:
    """Time (s) after which the drive has stopped by itself; sooner a new configuration would disturb its ramp."""
    wire = patient(axis.setup).file.drive.wire
    return max(wire.heartbeat_timeout, wire.rpdo_timeout) + _RAMP if isinstance(wire, Canopen) else 0.0


def ending(code: int) -> str:
    """An exit code in words."""
    return f"signal {-code}" if code < 0 else f"exit {code}"


class Companions:
    """The processes that live beside the real-time process and end with it: one real-time process after the other.

    What dies alone is started again.  A black box that waits for room on the disk is kept when the others end.
    """

    def __init__(self, axes: dict[str, AxisController], paths: ServicePaths, note: Note) -> None:
        self._axes, self._paths, self._note = axes, paths, note
        self._boxes: dict[str, Child] = {}
        self._lingering: list[tuple[str, Child]] = []  # black boxes of an earlier real-time process, and their axes
        self._waiting: set[Child] = set()  # black boxes that have said so
        self._stop_path: Child | None = None
        self._told = False  # the stop path, what the kernel refused the loop
        self._live: Child | None = None

    def spawn(self, alive: int, stop_socket: int) -> None:
        """Start all; `alive` is the pipe that the real-time process holds."""
        self._alive, self._stop_socket = alive, stop_socket
        self._stop_path, self._told = _start_stop_path(list(self._axes.values()), stop_socket, alive), False
        self._boxes = {name: self._box(name) for name in self._axes}
        if self._paths.foxglove:
            self._live = _start_foxglove(list(self._axes.values()), self._paths.foxglove, alive)

    def takes_stops(self, refused: list[str]) -> bool:
        """Whether the stop path is ready; then it has been told what the kernel `refused` the loop."""
        path = self._stop_path
        if path is not None and not self._told and path.readable(0.0) and path.line():
            path.send(refused)
            self._told = True
        return self._told

    def address(self) -> str:
        """Where Foxglove finds its server; empty where there is none."""
        return self._live.line() if self._live is not None else ""

    def look(self) -> None:
        """Hear the black boxes; start again what died while the loop lives."""
        for name, box in self._boxes.items():
            self._hear(name, box)
            if box.ended is not None:
                self._note(name, "blackbox_died", f"the black box ended ({box.ended}); a new one was started")
                box.wait()  # closes its pipes
                self._boxes[name] = self._box(name)
        self._lingering = [(name, box) for name, box in self._lingering if not self._over(name, box)]
        if self._stop_path is not None and self._stop_path.ended is not None:
            self._note("", "stop_path_died", f"the stop path ended ({self._stop_path.ended}); a new one was started")
            self._stop_path.wait()
            self._stop_path = _start_stop_path(list(self._axes.values()), self._stop_socket, self._alive)
            self._told = False
        if self._live is not None and self._live.ended is not None:
            self._live.wait()
            self._live = None
            self._note(
                "", "foxglove_ended", "Foxglove's server ended; see the messages above, then restart the service"
            )

    def leaving(self) -> list[tuple[Child, float]]:
        """The real-time process is gone: those that end with it, and how long (s) each may take."""
        for name, box in self._boxes.items():
            self._hear(name, box)
        going = [box for box in self._boxes.values() if box not in self._waiting]
        self._lingering += [(name, box) for name, box in self._boxes.items() if box in self._waiting]
        others = [child for child in (self._stop_path, self._live) if child is not None]
        self._boxes, self._stop_path, self._live = {}, None, None
        return [*((box, _WRITE) for box in going), *((child, _LEAVE) for child in others)]

    def last(self) -> list[tuple[Child, float]]:
        """The service ends: black boxes that still wait for room try once more."""
        return [(box, _WRITE) for _, box in self._lingering]

    def _box(self, name: str) -> Child:
        return _start_black_box(self._axes[name], self._paths.state, self._alive)

    def _over(self, name: str, box: Child) -> bool:
        """Whether a black box that waited for room has ended."""
        self._hear(name, box)
        if box.ended is None:
            return False
        box.wait()
        self._waiting.discard(box)
        return True

    def _hear(self, name: str, box: Child) -> None:
        """What a black box has to say: lines of JSON, behind one that only says that it is ready."""
        while box.readable(0.0) and (line := box.line()):
            if line.startswith("{"):
                said = json.loads(line)
                (self._waiting.add if said["waiting"] else self._waiting.discard)(box)
                self._note(name, said["fault"], said["words"])
