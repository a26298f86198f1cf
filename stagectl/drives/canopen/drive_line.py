"""One drive's frames on the bus beside the command: its answer to SYNC, and requests that wait for no answer."""

from __future__ import annotations

import contextlib
import struct

from stagectl.drives.bus.frames import NMT, SDO_REQUEST, Bus, frame
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.operation_watch import MODE_REQUEST
from stagectl.drives.canopen.reports import Reports
from stagectl.drives.limits import BACKLOG, MODE_PERIOD

_WRITE = struct.Struct("<BHBI")  # SDO: expedited download
_SIZES = {cia402.MODE: 0x2F, cia402.CONTROLWORD: 0x2B}  # SDO: one byte, two bytes
_LONG = 0x23  # four bytes


class DriveLine:
    """The frames of one drive; `reports` gets each that is no answer to SYNC."""

    def __init__(self, bus: Bus, node: int, head: bytes, reports: Reports) -> None:
        """`head` is how its answer to SYNC begins."""
        self._bus, self._node, self._head, self._now, self._take = bus, node, head, reports.now, reports.take
        self._mode_due = 0.0  # s, when the mode is asked for again

    def answer(self, timeout: float) -> bytes | None:
        """The answer to SYNC, reading all other frames before it; None after `timeout` seconds."""
        receive, head = self._bus.receive, self._head
        deadline = self._now() + timeout  # before the first frame: what comes in between must not prolong the wait
        raw = receive(timeout)
        if raw is None or raw[:5] == head:
            return raw
        while raw is None or raw[:5] != head:
            if raw is not None:
                self._take(raw)
            left = deadline - self._now()
            if left <= 0.0:
                return None
            raw = receive(left)
        return raw

    def drain(self) -> None:
        """Clear the receive queue: a late or doubled answer must not be taken for the next one."""
        for _ in range(BACKLOG):
            raw = self._bus.receive(0.0)
            if raw is None:
                break
            self._take(raw)

    def manage(self, command: int) -> None:
        """Send an NMT command to the drive (CiA 301)."""
        with contextlib.suppress(OSError):
            self._bus.send(frame(NMT, bytes([command, self._node])))

    def write(self, index: int, subindex: int, value: int) -> None:
        """Write an object by SDO without waiting for the answer."""
        with contextlib.suppress(OSError):
            self._bus.send(
                frame(SDO_REQUEST + self._node, _WRITE.pack(_SIZES.get(index, _LONG), index, subindex, value))
            )

    def set_brake(self, engaged: bool) -> None:
        """Set or release a brake at the drive's digital outputs, without waiting for the answer."""
        self.write(cia402.DIGITAL_OUTPUTS, 1, cia402.BRAKE_BIT * engaged)

    def ask_for_mode(self, now: float) -> None:
        """Ask for 0x6061 by SDO each MODE_PERIOD.  Raises OSError."""
        if now >= self._mode_due:
            self._mode_due = now + MODE_PERIOD
            self._bus.send(frame(SDO_REQUEST + self._node, MODE_REQUEST))
