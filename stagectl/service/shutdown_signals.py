"""The signals that end the service, from its first moment on.

It takes seconds to load, and then to start its processes; a signal must find it ready for an orderly end all that time.
So the verb holds `STOPS` back at once, and the server lets them through as soon as it listens for them.
"""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import asyncio

STOPS = (signal.SIGTERM, signal.SIGINT)


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
