"""Real CAN: a SocketCAN interface of the kernel, or any interface of python-can; and every bus by its name."""

from __future__ import annotations

import errno
import socket
import time
from typing import Any

from stagectl.drives.bus.embedded import Embedded
from stagectl.drives.bus.frames import EXTENDED, REMOTE, Bus, BusError, SocketBus, frame, parse
from stagectl.drives.limits import SLCAN_OPENING_TIME, SLCAN_READ_TIME


def open_bus(interface: str, channel: str, bitrate: float) -> Bus:
    """Join a bus by the name of its interface: ``embedded``, ``socketcan`` or one of python-can's.

    Raises BusError with the fix where that is not possible.
    """
    if interface in ("embedded", "stagectl"):  # the second is its name among python-can's interfaces
        return Embedded(channel)
    if interface == "socketcan":
        return SocketCan(channel)
    return PythonCan(interface, channel, bitrate)


class SocketCan(SocketBus):
    """A CAN interface of the Linux kernel; its bit rate is set with ``ip link``, not here."""

    def __init__(self, channel: str) -> None:
        """Bind to the interface `channel`.  Raises BusError naming the command that brings it up."""
        try:
            raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        except (AttributeError, OSError) as error:
            raise BusError(
                f"interface = socketcan: this kernel offers no CAN sockets ({error});"
                " run 'sudo modprobe can_raw', or use interface: embedded",
                place="socketcan",
            ) from error
        try:
            raw.bind((channel,))
            raw.setblocking(False)
        except OSError as error:
            raw.close()
            raise BusError(
                f"channel = {channel!r}: {error.strerror}; bring the interface up with"
                f" 'sudo ip link set {channel} up type can bitrate 1000000' (see 'ip -details link')",
                place=channel,
            ) from error
        super().__init__(raw)

    def send(self, frame: bytes) -> None:
        """Queue one frame in the kernel; OSError where its queue is full or the interface is down."""
        self._reader.send(frame)

    def close(self) -> None:
        """Leave the interface."""
        self._reader.close()


class PythonCan:
    """Any interface of python-can, at a lower rate; some of them start threads of their own."""

    def __init__(self, interface: str, channel: str, bitrate: float) -> None:
        """Open it by python-can's names.  Raises BusError."""
        if interface == "udp_multicast":
            raise BusError(
                "interface = udp_multicast: its frames leave this machine by the default route, and anybody"
                " there could move the axis; use interface: embedded on one machine",
                place=interface,
            )
        import can  # a tenth of a second: only where it is asked for

        self._can = can
        try:
            # slcan reads its line with a time-out of its own, which a look at an empty queue would wait for
            line: Any = (
                {"timeout": SLCAN_READ_TIME, "sleep_after_open": SLCAN_OPENING_TIME} if interface == "slcan" else {}
            )
            self._bus: Any = can.Bus(interface=interface, channel=channel, bitrate=round(bitrate), **line)
        except (can.CanError, ImportError, OSError, ValueError) as error:
            raise BusError(
                f"interface = {interface}, channel = {channel!r}: {error}; 'python -m can.viewer -i {interface}"
                f" -c {channel}' shows whether python-can reaches it",
                place=interface,
            ) from error

    def send(self, frame: bytes) -> None:
        """One data frame through python-can."""
        identifier, data = parse(frame)
        message = self._can.Message(arbitration_id=identifier & 0x1FFF_FFFF, data=data, is_extended_id=False)
        try:
            self._bus.send(message)
        except self._can.CanError as error:
            raise OSError(errno.EIO, str(error)) from error

    def receive(self, timeout: float) -> bytes | None:
        """Next data frame, or None."""
        deadline = time.monotonic() + timeout
        while True:
            try:
                message = self._bus.recv(max(deadline - time.monotonic(), 0.0))
            except self._can.CanError as error:
                raise OSError(errno.EIO, str(error)) from error
            if message is None:
                return None
            if not (message.is_error_frame or message.is_fd):
                break
        flags = EXTENDED * message.is_extended_id | REMOTE * message.is_remote_frame
        return frame(message.arbitration_id | flags, bytes(message.data))

    def close(self) -> None:
        """Shut python-can's bus down; it may be called twice."""
        self._bus.shutdown()
