"""CAN frames: their format, their length on the wire, and the protocol of a bus that carries them.

A frame is the kernel's 16-byte ``struct can_frame`` everywhere: identifier, length, eight bytes.  Only the bus that
carries it differs, so the cyclic path is the same code on a machine with CAN and on one without.
"""

import select
import socket
import struct
import time
from typing import Protocol

from stagectl.drives.drive import DriveError

FRAME = struct.Struct("<IB3x8s")  # struct can_frame of linux/can.h, little-endian
REMOTE = 0x4000_0000  # flag in the identifier: remote transmission request
EXTENDED = 0x8000_0000  # flag in the identifier: 29 bits

# Identifiers of the predefined connection set (CiA 301, 7.3.5), less the id of the node where a frame has one.
NMT, SYNC, EMERGENCY, TPDO, RPDO = 0x000, 0x080, 0x080, 0x180, 0x200
SDO_ANSWER, SDO_REQUEST, HEARTBEAT = 0x580, 0x600, 0x700
MASTER = 127  # our own node id, as the drive's heartbeat consumer (0x1016) knows it


class BusError(DriveError):
    """A bus that cannot be opened; the message names the fix."""


class Bus(Protocol):
    """A way for raw 16-byte frames, without threads."""

    def send(self, frame: bytes) -> None:
        """Queue one frame; never blocks.  Raises OSError where the bus itself failed."""

    def receive(self, timeout: float) -> bytes | None:
        """Next frame of anybody else, or None after `timeout` seconds.  Raises OSError."""

    def close(self) -> None:
        """Leave the bus; safe to call twice."""


def frame(identifier: int, data: bytes = b"") -> bytes:
    """The 16 bytes of a data frame with up to eight bytes of `data`."""
    return FRAME.pack(identifier, len(data), data)


def parse(raw: bytes) -> tuple[int, bytes]:
    """Identifier (with the kernel's flags) and data of a frame."""
    identifier, length, data = FRAME.unpack(raw)
    return identifier, data[: min(length, 8)]


class SocketBus:
    """Frames read from one datagram socket, whatever its family."""

    def __init__(self, reader: socket.socket) -> None:
        self._reader = reader
        self._readable, self._poll = [reader.fileno()], select.poll()
        self._poll.register(reader, select.POLLIN)
        self.malformed = 0  # datagrams that were no frame

    def receive(self, timeout: float) -> bytes | None:
        """Next frame, or None after `timeout` seconds."""
        # select rather than a socket time-out: microseconds instead of milliseconds, and no exception if idle
        if timeout <= 0.0 and not self._poll.poll(0):
            return None
        deadline = 0.0
        while select.select(self._readable, (), (), max(timeout, 0.0))[0]:
            raw = self._reader.recv(FRAME.size + 1)
            if len(raw) == FRAME.size:
                return raw
            self.malformed += 1
            deadline = deadline or time.monotonic() + timeout  # the clock is read only where something is wrong
            timeout = deadline - time.monotonic()
        return None

    def fileno(self) -> int:
        """Descriptor that becomes readable with the next frame."""
        return self._reader.fileno()
