"""What the service's processes are told as they start, and what their ends mean."""

from __future__ import annotations

from pathlib import Path

from stagectl.drives.drive import Canopen
from stagectl.realtime.axes import Post
from stagectl.service import job_from_stage
from stagectl.service.axis_controller import COLUMNS, Manned
from stagectl.service.black_box import Box
from stagectl.service.child_process import Child, start
from stagectl.service.foxglove_live import Feed, Source
from stagectl.service.recordings import about
from stagectl.service.virtual_timeouts import patient

_RAMP = 0.5  # s that a drive's own ramp may take


def post(axes: list[Manned], coupled: bool) -> Post:
    """The order of the real-time process."""
    first = axes[0]
    return job_from_stage.post(first.setup, [axis.orders() for axis in axes], first.ring, coupled)


def box(axis: Manned, state: Path, alive: int) -> Child:
    """A black box of this axis, started; `alive` is the pipe that the real-time process holds."""
    meta = about(axis, "black box")
    folder = str(state / "blackbox" / axis.name)
    ring, board = axis.ring, axis.board.descriptor
    found = start("stagectl.service.black_box", (ring.descriptor, board, alive), "interpreted")
    dt, faults = axis.setup.dt, int(axis.status.faults)
    found.send(Box(ring.descriptor, ring.width, ring.capacity, board, alive, folder, meta, COLUMNS, dt, faults))
    return found


def foxglove(axes: list[Manned], address: tuple[str, int], alive: int) -> Child:
    """Foxglove's server for these axes at `address`, started."""
    found = start("stagectl.service.foxglove_live", (*(axis.ring.descriptor for axis in axes), alive), "interpreted")
    found.send(Feed(tuple(_source(axis) for axis in axes), *address, alive))
    return found


def _source(axis: Manned) -> Source:
    from stagectl.recording.exports import described, units_of  # large, and seldom asked for
    from stagectl.recording.mcap_log import definition

    ring, fields = axis.ring, described(units_of(COLUMNS, axis.setup.file.axis.kind))
    places = tuple(COLUMNS.index(name) for name in fields)
    return Source(axis.name, ring.descriptor, ring.width, ring.capacity, places, definition(fields))


def silence(axis: Manned) -> float:
    """Time (s) after which the drive has stopped by itself; sooner a new configuration would disturb its ramp."""
    wire = patient(axis.setup).file.drive.wire
    return max(wire.heartbeat_timeout, wire.rpdo_timeout) + _RAMP if isinstance(wire, Canopen) else 0.0


def ending(code: int) -> str:
    """An exit code in words."""
    return f"signal {-code}" if code < 0 else f"exit {code}"
