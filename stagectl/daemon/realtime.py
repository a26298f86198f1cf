"""Punctuality, as far as the kernel permits; what it refuses is said."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import time

_MCL_CURRENT_AND_FUTURE = 3
_PR_SET_PDEATHSIG = 1
_PR_SET_TIMERSLACK = 29


def follow_parent() -> None:
    """Have the kernel send SIGTERM when the process that started this one dies, however it dies."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)


def prepare(priority: int, cpu: int | None) -> list[str]:
    """Ask for all of it; returns what was refused, with the remedy, as sentences."""
    libc = ctypes.CDLL(None, use_errno=True)
    refused = [*_schedule(priority), *_lock(libc), *_pin(cpu), *_awake()]
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    gc.collect()
    gc.freeze()
    gc.disable()
    return refused


def _schedule(priority: int) -> list[str]:
    if priority == 0:
        return []
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return [f"no real-time scheduling (SCHED_FIFO {priority}): allow it with LimitRTPRIO= or ulimit -r"]
    return []


def _lock(libc: ctypes.CDLL) -> list[str]:
    if libc.mlockall(_MCL_CURRENT_AND_FUTURE) != 0:
        return ["memory is not locked (mlockall): allow it with LimitMEMLOCK=infinity or ulimit -l unlimited"]
    return []


def _pin(cpu: int | None) -> list[str]:
    if cpu is None:
        return []
    try:
        os.sched_setaffinity(0, {cpu})
    except OSError:
        return [f"not pinned to CPU {cpu}: this process may use {sorted(os.sched_getaffinity(0))}"]
    return []


_held: list[int] = []  # the descriptor must stay open: closing it gives the request back


def _awake() -> list[str]:
    try:
        descriptor = os.open("/dev/cpu_dma_latency", os.O_WRONLY)
        os.write(descriptor, b"\x00\x00\x00\x00")
    except OSError:
        return ["the CPU may sleep deeply (/dev/cpu_dma_latency is not writable): wake-ups take longer"]
    _held.append(descriptor)
    return []


class Metronome:
    """Absolute deadlines on a fixed grid; a cycle that overruns loses whole periods of it."""

    def __init__(self, period: float) -> None:
        self.period = period
        self.deadline = time.monotonic()

    def wait(self) -> float:
        """Sleep until the next deadline; returns how late (s) the caller woke up."""
        self.deadline += self.period
        now = time.monotonic()
        if now < self.deadline:
            time.sleep(self.deadline - now)
            now = time.monotonic()
        return now - self.deadline

    def missed(self) -> int:
        """Periods that have ended since the deadline: 0 in time; otherwise the next deadline lies behind them."""
        missed = int((time.monotonic() - self.deadline) / self.period)
        self.deadline += self.period * missed
        return missed
