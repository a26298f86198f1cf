"""One service a machine: its sockets, its lock, its mark, what systemd hears of it and what it hands over.

Of the sockets in the file system only what is ours, and what nobody serves, is replaced or removed.  The lock passes on
to the real-time process, so it is free only when the axes of an earlier service stand still.  The mark shows the next
service that this one did not end in an orderly way.
"""

import asyncio
import contextlib
import os
import socket
import stat
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from stagectl.drives.bus.other_masters import locked
from stagectl.runtime_folder import short_name
from stagectl.service.axis_controller import ServiceError

_OWNERS = 0o660  # who is neither its owner nor in its group cannot move anything
_QUEUE = 128  # connections that wait to be accepted


def bound(path: Path, kind: socket.SocketKind) -> socket.socket:
    """A socket of this kind (SOCK_STREAM listens) under this name, for its owner and group.

    Raises ServiceError where a service has it, or the name is that of anything but a socket of ours.
    """
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o755)
    _clear(path, kind)
    served = socket.socket(socket.AF_UNIX, kind)
    before = os.umask(0o777 & ~_OWNERS)
    try:
        with short_name(path) as name:
            served.bind(name)
        if kind is socket.SOCK_STREAM:
            served.listen(_QUEUE)
    except OSError as error:
        served.close()
        raise ServiceError(f"{path}: {error.strerror or error}; choose another --socket") from error
    finally:
        os.umask(before)
    return served


@contextlib.contextmanager
def serving(path: Path, kind: socket.SocketKind) -> Iterator[socket.socket]:
    """A socket as by `bound`; at the end its name is removed, unless it is another's by now."""
    served = bound(path, kind)
    ours = os.lstat(path)
    try:
        yield served
    finally:
        served.close()
        with contextlib.suppress(OSError):
            if os.path.samestat(os.lstat(path), ours):
                path.unlink()


def _clear(path: Path, kind: socket.SocketKind) -> None:
    """Remove what a service that was killed has left.  Raises ServiceError where it is anything else."""
    try:
        there = os.lstat(path)
    except FileNotFoundError:
        return
    except OSError as error:
        raise ServiceError(f"{path}: {error.strerror}; choose another --socket") from error
    if not stat.S_ISSOCK(there.st_mode):
        raise ServiceError(f"{path} is a file, not a socket, and is left as it is: choose another --socket")
    if there.st_uid != os.geteuid():
        raise ServiceError(f"{path} is a socket of user {there.st_uid}, and is left as it is: choose another --socket")
    with socket.socket(socket.AF_UNIX, kind) as probe:
        probe.settimeout(1.0)
        try:
            with short_name(path) as name:
                probe.connect(name)
        except ConnectionRefusedError:
            path.unlink()
            return
        except OSError:  # its queue is full, or it is of another kind: somebody is there
            pass
    raise ServiceError(f"a service listens on {path} already: stop it first, or choose another --socket")


_HANDED = 3  # descriptor of the first socket that systemd hands over
_LOCK = 20.0  # s to wait for an earlier process that still stops its axes


async def take_lock(state: Path, ends: contextlib.ExitStack, say: Callable[[str], None]) -> int:
    """Lock the folder `state`; the descriptor, which `ends` closes.

    Raises ServiceError where another service keeps it.
    """
    lock = os.open(state / "lock", os.O_RDWR | os.O_CREAT, 0o600)
    ends.callback(os.close, lock)
    if locked(lock):
        return lock
    user = f"another service (process {_process(state)}) uses {state}"
    advice = "stop it first, by Ctrl-C in its terminal or by `systemctl stop stagectl`, or choose another --state"
    say(f"{user}; waiting {_LOCK:.0f} s for it to end; where it does not: {advice}")
    end = time.monotonic() + _LOCK
    while not locked(lock):
        if time.monotonic() > end:
            raise ServiceError(f"{user}: {advice}")
        await asyncio.sleep(0.1)
    return lock


def _process(state: Path) -> str:
    """Of the service that marked `state` as its own."""
    with contextlib.suppress(OSError):
        return (state / "running").read_text()
    return "unknown"


def mark_running(state: Path, ends: contextlib.ExitStack) -> bool:
    """Mark the service as running until `ends`; whether the last one left its mark, so was killed."""
    mark = state / "running"
    killed = mark.exists()
    mark.write_text(str(os.getpid()))
    ends.callback(_unlink, mark)
    return killed


def _unlink(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()


def notify(*lines: str) -> bool:
    """Send systemd these lines of its protocol sd_notify, such as ``READY=1``; False where it did not start us."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    if address.startswith("@"):  # of the abstract namespace
        address = "\0" + address[1:]
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
        link.connect(address)
        link.send("\n".join(lines).encode())
        return True
    return False


def handed_over() -> socket.socket | None:
    """The listening socket that systemd opened for us (its protocol sd_listen_fds); None where it opened none."""
    if os.environ.get("LISTEN_PID") != str(os.getpid()) or os.environ.get("LISTEN_FDS") != "1":
        return None
    os.set_inheritable(_HANDED, False)
    return socket.socket(fileno=_HANDED)
