"""The orders of the service's processes at their start, and the meaning of their exit codes."""

from __future__ import annotations

from pathlib import Path

from stagectl.drives.drive import Canopen
from stagectl.realtime.axes import Post
from stagectl.service import job_from_stage
from stagectl.service.axis_controller import COLUMNS, AxisController
from stagectl.service.black_box import BlackBoxOrder
from stagectl.service.child_process import Child, start
from stagectl.service.confined import rank
from stagectl.service.foxglove_live import Feed, Source
from stagectl.service.limits import LOOP
from stagectl.service.recordings import about
from stagectl.service.stop_path import StopPost
from stagectl.service.virtual_timeouts import patient

_RAMP = 0.5  # s that a drive's own ramp may take


def post(axes: list[AxisController], coupled: bool) -> Post:
    """The order of the real-time process."""
    first = axes[0]
    return job_from_stage.post(first.setup, [axis.orders() for axis in axes], first.ring, coupled)


def start_black_box(axis: AxisController, state: Path, alive: int) -> Child:
    """Start the black box of this axis; `alive` is the pipe that the real-time process holds."""
    meta = about(axis, "black box")
    folder = str(state / "blackbox" / axis.name)
    ring, board = axis.ring, axis.board.descriptor
    child = start("stagectl.service.black_box", (ring.descriptor, board, alive), "interpreted")
    dt, faults = axis.setup.dt, int(axis.status.faults)
    child.send(
        BlackBoxOrder(ring.descriptor, ring.width, ring.capacity, board, alive, folder, meta, COLUMNS, dt, faults)
    )
    return child


def start_stop_path(axes: list[AxisController], socket: int, alive: int) -> Child:
    """Start the stop path of these axes on its bound `socket` (descriptors)."""
    boards = tuple(axis.board.descriptor for axis in axes)
    child = start("stagectl.service.stop_path", (socket, alive, *boards), "interpreted")
    rank(child.pid, LOOP)
    child.send(StopPost(socket, alive, tuple((axis.shown, axis.board.descriptor) for axis in axes)))
    return child


def start_foxglove(axes: list[AxisController], address: tuple[str, int], alive: int) -> Child:
    """Start Foxglove's server for these axes at `address`."""
    child = start("stagectl.service.foxglove_live", (*(axis.ring.descriptor for axis in axes), alive), "interpreted")
    child.send(Feed(tuple(_source(axis) for axis in axes), *address, alive))
    return child


def _source(axis: AxisController) -> Source:
    from stagectl.recording.exports import described, units_of  # large imports, seldom needed
    from stagectl.recording.mcap_log import definition

    ring, fields = axis.ring, described(units_of(COLUMNS, axis.setup.file.axis.kind))
    places = tuple(COLUMNS.index(name) for name in fields)
    return Source(axis.name, ring.descriptor, ring.width, ring.capacity, places, definition(fields))


def silence(axis: AxisController) -> float:
    """Time (s) after which the drive has stopped by itself; sooner a new configuration would disturb its ramp."""
    wire = patient(axis.setup).file.drive.wire
    return max(wire.heartbeat_timeout, wire.rpdo_timeout) + _RAMP if isinstance(wire, Canopen) else 0.0


def ending(code: int) -> str:
    """An exit code in words."""
    return f"signal {-code}" if code < 0 else f"exit {code}"
