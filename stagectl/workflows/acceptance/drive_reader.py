"""The drive without its loop: what it reports over SDO while nobody, or a stopped process, controls it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import NamedTuple

from stagectl.drives.bus.frames import Bus, frame
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.object_access import PlainSdo
from stagectl.drives.drive import Canopen, DriveError
from stagectl.workflows.acceptance.limits import LOOK, PATIENCE, STILL_COUNTS, STILL_TIME

_OFF = cia402.DeviceCommand.DISABLE_VOLTAGE.controlword.to_bytes(2, "little")


class Stop(NamedTuple):
    """How an axis came to rest by itself."""

    stands: bool
    without_power: bool  # not in Operation enabled any more
    distance: float  # rad | m, the farthest from where it was left
    time: float  # s until it stood
    state: DriveState
    path: list[tuple[float, float]]  # s from the begin of the watch, and position (rad | m)


class DriveReader(PlainSdo):
    """Objects of one drive; `step` (rad | m) is one count of its position."""

    def __init__(self, wire: Canopen, bus: Bus, step: float) -> None:
        super().__init__(wire, bus)
        self._bus, self._step = bus, step

    def position(self) -> float:
        """Position (rad | m), as the drive counts.  Raises DriveError."""
        counts = self.number(cia402.POSITION, signed=True)
        if counts is None:
            raise DriveError(
                f"node {self.node}: object 0x6064 (position) cannot be read: the stop could not be measured",
                node=self.node,
                object_key=cia402.POSITION << 8,
            )
        return counts * self._step

    def state(self) -> DriveState:
        """State of the power drive system."""
        return cia402.state(self.number(cia402.STATUSWORD) or 0)

    def watch_stop(self, start: float, timeout: float, farthest: float) -> Stop:
        """Watch the axis, left at `start` (rad | m), come to rest within `timeout` (s) and PATIENCE.

        One that does not, or goes `farthest` (rad | m) from there, loses its power.
        """
        begun = time.monotonic()
        still, since, distance = self.position(), begun, 0.0
        path: list[tuple[float, float]] = []
        while True:
            here, state, now = self.position(), self.state(), time.monotonic()
            distance = max(distance, abs(here - start))
            path.append((now - begun, here))
            if abs(here - still) > STILL_COUNTS * self._step:
                still, since = here, now
            stands, without = now - since > STILL_TIME, state is not DriveState.OPERATION_ENABLED
            if stands and without:
                return Stop(True, True, distance, max(since - begun, 0.0), state, path)
            if now - begun > timeout + PATIENCE or distance > farthest:
                self.cut_power()
                return Stop(stands, without, distance, now - begun, state, path)
            time.sleep(LOOK)

    def cut_power(self) -> None:
        """Disable voltage, by SDO and NMT; never raises."""
        with contextlib.suppress(DriveError, OSError):
            self._bus.send(frame(0, bytes([cia402.NMT_PRE_OPERATIONAL, self.node])))
            self.write(_OFF, cia402.CONTROLWORD)


@contextlib.contextmanager
def reading(wire: Canopen, step: float) -> Iterator[DriveReader]:
    """A reader on a bus of its own; nothing is sent but what is asked for."""
    with contextlib.closing(open_bus(wire.interface, wire.channel, wire.bitrate)) as bus:
        yield DriveReader(wire, bus, step)
