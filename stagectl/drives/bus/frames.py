"""CAN frames over SocketCAN, over Unix datagram sockets (the embedded bus), or over any python-can interface.

A frame is the kernel's 16-byte ``struct can_frame`` everywhere: identifier, length, eight bytes.  Only what
carries it differs, so the cyclic path is the same code on a machine with CAN and on one without.

The embedded bus has no hub: a channel is a folder, every participant binds a socket in it and sends each
frame to every other one::

    $XDG_RUNTIME_DIR/stagectl/stage/   4711-0-9f3a01.can  <--.   frames
                                       4712-0-02c84d.can  <--+-- 4713-0-77b1c0.can
                                       4713-0-77b1c0.can

Unlike a real bus it has no arbitration, no bit timing and no order between different senders.
"""

from __future__ import annotations

import errno
import itertools
import os
import select
import socket
import struct
import tempfile
import time
from pathlib import Path
from typing import Any, Protocol

from stagectl.drives.drive import DriveError

FRAME = struct.Struct("<IB3x8s")  # struct can_frame of linux/can.h, little-endian
REMOTE = 0x4000_0000  # flag in the identifier: remote transmission request
EXTENDED = 0x8000_0000  # flag in the identifier: 29 bits
_PATH_LIMIT = 107  # sun_path of AF_UNIX, without its closing zero
_MTIME_SETTLED = 100_000_000  # ns after which a folder's mtime can no longer hide a second change
_SUFFIX = ".can"  # of the sockets in a channel's folder; nothing else there is touched
_FULL = (errno.EAGAIN, errno.ENOBUFS)
_serial = itertools.count()


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


def open_bus(interface: str, channel: str, bitrate: float) -> Bus:
    """Join a bus by the name of its interface: ``embedded``, ``socketcan`` or one of python-can's.

    Raises BusError with the fix where that is not possible.
    """
    if interface in ("embedded", "stagectl"):  # the second is its name among python-can's interfaces
        return Embedded(channel)
    if interface == "socketcan":
        return SocketCan(channel)
    return PythonCan(interface, channel, bitrate)


class _SocketBus:
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


class Embedded(_SocketBus):
    """The bus of a machine without CAN: peers in a folder, a Unix datagram socket each."""

    def __init__(self, channel: str) -> None:
        """Join `channel`, a name or an absolute folder.  Raises BusError."""
        self.folder = _private(folder_of(channel))
        self._looked_at = os.fspath(self.folder)  # as text: each frame looks at it
        self._path = self.folder / f"{os.getpid()}-{next(_serial)}-{os.urandom(3).hex()}{_SUFFIX}"
        if len(os.fsencode(self._path)) > _PATH_LIMIT:
            raise BusError(
                f"channel = {channel!r}: the socket's path {self._path} has {len(os.fsencode(self._path))} bytes;"
                f" must lie in [1, {_PATH_LIMIT}] (AF_UNIX); choose a shorter channel name or folder"
            )
        reader = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            reader.bind(os.fspath(self._path))
        except OSError as error:
            reader.close()
            raise BusError(f"channel = {channel!r}: no entry to {self.folder}: {error.strerror}") from error
        super().__init__(reader)
        self._peers: dict[str, socket.socket] = {}
        self._listed = -1  # mtime of the folder when the peers were listed, ns
        self.lost = 0  # frames that a peer did not take, because its queue was full

    def send(self, frame: bytes) -> None:
        """One frame to every other participant; a full reader loses it, a dead one is removed."""
        if os.stat(self._looked_at).st_mtime_ns != self._listed:
            self._list_peers()
        for name, peer in list(self._peers.items()):
            try:
                peer.send(frame)
            except OSError as error:
                if error.errno in _FULL:
                    self.lost += 1
                else:
                    self._remove(name, error)

    def close(self) -> None:
        """Leave the folder."""
        self._path.unlink(missing_ok=True)
        for peer in self._peers.values():
            peer.close()
        self._peers.clear()
        self._reader.close()

    def _list_peers(self) -> None:
        changed = os.stat(self.folder).st_mtime_ns
        present = {name for name in os.listdir(self.folder) if name.endswith(_SUFFIX)} - {self._path.name}
        for name in self._peers.keys() - present:
            self._peers.pop(name).close()
        for name in present - self._peers.keys():
            self._connect(name)
        # Two changes within one tick of the file system's clock share an mtime: list again until it is past.
        self._listed = changed if time.time_ns() - changed > _MTIME_SETTLED else -1

    def _connect(self, name: str) -> None:
        # One socket a peer: unread frames fill the sender's buffer; one sleeper must not silence the rest.
        peer = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        peer.setblocking(False)
        self._peers[name] = peer
        try:
            peer.connect(os.fspath(self.folder / name))
        except OSError as error:
            self._remove(name, error)

    def _remove(self, name: str, error: OSError) -> None:
        """Forget a peer that no longer listens; what a killed one left in the folder is cleared away."""
        self._peers.pop(name).close()
        if isinstance(error, ConnectionRefusedError):
            (self.folder / name).unlink(missing_ok=True)


class SocketCan(_SocketBus):
    """A CAN interface of the Linux kernel; its bit rate is set with ``ip link``, not here."""

    def __init__(self, channel: str) -> None:
        """Bind to the interface `channel`.  Raises BusError naming the command that brings it up."""
        try:
            raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        except (AttributeError, OSError) as error:
            raise BusError(
                f"interface = socketcan: this kernel offers no CAN sockets ({error});"
                " run 'sudo modprobe can_raw', or use interface: embedded"
            ) from error
        try:
            raw.bind((channel,))
            raw.setblocking(False)
        except OSError as error:
            raw.close()
            raise BusError(
                f"channel = {channel!r}: {error.strerror}; bring the interface up with"
                f" 'sudo ip link set {channel} up type can bitrate 1000000' (see 'ip -details link')"
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
                " there could move the axis; use interface: embedded on one machine"
            )
        import can  # a tenth of a second: only where it is asked for

        self._can = can
        try:
            # slcan reads its line with a time-out of its own, which a look at an empty queue would wait for
            line: Any = {"timeout": 0.0002, "sleep_after_open": 0.1} if interface == "slcan" else {}
            self._bus: Any = can.Bus(interface=interface, channel=channel, bitrate=round(bitrate), **line)
        except (can.CanError, ImportError, OSError, ValueError) as error:
            raise BusError(
                f"interface = {interface}, channel = {channel!r}: {error}; 'python -m can.viewer -i {interface}"
                f" -c {channel}' shows whether python-can reaches it"
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


def folder_of(channel: str) -> Path:
    """Folder of an embedded channel: a name below the user's run-time folder, an absolute path as it is."""
    if Path(channel).is_absolute():
        return Path(channel)
    if not channel or "/" in channel or channel.startswith("."):
        raise BusError(f"channel = {channel!r}; must be a name without '/' or an absolute folder")
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    base = Path(runtime) / "stagectl" if runtime else Path(tempfile.gettempdir()) / f"stagectl-{os.getuid()}"
    return _private(base) / channel


def _private(folder: Path) -> Path:
    """Create `folder` for this user only; refuse one of somebody else, who could send commands through it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        owner = folder.stat().st_uid
    except OSError as error:
        raise BusError(f"channel folder {folder}: {error.strerror}; choose one you can write to") from error
    if owner != os.getuid():
        raise BusError(
            f"channel folder {folder} belongs to user id {owner}; must be {os.getuid()}; choose"
            " another channel,"
            " or run both ends as one user"
        )
    return folder
