"""What a process that works for a client is at first: bounded, the first to be killed, and gone with its service."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
from pathlib import Path

from stagectl.realtime.scheduling import follow_parent
from stagectl.service.limits import DISPENSABLE

_POLITE = 10  # nice: the loop's neighbours come first


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
