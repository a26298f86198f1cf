"""One master a channel: the others on this computer by a lock, all others by listening before speaking.

The advisory lock is released by the kernel when its process ends::

    <run-time folder>/stagectl-can0.lock       locked (flock) as long as a real-time process may drive something there
    {"pid": 4711, "command": "stagectl run ...", "stage": "bench.yaml", "since": "2026-11-23 16:40:38"}

The folder is shared by all users where there is such a one: a service and a person are different users.  The embedded
bus belongs to one user, so its lock lies in the bus' own folder.

A CAN frame does not name its sender.  But on a bus where we have not sent anything yet, these come from a master::

    0x080                  SYNC (CiA 301, 7.2.5)
    0x200 ... 0x500 + n    RPDO of our node n, by the predefined connection set (CiA 301, 7.3.5)
    0x700 + 127            heartbeat of another stagectl

A master that sends none of them for LISTENING_TIME drives nothing by cycles.
"""

import contextlib
import fcntl
import json
import os
import re
import shlex
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from stagectl.drives.bus.embedded import folder_of
from stagectl.drives.bus.frames import HEARTBEAT, MASTER, RPDO, SYNC, Bus, parse
from stagectl.drives.drive import Canopen, DriveError, Odrive
from stagectl.drives.limits import LISTENING_FRAMES, LISTENING_TIME, LOCK_NAME, LOCK_PATIENCE, LOCK_PAUSE, LOCK_TEXT
from stagectl.number_format import duration
from stagectl.runtime_folder import runtime_folder

_SHARED = Path("/run/lock")  # FHS 3.0, 5.9: lock files of devices; on some systems for root alone
_FOR_ALL = 0o666  # a lock file that another user left must not keep us from locking it
_RPDOS = (RPDO, RPDO + 0x100, RPDO + 0x200, RPDO + 0x300)


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
            raise _locked(wire, other)
        pid = pid or os.getpid()
        ours = Holder(pid, _command(pid), stage, time.strftime("%Y-%m-%d %H:%M:%S"))
        with contextlib.suppress(OSError):  # a full disk: the lock holds without a name
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, json.dumps(ours._asdict()).encode(), 0)

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
    while not locked(descriptor):
        if time.monotonic() > end:
            return False
        time.sleep(LOCK_PAUSE)
    return True


def locked(descriptor: int) -> bool:
    """Lock an open file where no other process has; whether it is ours, until the last copy of it is closed."""
    with contextlib.suppress(BlockingIOError):
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True
    return False


def _command(pid: int) -> str:
    """The command line of a process as a person types it."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")[:-1]
    except OSError:
        return ""
    python = [place for place, word in enumerate(words[:-1]) if word == "-m"]
    return shlex.join(words[python[0] + 1 :] if python else words)


def _read(descriptor: int) -> Holder:
    """What its holder says of itself; of another user, so nothing in it is believed to have a form."""
    try:
        said = json.loads(os.pread(descriptor, LOCK_TEXT, 0))
        pid, texts = int(said["pid"]), [str(said[name]) for name in Holder._fields[1:]]
    except (OSError, ValueError, KeyError, TypeError):
        return Holder(0, "", "", "")
    return Holder(pid, *("".join(c if c.isprintable() else "?" for c in text) for text in texts))


def _locked(wire: Canopen | Odrive, other: Holder) -> OtherMasterError:
    """The error that names the other."""
    channel = wire.port if isinstance(wire, Odrive) else wire.channel
    known = f"process {other.pid} (`{other.command}`, stage {other.stage}) since {other.since}"
    who = known if other.pid else "unknown"
    error = OtherMasterError(
        f"another master has {channel}: {who}; one channel has one master. Nothing was sent. Next: end that program, or"
        " give it this axis, too",
        place=channel,
        value=other.stage,
        node=wire.node if isinstance(wire, Canopen) else None,
    )
    error.pid, error.command, error.since = other.pid or None, other.command, other.since
    return error


def listen(wire: Canopen, bus: Bus) -> None:
    """Hear the bus for LISTENING_TIME; `bus` must be one on which we have not sent anything.

    Raises OtherMasterError where another master is heard, and OSError where the bus fails.
    """
    kinds = {SYNC: "SYNC", HEARTBEAT + MASTER: f"the heartbeat of node {MASTER}"}
    kinds |= {base + wire.node: f"RPDOs to node {wire.node}" for base in _RPDOS}
    times: dict[int, list[float]] = {}
    end = time.monotonic() + LISTENING_TIME
    for _ in range(LISTENING_FRAMES):
        left = end - time.monotonic()
        raw = bus.receive(left) if left > 0.0 else None
        if raw is None:
            break
        identifier = parse(raw)[0]
        if identifier in kinds:
            times.setdefault(identifier, []).append(time.monotonic())
    for identifier, kind in kinds.items():  # SYNC first, as it is what drives a bus
        if identifier in times:
            raise _audible(wire, kind, times[identifier])


@contextlib.contextmanager
def alone(wire: Canopen, bus: Bus, stage: str) -> Iterator[None]:
    """Have the channel for a while, in which a drive is read: no other master is disturbed, and none begins.

    Raises OtherMasterError where there is one.
    """
    lock = ChannelLock(wire, stage)
    try:
        listen(wire, bus)
        yield
    finally:
        lock.release()


def _audible(wire: Canopen, kind: str, times: list[float]) -> OtherMasterError:
    """The error that says what was heard, and when (s): by the mean period, as frames may come in bursts."""
    period = (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else None
    every = "" if period is None else f" every {duration(period)}"
    error = OtherMasterError(
        f"another master sends {kind}{every} on this bus, {wire.interface} {wire.channel} (seen {len(times)}"
        f" frames in {LISTENING_TIME:g} s); it does not run on this computer, or is no stagectl. Nothing was sent."
        " Next: stop that master; `candump` or `python -m can.logger` shows its frames",
        place=wire.channel,
        node=wire.node,
        value=kind,
    )
    error.frames, error.period = len(times), period
    return error
