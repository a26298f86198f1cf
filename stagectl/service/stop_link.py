"""The other end of the stop path: one datagram asks, and carries the socket that the answer is to be written to.

A datagram needs no connection, so nobody can take all of them.  Each client brings the room for its answer: one that
does not read it holds up nobody, and nobody else can answer in place of the stop path.
"""

import contextlib
import json
import socket
import time
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.runtime_folder import short_name
from stagectl.service.limits import LONGEST_ANSWER, PROBE, PROBE_PATIENCE

STOP, QUICK_STOP, STATUS = "stop", "quick-stop", "status"


def beside(control: Path) -> Path:
    """The socket of the stop path that belongs to a control socket."""
    return control.with_name(f"{control.name}.stop")


class ServicePaths(NamedTuple):
    """Files and addresses of a running service."""

    socket: Path
    state: Path  # folder: black boxes, and the mark of a service that runs
    foxglove: tuple[str, int] | None = None  # host and port of its live view; None: no live view

    @property
    def stop(self) -> Path:
        """The socket of the stop path."""
        return beside(self.socket)


class StopLink:
    """A client of the stop path.  Raises OSError where there is none."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._mine, self._theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            with short_name(path) as name:
                self._socket.connect(name)
        except OSError:
            self.close()
            raise

    def ask(self, what: str, axis: str, timeout: float) -> dict[str, Any]:
        """The answer to STOP, QUICK_STOP or STATUS of an axis, or of all (empty).

        Raises TimeoutError after `timeout` (s), and OSError where there is nobody.
        """
        for end in (self._socket, self._mine):
            end.settimeout(timeout)
        socket.send_fds(self._socket, [_packed(what, axis)], [self._theirs.fileno()])
        answer: dict[str, Any] = json.loads(self._mine.recv(LONGEST_ANSWER))
        return answer

    def send(self, what: str, axis: str = "") -> None:
        """Ask, and do not wait; where its queue is full it has been asked often enough."""
        self._socket.setblocking(False)  # not by a flag: `send_fds` of Python 3.11 drops it
        with contextlib.suppress(OSError):
            socket.send_fds(self._socket, [_packed(what, axis)], [self._theirs.fileno()])

    def heard(self) -> bool:
        """Whether there is an answer; it is taken."""
        with contextlib.suppress(OSError):
            return bool(self._mine.recv(LONGEST_ANSWER, socket.MSG_DONTWAIT))
        return False

    def close(self) -> None:
        """Give the sockets back."""
        for end in (self._socket, self._mine, self._theirs):
            end.close()


class Probe:
    """Whether the stop path answers: it is asked as a client asks it."""

    def __init__(self, path: Path) -> None:
        self._link = StopLink(path)
        self._asked, self._answered = 0.0, time.monotonic()

    def look(self) -> None:
        """Take answers, and ask again when it is time."""
        now = time.monotonic()
        while self._link.heard():
            self._answered = now
        if now - self._asked > PROBE:
            self._asked = now
            self._link.send(STATUS)

    @property
    def well(self) -> bool:
        """Whether it has answered lately."""
        return time.monotonic() - self._answered < PROBE_PATIENCE

    def close(self) -> None:
        """Give the socket back."""
        self._link.close()


def _packed(what: str, axis: str) -> bytes:
    return json.dumps({"do": what, "axis": axis}).encode()
