"""A process beside the loop: its order on standard input, its end with the loop, signals that are not for it."""

import os
import pickle
import select
import signal
import sys
from typing import Any


def order_of(*ignored: signal.Signals) -> Any:
    """The pickled order on standard input; None where the run failed before there was one.

    Signals to the group that are `ignored` are for the loop, which stops the axis: this process sees it to the end.
    """
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)
    try:
        return pickle.load(sys.stdin.buffer)
    except EOFError:
        return None


def word_of(alive: int, timeout: float) -> bytes | None:
    """A byte of the pipe `alive` within `timeout` (s); None: there is none; empty: its writer is gone."""
    readable, _, _ = select.select([alive], [], [], timeout)
    return os.read(alive, 1) if readable else None
