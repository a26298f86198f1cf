"""A child process: one that takes one pickled order and answers in lines, and what bounds one that works for a client.

That one is bounded in memory and time, the first to be killed, and gone with its service.
"""

import contextlib
import io
import os
import pickle
import resource
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from stagectl.realtime.scheduling import PARENT, follow_parent
from stagectl.recording.ring import Ring
from stagectl.service.limits import DISPENSABLE
from stagectl.service.shutdown_signals import held_back

_PATIENCE = 180.0  # s for a companion to become ready: it may have to compile
_LEAVE = 15.0  # s for it to end after the loop: it may be behind
_POLITE = 10  # nice: the loop's neighbours come first
PYTHON = (sys.executable, "-P")  # a child: nothing is imported from the folder that the service was started in


class Child:
    """One started process."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdin is not None and isinstance(process.stdout, io.BufferedReader)
        self._process, self._in = process, process.stdin
        self._out = process.stdout.raw  # without a buffer: `readable` sees all that there is
        self.pid, self.signal = process.pid, process.send_signal

    def send(self, order: object) -> None:
        """Hand over the order."""
        with contextlib.suppress(BrokenPipeError):  # it has died: the next line() is empty
            pickle.dump(order, self._in)
            self._in.flush()

    def say(self, word: str) -> None:
        """Send a word on a line of its own."""
        with contextlib.suppress(BrokenPipeError):
            self._in.write(f"{word}\n".encode())
            self._in.flush()

    def line(self) -> str:
        """Its next line; empty where it has ended."""
        line: bytes = self._out.readline()
        return line.decode().strip()

    def readable(self, timeout: float) -> bool:
        """Whether it has written a line, or ended, within `timeout` (s)."""
        return bool(select.select([self._out], [], [], timeout)[0])

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code; past `timeout` (s) it is killed."""
        with contextlib.suppress(BrokenPipeError):
            self._in.close()
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        self._out.close()
        return code

    @property
    def ended(self) -> int | None:
        """Its exit code; None while it lives."""
        return self._process.poll()

    def terminate(self) -> None:
        """Ask it to end, if it has not ended."""
        if self._process.poll() is None:
            self._process.terminate()


class Companion(NamedTuple):
    """A process that reads the ring next to the recorder, compiled; the motion neither waits for it nor needs it.

    It takes its order, says that it is ready, and takes a line with the position that the motion begins at.
    """

    module: str
    order: Callable[[Ring, int], object]  # for the ring, and the pipe that ends when the loop does


def start(module: str, descriptors: tuple[int, ...], kernels: str) -> Child:
    """Start ``python -m module`` with these open descriptors and this kind of kernels (see `kernels.jit`)."""
    # A terminal tells the whole group: a hang-up is for us, who stop the axis; of Ctrl-C the child has its own say once
    # it has imported, where it would end with a traceback.
    with held_back(signal.SIGINT, signal.SIGHUP):
        process = subprocess.Popen(
            [*PYTHON, "-m", module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=descriptors,
            env=environment(STAGECTL_KERNELS=kernels),
        )
    return Child(process)


def environment(**more: str) -> dict[str, str]:
    """Of a child that ends with this process: ours, and `more`."""
    return {**os.environ, **more, PARENT: str(os.getpid())}


@contextlib.contextmanager
def running_companion(companion: Companion | None, ring: Ring, alive: int) -> Iterator[tuple[Child | None, list[int]]]:
    """Run the companion, ready before anything moves; yields it, and the list that will hold its exit code."""
    codes: list[int] = []
    if companion is None:
        yield None, codes
        return
    child = start(companion.module, (ring.descriptor, alive), "compiled")
    try:
        child.send(companion.order(ring, alive))
        if child.readable(_PATIENCE):
            child.line()
        yield child, codes
    finally:
        codes.append(child.wait(_LEAVE))


def confine(memory: int, processor: float = 0.0, largest_file: int = 0) -> None:
    """Bound this process: address space (bytes), processor time (s), size of a file (bytes); 0: no bound."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)  # the service holds them back while it starts
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT, signal.SIGTERM))
    follow_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the service, which ends this process
    for which, bound in (
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_CPU, int(processor)),
        (resource.RLIMIT_FSIZE, largest_file),
        (resource.RLIMIT_CORE, 0),
    ):
        if bound or which == resource.RLIMIT_CORE:
            _, most = resource.getrlimit(which)
            resource.setrlimit(which, (bound if most == resource.RLIM_INFINITY else min(bound, most), most))
    os.nice(_POLITE)
    rank(os.getpid(), DISPENSABLE)


def rank(process: int, score: int) -> None:
    """How soon the kernel kills a process where memory runs out: 1000 first, -1000 never; below 0 as systemd allows."""
    with contextlib.suppress(OSError):  # not allowed, or a kernel without it: it kills by size
        Path(f"/proc/{process}/oom_score_adj").write_text(str(score))
