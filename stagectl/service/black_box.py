"""The black box: a process that, at each fault, keeps the ten seconds before it and two after it at full rate.

Run as ``python -m stagectl.service.black_box``.  It reads ring and board of one axis and nothing else, so that it
outlives both the real-time process and the service, and writes down how either ended.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stagectl.drives.drive import Fault
from stagectl.realtime.shared_memory import Board, Status
from stagectl.realtime.states import State
from stagectl.recording.hdf5 import RecordingError, Writer
from stagectl.recording.ring import Ring

POLL = 0.05  # s
BEFORE, AFTER = 10.0, 2.0  # s kept of either side of a fault
UNFINISHED = ".unfinished"  # in place of .h5, until all rows are there
_PATIENCE = 5.0  # s for the rows after the fault: a lost drive gives none


class BlackBoxOrder(NamedTuple):
    """What to watch, and where to keep it."""

    ring: int  # descriptors
    width: int
    capacity: int
    board: int
    alive: int  # reading end of the pipe that the real-time process holds
    folder: str
    meta: dict[str, Any]
    columns: tuple[str, ...]
    dt: float
    faults: int = 0  # that there were when it was asked for: what comes while it starts is kept, too


class Watcher:
    """Sees faults come, and writes them down."""

    def __init__(self, p: BlackBoxOrder) -> None:
        self.p = p
        self.ring, self.board = Ring(p.ring, p.width, p.capacity), Board(p.board)
        self.seen = p.faults

    def look(self, gone: bool) -> Path | None:
        """One look; the file that was written, where there was a reason.  `gone`: the real-time process is no more."""
        status = self.board.status()
        if int(status.faults) != self.seen:
            row = self.ring.written
            self._wait_for(row + round(AFTER / self.p.dt), gone)
            self.seen = int(status.faults)
            return self.keep(Fault(int(status.fault)).name.lower(), self.board.words, row)
        if gone and not self.ring.closed and _had_power(status):
            return self.keep("process_died", "the real-time process died while the axis had power", self.ring.written)
        return None

    def keep(self, name: str, words: str, row: int) -> Path | None:
        """Write down what the ring holds around `row`."""
        first, rows = self.ring.read(max(row - round(BEFORE / self.p.dt), 0), self.p.capacity)
        if not rows:
            return None
        folder = Path(self.p.folder)
        folder.mkdir(parents=True, exist_ok=True)
        path = _fresh(folder, name)
        meta = {**self.p.meta, "blackbox": {"fault": name, "words": words, "fault_row": row - first}}
        unfinished = path.with_suffix(UNFINISHED)
        writer = Writer(unfinished, meta, self.p.columns)
        writer.append(np.frombuffer(rows).tobytes())
        writer.close(words, 0)
        os.replace(unfinished, path)
        return path

    def _wait_for(self, row: int, gone: bool) -> None:
        end = time.monotonic() + _PATIENCE
        while self.ring.written < row and not self.ring.closed and not gone and time.monotonic() < end:
            gone = _ended(self.p.alive, POLL)


def _had_power(status: Status) -> bool:
    return bool(status.power) or int(status.state) in (State.ENABLING, State.QUICK_STOPPING, State.COASTING)


def _fresh(folder: Path, name: str) -> Path:
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}-{name}"
    path, number = folder / f"{stem}.h5", 1
    while path.exists():
        number += 1
        path = folder / f"{stem}-{number}.h5"
    return path


def _ended(alive: int, timeout: float) -> bool:
    readable, _, _ = select.select([alive], [], [], timeout)
    return bool(readable) and os.read(alive, 1) == b""


def watch(p: BlackBoxOrder) -> None:
    """Look until the real-time process is gone."""
    watcher = Watcher(p)
    with contextlib.suppress(BrokenPipeError):  # the service may have died meanwhile: that is to be kept, too
        os.write(sys.stdout.fileno(), b"ready\n")
    gone = False
    while not gone:
        gone = watcher.ring.closed or _ended(p.alive, POLL)
        try:
            watcher.look(gone)
        except (OSError, RecordingError) as error:  # a full disk must not end the watch
            watcher.seen = int(watcher.board.status().faults)
            print(f"black box: {error}", file=sys.stderr, flush=True)


def main() -> None:
    """Entry of the process; signals to the service's group are none of its business."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    watch(pickle.load(sys.stdin.buffer))


if __name__ == "__main__":
    main()
