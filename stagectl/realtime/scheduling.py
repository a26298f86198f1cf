"""Punctuality, as far as the kernel permits; what it refuses is said."""

import contextlib
import ctypes
import gc
import os
import signal
from collections.abc import Iterator

from stagectl.drives.clock import WALL, Clock

PARENT = "STAGECTL_PARENT"  # environment of a child: the process id of who started it
_MCL_CURRENT_AND_FUTURE = 3
_PR_SET_PDEATHSIG = 1
_PR_SET_TIMERSLACK = 29


def follow_parent() -> None:
    """Have the kernel send SIGTERM when the process that started this one dies, however and whenever it dies."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.environ.get(PARENT, str(os.getppid())) != str(os.getppid()):  # it was dead before the kernel was asked
        os.kill(os.getpid(), signal.SIGTERM)


_held: list[int] = []  # the descriptor must stay open: closing it gives the request back


def prepare(priority: int, cpu: int | None) -> list[str]:
    """Ask for all of it; returns what was refused, with the remedy, as sentences."""
    libc, refused = ctypes.CDLL(None, use_errno=True), list[str]()
    with _noting(refused, f"no real-time scheduling (SCHED_FIFO {priority}): allow it with LimitRTPRIO= or ulimit -r"):
        if priority:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    with _noting(
        refused, "memory is not locked (mlockall): allow it with LimitMEMLOCK=infinity or ulimit -l unlimited"
    ):
        if libc.mlockall(_MCL_CURRENT_AND_FUTURE) != 0:
            raise OSError
    with _noting(refused, f"not pinned to CPU {cpu}: this process may use {sorted(os.sched_getaffinity(0))}"):
        if cpu is not None:
            os.sched_setaffinity(0, {cpu})
    with _noting(refused, "the CPU may sleep deeply (/dev/cpu_dma_latency is not writable): wake-ups take longer"):
        _held.append(os.open("/dev/cpu_dma_latency", os.O_WRONLY))
        os.write(_held[-1], b"\x00\x00\x00\x00")
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    settle()
    gc.disable()
    return refused


@contextlib.contextmanager
def _noting(refused: list[str], words: str) -> Iterator[None]:
    """Note in words what the kernel refuses."""
    try:
        yield
    except OSError:
        refused.append(words)


def settle() -> None:
    """What is there now stays: collections from here on look at what comes after it, and are short."""
    gc.collect()
    gc.freeze()


class Metronome:
    """Absolute deadlines on a fixed grid; a cycle that overruns loses whole periods of it."""

    def __init__(self, period: float, clock: Clock = WALL, spin: float = 0.0) -> None:
        """With `spin` (s) it wakes so much sooner, and waits for the rest by looking at the clock."""
        self.period, self._spin = period, spin
        # On the wall clock no frame of ours is in between: after a sleep each one is a cache miss, microseconds late.
        self._now, self._sleep = clock.now, clock.sleep
        self.deadline = self._now()

    def wait(self) -> float:
        """Sleep until the next deadline; returns how late (s) the caller woke up."""
        self.deadline = deadline = self.deadline + self.period
        now, spin = self._now, self._spin  # looked up before the sleep: after it, that is a cache miss, too
        asleep = deadline - spin - now()
        if asleep > 0.0:
            self._sleep(asleep)
        late = now() - deadline
        while late < 0.0 and spin:
            late = now() - deadline
        return late

    def restart(self) -> None:
        """The grid begins anew, now."""
        self.deadline = self._now()

    def missed(self) -> int:
        """Periods that have ended since the deadline: 0 in time; otherwise the next deadline lies behind them."""
        late = self._now() - self.deadline
        if late < self.period:
            return 0
        missed = int(late / self.period)
        self.deadline += self.period * missed
        return missed
