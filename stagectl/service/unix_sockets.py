"""Sockets in the file system: only what is ours, and what nobody serves, is replaced or removed."""

from __future__ import annotations

import contextlib
import os
import socket
import stat
from collections.abc import Iterator
from pathlib import Path

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
