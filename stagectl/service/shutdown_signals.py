"""The signals that end the service, from its first moment on, and those that end what a client has begun on it.

It takes seconds to load, and then to start its processes; a signal must find it ready for an orderly end all that time.
So the verb holds `STOPS` back at once, and the server lets them through as soon as it listens for them.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import asyncio

STOPS = (signal.SIGTERM, signal.SIGINT)
_LEAVES = (signal.SIGTERM, signal.SIGHUP)  # the operator's terminal or connection is gone, or a time-out has come


@contextlib.contextmanager
def held_back(*signals: signal.Signals) -> Iterator[None]:
    """Have these signals wait until this context is left, or `stop_event` is called."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def stop_event() -> asyncio.Event:
    """Set by one of these signals, also by one that has waited; within a running event loop."""
    import asyncio

    stopped = asyncio.Event()
    for number in STOPS:
        asyncio.get_running_loop().add_signal_handler(number, stopped.set)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
    return stopped


@contextlib.contextmanager
def interrupting() -> Iterator[None]:
    """Have SIGTERM and SIGHUP raise KeyboardInterrupt, as Ctrl-C does: what was begun must not go on unattended.

    Only the first does: a shell and `timeout` send them twice, and what the first one has caused must be carried out.
    A signal that is ignored, as under `nohup`, or that a program handles itself, stays as it is.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    taken = [number for number in _LEAVES if signal.getsignal(number) is signal.SIG_DFL]
    came: list[int] = []

    def interrupt(number: int, _: object) -> None:
        came.append(number)
        if len(came) == 1:
            raise KeyboardInterrupt

    for number in taken:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)
