"""The other end of the stop path: one datagram asks, one answers.

A datagram needs no connection, so nobody can take all of them.  The client's socket is connected: the kernel then drops
what anybody but the stop path sends to it.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import time
from pathlib import Path
from typing import Any

from stagectl.service.limits import LONGEST_ANSWER, PROBE, PROBE_PATIENCE

STOP, QUICK_STOP, STATUS = "stop", "quick-stop", "status"


def beside(control: Path) -> Path:
    """The socket of the stop path that belongs to a control socket."""
    return control.with_name(f"{control.name}.stop")


class StopLink:
    """A client of the stop path.  Raises OSError where there is none."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._socket.bind("")  # the kernel chooses a name to answer to
            self._socket.connect(os.fspath(path))
        except OSError:
            self._socket.close()
            raise

    def ask(self, what: str, axis: str, timeout: float) -> dict[str, Any]:
        """The answer to STOP, QUICK_STOP or STATUS of an axis, or of all (empty).

        Raises TimeoutError after `timeout` (s), and OSError where there is nobody.
        """
        self._socket.settimeout(timeout)
        self._socket.send(_packed(what, axis))
        answer: dict[str, Any] = json.loads(self._socket.recv(LONGEST_ANSWER))
        return answer

    def send(self, what: str, axis: str = "") -> None:
        """Ask, and do not wait; where its queue is full it has been asked often enough."""
        with contextlib.suppress(OSError):
            self._socket.send(_packed(what, axis), socket.MSG_DONTWAIT)

    def heard(self) -> bool:
        """Whether there is an answer; it is taken."""
        with contextlib.suppress(OSError):
            return bool(self._socket.recv(LONGEST_ANSWER, socket.MSG_DONTWAIT))
        return False

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()


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
