"""The embedded bus of a machine without CAN: Unix datagram sockets in a folder.

It has no hub.  A channel is a folder; every participant binds a socket in it and sends each frame to every other one::

    $XDG_RUNTIME_DIR/stagectl/stage/   4711-0-9f3a01.can  <--.   frames
                                       4712-0-02c84d.can  <--+-- 4713-0-77b1c0.can
                                       4713-0-77b1c0.can

Unlike a real bus it has no arbitration, no bit timing and no order between different senders.
"""

import errno
import itertools
import os
import socket
import stat
import time
from pathlib import Path

from stagectl.drives.bus.frames import BusError, SocketBus
from stagectl.drives.limits import MTIME_SETTLED
from stagectl.runtime_folder import runtime_folder, short_name

_SUFFIX = ".can"  # of the sockets in a channel's folder; other files there are not touched
_QUEUE_FULL = (errno.EAGAIN, errno.ENOBUFS)
_serial = itertools.count()


class Embedded(SocketBus):
    """The bus of a machine without CAN: peers in a folder, a Unix datagram socket each."""

    def __init__(self, channel: str) -> None:
        """Join `channel`, a name or an absolute folder.  Raises BusError."""
        self.folder = _private(folder_of(channel))
        self._watched = os.fspath(self.folder)  # as text: every frame checks its mtime
        self._path = self.folder / f"{os.getpid()}-{next(_serial)}-{os.urandom(3).hex()}{_SUFFIX}"
        reader = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            with short_name(self._path) as name:
                reader.bind(name)
        except OSError as error:
            reader.close()
            raise BusError(
                f"channel = {channel!r}: no entry to {self.folder}: {error.strerror}", place=channel
            ) from error
        super().__init__(reader)
        self._peers: dict[str, socket.socket] = {}
        self._listed = -1  # mtime of the folder when the peers were listed, ns
        self.lost = 0  # frames that a peer did not take, because its queue was full

    def send(self, frame: bytes) -> None:
        """One frame to every other participant; a full reader loses it, a dead one is removed."""
        if os.stat(self._watched).st_mtime_ns != self._listed:
            self._list_peers()
        for name, peer in list(self._peers.items()):
            try:
                peer.send(frame)
            except OSError as error:
                if error.errno in _QUEUE_FULL:
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
        self._listed = changed if time.time_ns() - changed > MTIME_SETTLED else -1

    def _connect(self, name: str) -> None:
        # One socket a peer: unread frames fill the sender's buffer; one sleeper must not silence the rest.
        peer = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        peer.setblocking(False)
        self._peers[name] = peer
        try:
            with short_name(self.folder / name) as short:
                peer.connect(short)
        except OSError as error:
            self._remove(name, error)

    def _remove(self, name: str, error: OSError) -> None:
        """Forget a peer that no longer listens; what a killed one left in the folder is cleared away."""
        self._peers.pop(name).close()
        if isinstance(error, ConnectionRefusedError) and is_socket(self.folder / name):
            (self.folder / name).unlink(missing_ok=True)


def is_socket(path: Path) -> bool:
    """Whether this very entry is a socket: nothing else is ever removed."""
    try:
        return stat.S_ISSOCK(path.lstat().st_mode)
    except OSError:
        return False


def folder_of(channel: str) -> Path:
    """Folder of an embedded channel: a name below the user's run-time folder, an absolute path as it is."""
    if Path(channel).is_absolute():
        return Path(channel)
    if not channel or "/" in channel or channel.startswith("."):
        raise BusError(f"channel = {channel!r}; must be a name without '/' or an absolute folder", place=channel)
    return _private(runtime_folder()) / channel


def _private(folder: Path) -> Path:
    """Create `folder` for this user only; refuse one of somebody else, who could send commands through it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        owner = folder.stat().st_uid
    except OSError as error:
        raise BusError(
            f"channel folder {folder}: {error.strerror}; choose one you can write to", place=str(folder)
        ) from error
    if owner != os.getuid():
        raise BusError(
            f"channel folder {folder} belongs to user id {owner}; must be {os.getuid()}; choose"
            " another channel, or run both ends as one user",
            place=str(folder),
            value=owner,
        )
    return folder
