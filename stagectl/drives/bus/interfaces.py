"""Real CAN: a SocketCAN interface of the kernel, or an interface of python-can; and every bus by its name."""

import contextlib
import errno
import logging
import socket
import time
from collections.abc import Iterator
from typing import Any

from stagectl.drives.bus.embedded import Embedded
from stagectl.drives.bus.frames import EXTENDED, REMOTE, Bus, BusError, SocketBus, frame, parse
from stagectl.drives.drive import offered
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


@contextlib.contextmanager
def _without_log(name: str) -> Iterator[None]:
    """Keep a library's log off the terminal: the error that follows says it once."""
    log = logging.getLogger(name)
    before = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        log.setLevel(before)


class PythonCan:
    """An interface of python-can that needs no more than a channel and a bit rate; some start threads of their own."""

    def __init__(self, interface: str, channel: str, bitrate: float) -> None:
        """Open it by python-can's names.  Raises BusError."""
        import can  # a tenth of a second: only where it is asked for

        self._can = can
        try:
            line = {"channel": channel, "bitrate": round(bitrate), **_more(interface, channel)}
            with _without_log("can"):
                self._bus: Any = can.Bus(interface=interface, **line)
        except Exception as error:  # each driver has its own: a NameError where Kvaser's library is missing
            reason = "its driver is not installed" if isinstance(error, NameError) else str(error).rstrip(".")
            raise BusError(
                f"interface = {interface}, channel = {channel!r}: {reason}; 'python -m can.viewer -i {interface}"
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


def _more(interface: str, channel: str) -> dict[str, Any]:
    """What an interface takes beside channel and bit rate, or in their place."""
    if interface == "slcan":  # it reads its line with a time-out, which a look at an empty queue would wait for
        return {"timeout": SLCAN_READ_TIME, "sleep_after_open": SLCAN_OPENING_TIME}
    if interface == "socketcand" and (place := offered(channel)):
        return {**place._asdict(), "bitrate": None, "tcp_tune": True}
    return {}
