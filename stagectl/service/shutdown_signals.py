"""The signals that end a command or the service: Ctrl-C, a stop or a time-out, a terminal or connection that is gone.

A command takes each of them as an interrupt (`interrupting`): it stops what it has begun and says so.  The service
takes seconds to load, and then to start its processes; a signal must find it ready for an orderly end all that time.
So its verb holds `STOPS` back at once, and the server lets them through as soon as it listens for them.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import asyncio

STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def heard() -> list[signal.Signals]:
    """`STOPS`, but not SIGHUP where it is ignored, as under `nohup`."""
    return [number for number in STOPS if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN]


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
    for number in heard():
        asyncio.get_running_loop().add_signal_handler(number, stopped.set)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
    return stopped


@contextlib.contextmanager
def taken_by(handler: Callable[[int, object], None], signals: Iterable[signal.Signals]) -> Iterator[None]:
    """Have this `handler` take these signals; beside the main thread, where Python takes none, nothing changes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in signals}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, signal.SIG_DFL if earlier is None else earlier)


@contextlib.contextmanager
def interrupting() -> Iterator[list[int]]:
    """Have `STOPS` raise KeyboardInterrupt: what was begun must not go on unattended.  Yields the numbers that came.

    Each Ctrl-C does; of the others the first: a shell and `timeout` send them twice, and what the first one has caused
    must be carried out.  A signal that is ignored, as under `nohup`, or that a program handles itself, stays as it is.
    """
    came: list[int] = []

    def interrupt(number: int, _: object) -> None:
        came.append(number)
        if number == signal.SIGINT or len(came) == 1:
            raise KeyboardInterrupt

    free = (signal.SIG_DFL, signal.default_int_handler)
    with taken_by(interrupt, [number for number in STOPS if signal.getsignal(number) in free]):
        yield came
