"""The service's processes: their orders at their start, who keeps them alive, and the meaning of their exit codes."""

import asyncio
import json
from collections.abc import Callable

from stagectl.drives.drive import Canopen
from stagectl.service.axis_controller import COLUMNS, AxisController
from stagectl.service.black_box import BlackBoxOrder
from stagectl.service.child_process import Child, rank, start
from stagectl.service.foxglove_live import Feed, Source
from stagectl.service.limits import AT_ONCE, LOOP
from stagectl.service.recordings import about
from stagectl.service.stop_link import ServicePaths
from stagectl.service.stop_path import StopPost
from stagectl.service.virtual_timeouts import patient

_RAMP = 0.5  # s that a drive's own ramp may take
_LEAVE, _WRITE = 15.0, 10.0  # s that a process, and a black box, may take to end
Note = Callable[[str, str, str], None]  # axis, fault, words


async def heard_of(exit_code: int) -> str:
    """How a process ended; where it did in order it was told to, and so is the service in a moment, which then ends."""
    if exit_code == 0:
        await asyncio.sleep(AT_ONCE)
    return f"signal {-exit_code}" if exit_code < 0 else f"exit {exit_code}"


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


def _over(child: Child) -> bool:
    """Whether it has ended; then its pipes are closed, too."""
    if child.ended is None:
        return False
    child.wait()
    return True


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
        self._start_stop_path()
        self._boxes = {name: self._box(axis) for name, axis in self._axes.items()}
        if self._paths.foxglove:
            rings = (axis.ring.descriptor for axis in self._axes.values())
            self._live = start("stagectl.service.foxglove_live", (*rings, alive), "interpreted")
            self._live.send(Feed(tuple(map(_source, self._axes.values())), *self._paths.foxglove, alive))

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
        for name, box in [*self._boxes.items(), *self._lingering]:
            self._hear(name, box)
        for name, box in self._boxes.items():
            if _over(box):
                self._note(name, "blackbox_died", f"the black box ended ({box.ended}); a new one was started")
                self._boxes[name] = self._box(self._axes[name])
        self._lingering = [(name, box) for name, box in self._lingering if not _over(box)]
        self._waiting = {box for box in self._waiting if box.ended is None}
        if (path := self._stop_path) is not None and _over(path):
            self._note("", "stop_path_died", f"the stop path ended ({path.ended}); a new one was started")
            self._start_stop_path()
        if self._live is not None and _over(self._live):
            self._live = None
            words = "Foxglove's server ended; see the messages above, then restart the service"
            self._note("", "foxglove_ended", words)

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

    def _box(self, axis: AxisController) -> Child:
        """Start the black box of an axis."""
        meta, folder = about(axis, "black box"), str(self._paths.state / "blackbox" / axis.name)
        ring, board, alive = axis.ring, axis.board.descriptor, self._alive
        child = start("stagectl.service.black_box", (ring.descriptor, board, alive), "interpreted")
        dt, faults = axis.setup.dt, int(axis.status.faults)
        child.send(BlackBoxOrder(ring.place, board, alive, folder, meta, COLUMNS, dt, faults))
        return child

    def _start_stop_path(self) -> None:
        """Start the stop path of the axes on its bound socket."""
        axes = tuple((axis.shown, axis.board.descriptor) for axis in self._axes.values())
        descriptors = (self._stop_socket, self._alive, *(board for _, board in axes))
        path = start("stagectl.service.stop_path", descriptors, "interpreted")
        rank(path.pid, LOOP)
        path.send(StopPost(self._stop_socket, self._alive, axes))
        self._stop_path, self._told = path, False

    def _hear(self, name: str, box: Child) -> None:
        """What a black box has to say: lines of JSON, behind one that only says that it is ready."""
        while box.readable(0.0) and (line := box.line()):
            if line.startswith("{"):
                said = json.loads(line)
                (self._waiting.add if said["waiting"] else self._waiting.discard)(box)
                self._note(name, said["fault"], said["words"])
