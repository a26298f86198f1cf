"""The stop path: a process that takes a stop from its owner and hands it to the loop, whatever the service does.

Run as ``python -m stagectl.service.stop_path``.

::

    stagectl stop -- datagram --> stop path -- count in shared memory --> loop, in its next period
                  <- status ----           <-- heeded, status ----------

It shares nothing with the service that a client can use up: no event loop, no interpreter lock, no descriptors, no
planning, no disk.  It lives as long as the loop, also where the service dies.
"""

import contextlib
import gc
import json
import os
import pickle
import select
import signal
import socket
import sys
import time
from typing import Any, NamedTuple

from stagectl.realtime import scheduling
from stagectl.realtime.shared_memory import CUT, HOLD, STOP_PATH, Board
from stagectl.recording.beside import order_of
from stagectl.service.axis_status import Shown, machine_json
from stagectl.service.limits import BURST, LONGEST_REQUEST, LOOK, STOP_PRIORITY, TAKEN, WAITING
from stagectl.service.stop_link import QUICK_STOP, STATUS, STOP

_KINDS = {STOP: HOLD, QUICK_STOP: CUT}


class StopPost(NamedTuple):
    """The order of this process."""

    socket: int  # descriptors
    alive: int  # reading end of the pipe that the real-time process holds
    axes: tuple[tuple[Shown, int], ...]  # with their boards' descriptors


class _Waiting(NamedTuple):
    """A client whose stop the loop has not taken yet."""

    answer: socket.socket | None  # None: it brought none, and hears nothing
    until: float  # s, monotonic clock


class StopPath:
    """Stops, and answers."""

    def __init__(self, post: StopPost) -> None:
        self._socket = socket.socket(fileno=post.socket)
        self._socket.setblocking(False)
        self._axes = [(shown, Board(board)) for shown, board in post.axes]
        self._waiting: list[_Waiting] = []
        self.refused: list[str] = []  # what the kernel refused the loop

    @property
    def pause(self) -> float | None:
        """Time (s) until it must look by itself; None: no client waits."""
        return LOOK if self._waiting else None

    def look(self) -> None:
        """Take what was asked, then answer whom the loop has heeded, or who has waited long enough."""
        with contextlib.suppress(OSError):
            for _ in range(BURST):
                request, descriptors, _, _ = socket.recv_fds(self._socket, LONGEST_REQUEST, 1)
                self._take(request, _socket_of(descriptors))
        heeded, now = self._heeded(), time.monotonic()
        for client in self._waiting:
            if heeded or now > client.until:
                _say(client.answer, self.status())
        self._waiting = [] if heeded else [client for client in self._waiting if now <= client.until]

    def status(self) -> dict[str, Any]:
        """The machine as the control interface shows it, and whether all stops are taken."""
        return {**machine_json(self._axes, self.refused), "heeded": self._heeded()}

    def _take(self, request: bytes, answer: socket.socket | None) -> None:
        try:
            asked = json.loads(request)
            what, axis = str(asked["do"]), asked["axis"]
            chosen = [board for shown, board in self._axes if axis in ("", shown.name)]
        except (ValueError, KeyError, TypeError, RecursionError):
            what, axis, chosen = "", "", []
        if what in _KINDS and chosen:
            for board in chosen:
                board.stop(STOP_PATH, _KINDS[what])
            self._waiting.append(_Waiting(answer, time.monotonic() + TAKEN))
            while len(self._waiting) > WAITING:
                _say(self._waiting.pop(0).answer, self.status())
        elif what == STATUS:
            _say(answer, self.status())
        else:
            names = ", ".join(shown.name for shown, _ in self._axes)
            _say(answer, {"error": f"no axis {axis}; the axes are: {names}" if what in _KINDS else "no request"})

    def _heeded(self) -> bool:
        return all(board.heeded(STOP_PATH) for _, board in self._axes)


def _socket_of(descriptors: list[int]) -> socket.socket | None:
    """What a client brought for its answer, if it is a socket."""
    for descriptor in descriptors:
        try:
            return socket.socket(fileno=descriptor)
        except OSError:
            os.close(descriptor)
    return None


def _say(client: socket.socket | None, answer: dict[str, Any]) -> None:
    """Answer without waiting, whatever the client brought; a stop is given all the same."""
    if client is not None:
        with client, contextlib.suppress(OSError):
            client.send(json.dumps(answer).encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)


def serve(post: StopPost) -> None:
    """Until the real-time process is gone."""
    path, poll = StopPath(post), select.poll()
    for descriptor in (post.socket, post.alive, sys.stdin.fileno()):
        poll.register(descriptor, select.POLLIN)
    path.look()  # a stop that came while nobody was here must not end a motion that is ordered from now on
    with contextlib.suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), b"ready\n")
    while True:
        pause = path.pause
        ready = {descriptor for descriptor, _ in poll.poll(None if pause is None else 1e3 * pause)}
        if post.alive in ready and os.read(post.alive, 1) == b"":
            return
        if sys.stdin.fileno() in ready:
            poll.unregister(sys.stdin.fileno())
            with contextlib.suppress(EOFError):  # the service has died: the loop stops the axes, and may need us
                path.refused = pickle.load(sys.stdin.buffer)
        path.look()


def main() -> None:
    """Entry of the process; signals to the service's group are none of its business: it ends with the loop."""
    post: StopPost = order_of(signal.SIGINT, signal.SIGTERM)
    scheduling.prepare(STOP_PRIORITY, None)  # what is refused is what is refused to the loop, which says so
    gc.enable()
    serve(post)


if __name__ == "__main__":
    main()
