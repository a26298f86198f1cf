"""One master a channel on this computer: an advisory lock that the kernel releases when its process ends.

::

    <run-time folder>/stagectl-can0.lock       locked (flock) as long as a real-time process may drive something there
    {"pid": 4711, "command": "stagectl run ...", "stage": "bench.yaml", "since": "2026-11-23 16:40:38"}

The folder is shared by all users where there is such a one: a service and a person are different users.  The embedded
bus belongs to one user, so its lock lies in the bus' own folder.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shlex
import time
from pathlib import Path
from typing import NamedTuple

from stagectl.drives.bus.embedded import folder_of
from stagectl.drives.drive import Canopen, DriveError, Odrive
from stagectl.drives.limits import LOCK_NAME, LOCK_PATIENCE, LOCK_PAUSE, LOCK_TEXT
from stagectl.runtime_folder import runtime_folder

_SHARED = Path("/run/lock")  # FHS 3.0, 5.9: lock files of devices; on some systems for root alone
_FOR_ALL = 0o666  # a lock file that another user left must not keep us from locking it


class OtherMasterError(DriveError):
    """Another program controls this channel; nothing was sent.

    `pid`, `command` and `since` name one on this computer; `frames` and `period` (s) are what was heard of one that is
    only known by its frames.  None or empty: not known.
    """

    pid: int | None = None
    command = ""
    since = ""
    frames = 0
    period: float | None = None


class Holder(NamedTuple):
    """Who has a channel."""

    pid: int  # of the command, not of its real-time process
    command: str
    stage: str
    since: str  # local time


class ChannelLock:
    """The lock of one channel; held until `release` or the end of the process."""

    def __init__(self, wire: Canopen | Odrive, stage: str, pid: int | None = None) -> None:
        """Take it for the stage that is named `stage`, in the name of the command `pid`; None: of this process.

        Raises OtherMasterError where another process has it, and DriveError where it cannot be taken.
        """
        path = lock_path(wire)
        self._descriptor = _opened(path)
        if not _locks(self._descriptor):
            other = _read(self._descriptor)
            self.release()
            raise _refusal(wire, other)
        _write(self._descriptor, _holder(pid or os.getpid(), stage))

    def release(self) -> None:
        """Give it back; safe to call twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def holder(wire: Canopen | Odrive) -> Holder | None:
    """Who has the channel of this wire; None where it is free.  Raises DriveError."""
    try:
        ChannelLock(wire, "").release()
    except OtherMasterError as error:
        return Holder(error.pid or 0, error.command, str(error.value or ""), error.since)
    return None


def lock_path(wire: Canopen | Odrive) -> Path:
    """The lock file of a channel; the same for each name of one serial port."""
    channel = wire.port if isinstance(wire, Odrive) else wire.channel
    if isinstance(wire, Canopen) and wire.interface in ("embedded", "stagectl"):
        folder = folder_of(channel)
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return folder / "master.lock"
    device = os.path.realpath(channel) if "/" in channel else channel
    shared = "/" in channel or (isinstance(wire, Canopen) and wire.interface == "socketcan")
    name = device if shared or not isinstance(wire, Canopen) else f"{wire.interface}-{device}"
    return _folder() / f"stagectl-{re.sub(r'[^A-Za-z0-9]+', '-', name).strip('-')[-LOCK_NAME:]}.lock"


def _folder() -> Path:
    """The folder for all users, else this user's own."""
    if os.access(_SHARED, os.W_OK | os.X_OK):
        return _SHARED
    folder = runtime_folder()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


def _opened(path: Path) -> int:
    """Without O_CREAT first: in a folder for all, the kernel refuses that for another user's file."""
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    try:
        with contextlib.suppress(FileNotFoundError):
            return os.open(path, flags)
        descriptor = os.open(path, flags | os.O_CREAT, _FOR_ALL)
        with contextlib.suppress(OSError):  # another process made it in this moment
            os.fchmod(descriptor, _FOR_ALL)
        return descriptor
    except OSError as error:
        raise DriveError(
            f"lock file {path}: {error.strerror}; without it two programs could drive one axis. Next: `ls -l {path}`,"
            " and remove it if it is no lock of stagectl",
            place=str(path),
        ) from error


def _locks(descriptor: int) -> bool:
    end = time.monotonic() + LOCK_PATIENCE
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > end:
                return False
            time.sleep(LOCK_PAUSE)
        else:
            return True


def _holder(pid: int, stage: str) -> Holder:
    return Holder(pid, _command(pid), stage, time.strftime("%Y-%m-%d %H:%M:%S"))


def _command(pid: int) -> str:
    """The command line of a process as a person types it."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")[:-1]
    except OSError:
        return ""
    python = [place for place, word in enumerate(words[:-1]) if word == "-m"]
    return shlex.join(words[python[0] + 1 :] if python else words)


def _write(descriptor: int, ourselves: Holder) -> None:
    with contextlib.suppress(OSError):  # a full disk: the lock holds without a name
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, json.dumps(ourselves._asdict()).encode(), 0)


def _read(descriptor: int) -> Holder:
    """What its holder says of itself; of another user, so nothing in it is believed to have a form."""
    try:
        said = json.loads(os.pread(descriptor, LOCK_TEXT, 0))
        pid, texts = int(said["pid"]), [_shown(said[name]) for name in Holder._fields[1:]]
    except (OSError, ValueError, KeyError, TypeError):
        return Holder(0, "", "", "")
    return Holder(pid, *texts)


def _shown(value: object) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in str(value))


def _refusal(wire: Canopen | Odrive, other: Holder) -> OtherMasterError:
    """The error that names the other."""
    channel = wire.port if isinstance(wire, Odrive) else wire.channel
    who = (
        f"process {other.pid} (`{other.command}`, stage {other.stage}) since {other.since}" if other.pid else "unknown"
    )
    error = OtherMasterError(
        f"another master has {channel}: {who}; one channel has one master. Nothing was sent. Next: end that program, or"
        " give it this axis, too",
        place=channel,
        value=other.stage,
        node=wire.node if isinstance(wire, Canopen) else None,
    )
    error.pid, error.command, error.since = other.pid or None, other.command, other.since
    return error
