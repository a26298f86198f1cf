"""Cores shared by the workers of an exam on one machine: each diagnosis holds its own, by a lock that dies with it."""

import fcntl
import os
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

PATIENCE = 20.0  # s without a free core, after which a diagnosis runs on any


def available() -> tuple[int, ...]:
    """Cores that this process may use."""
    return tuple(sorted(os.sched_getaffinity(0))) if hasattr(os, "sched_getaffinity") else ()


@contextmanager
def alone(root: Path, number: int) -> Iterator[None]:
    """The one that sits this trial, of all processes that see the exam's folder; others wait."""
    folder = root / ".sitting"
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / str(number)).open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@contextmanager
def taken(root: Path, count: int) -> Iterator[tuple[int, ...]]:
    """`count` cores that no other worker of the exam holds; none, and so no binding, where they don't come free."""
    folder = root / ".cores" / socket.gethostname()  # a cluster's machines have cores of their own
    folder.mkdir(parents=True, exist_ok=True)
    until = time.monotonic() + PATIENCE
    while True:
        with ExitStack() as held:
            cores: list[int] = []
            for core in available():
                if len(cores) < count and _locked(folder / str(core), held):
                    cores.append(core)
            if len(cores) == min(count, len(available())):
                yield tuple(cores)
                return
        if time.monotonic() > until:
            yield ()
            return
        time.sleep(0.2)


def _locked(path: Path, held: ExitStack) -> bool:
    file = held.enter_context(path.open("w"))
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
