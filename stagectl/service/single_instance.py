"""One service a machine: a lock and a mark in its state folder, what systemd hears of it and what it hands over.

The lock passes on to the real-time process, so it is free only when the axes of an earlier service stand still.  The
mark shows the next service that this one did not end in an orderly way.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import socket
import time
from pathlib import Path

from stagectl.service.axis_controller import ServiceError

_HANDED = 3  # descriptor of the first socket that systemd hands over
_LOCK = 20.0  # s to wait for an earlier process that still stops its axes


async def take_lock(state: Path, ends: contextlib.ExitStack) -> int:
    """Lock the folder `state`; the descriptor, which `ends` closes.

    Raises ServiceError where another service keeps it.
    """
    lock = os.open(state / "lock", os.O_RDWR | os.O_CREAT, 0o600)
    ends.callback(os.close, lock)
    end = time.monotonic() + _LOCK
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        except OSError as error:
            if time.monotonic() > end:
                raise ServiceError(f"another service uses {state}: stop it first, `systemctl stop stagectl`") from error
            await asyncio.sleep(0.1)


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
