"""The black box: a process that, at each fault, keeps the ten seconds before it and two after it at full rate.

Run as ``python -m stagectl.service.black_box``.  It reads ring and board of one axis and nothing else, so that it
outlives both the real-time process and the service, and writes down how either ended.
"""

import contextlib
import json
import os
import select
import signal
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.drives.drive import Fault
from stagectl.realtime.shared_memory import Board
from stagectl.realtime.states import POWERED, STOPS_GOING_ON, State
from stagectl.recording.beside import order_of, word_of
from stagectl.recording.hdf5 import RecordingError, Writer
from stagectl.recording.ring import Ring, RingPlace
from stagectl.replacing import not_taken
from stagectl.service.limits import BOX_RETRY, BOXES_KEPT

POLL = 0.05  # s
BEFORE, AFTER = 10.0, 2.0  # s kept of either side of a fault
UNFINISHED = ".unfinished"  # in place of .h5, until all rows are there
_POWERED = (*POWERED, *STOPS_GOING_ON, State.ENABLING, State.ENGAGING, State.DRIVE_HOMING)
_PATIENCE = 5.0  # s for the rows after the fault: a lost drive gives none


class BlackBoxOrder(NamedTuple):
    """What to watch, and where to keep it."""

    ring: RingPlace
    board: int  # descriptor
    alive: int  # reading end of the pipe that the real-time process holds
    folder: str
    meta: dict[str, Any]
    columns: tuple[str, ...]
    dt: float
    faults: int = 0  # that there were when it was asked for: what comes while it starts is kept, too


class Box(NamedTuple):
    """A fault with the rows around it, in memory until they are on the disk."""

    fault: str
    words: str
    when: str  # in the name of its file
    rows: bytes
    fault_row: int


class Watcher:
    """Sees faults come, and writes them down; while the disk is full it keeps them."""

    def __init__(self, p: BlackBoxOrder) -> None:
        self.p = p
        self.ring, self.board = Ring(*p.ring), Board(p.board)
        self.seen = p.faults
        self.kept: list[Box] = []  # that are not written yet, the oldest first
        self._retry = 0.0  # s, monotonic clock

    def look(self, gone: bool) -> Path | None:
        """One look; the file that was written, where there was a reason.  `gone`: the real-time process is no more."""
        status = self.board.status()
        if int(status.faults) != self.seen:
            row = self.ring.written
            self._wait_for(row + round(AFTER / self.p.dt), gone)
            self.seen = int(status.faults)
            return self._take(Fault(int(status.fault)).name.lower(), self.board.words, row)
        if gone and not self.ring.closed and int(status.state) in _POWERED:
            words = "the real-time process died while the axis had power"
            return self._take("process_died", words, self.ring.written)
        return self.write() if self.kept and time.monotonic() > self._retry else None

    def write(self) -> Path | None:
        """Write what is kept, the oldest first; the last file.  Says when the disk is full, and when no longer."""
        path = None
        while self.kept:
            try:
                path = self._written(self.kept[0])
            except (OSError, RuntimeError, RecordingError) as error:
                if not self._retry:
                    _say("blackbox_waits", f"the black box is kept in memory until there is room: {error}", True)
                self._retry = time.monotonic() + BOX_RETRY
                return None
            del self.kept[0]
            if self._retry:
                _say("blackbox_written", f"there is room again: {path.name} is written", bool(self.kept))
        self._retry = 0.0
        return path

    def give_up(self) -> None:
        """The service ends: what still finds no room is lost, and said to be."""
        self.write()
        for box in self.kept:
            _say("blackbox_lost", f"the black box of {box.fault} at {box.when} is lost: no room on the disk", False)

    def _take(self, fault: str, words: str, row: int) -> Path | None:
        """Keep what the ring holds around `row`, and write it where that is possible."""
        first, rows = self.ring.read(max(row - round(BEFORE / self.p.dt), 0), self.ring.capacity)
        if not rows:
            return None
        self.kept.append(Box(fault, words, time.strftime("%Y%m%d-%H%M%S"), rows, row - first))
        if len(self.kept) > BOXES_KEPT:
            lost = self.kept.pop(1)  # the first fault is the cause of the others
            _say("blackbox_lost", f"the black box of {lost.fault} is lost: {BOXES_KEPT} others wait for room", True)
        return self.write()

    def _written(self, box: Box) -> Path:
        """The file of a box.  Raises OSError or RecordingError where there is no room; nothing is left then."""
        folder = Path(self.p.folder)
        folder.mkdir(parents=True, exist_ok=True)
        path = not_taken(folder / f"{box.when}-{box.fault}.h5")
        meta = {**self.p.meta, "blackbox": {"fault": box.fault, "words": box.words, "fault_row": box.fault_row}}
        unfinished = path.with_suffix(UNFINISHED)
        try:
            writer = Writer(unfinished, meta, self.p.columns)
            try:
                writer.append(box.rows)
            finally:
                writer.close(box.words, 0)
        except (OSError, RuntimeError, RecordingError):
            unfinished.unlink(missing_ok=True)
            raise
        os.replace(unfinished, path)
        return path

    def _wait_for(self, row: int, gone: bool) -> None:
        end = time.monotonic() + _PATIENCE
        while self.ring.written < row and not self.ring.closed and not gone and time.monotonic() < end:
            gone = word_of(self.p.alive, POLL) == b""


def _say(fault: str, words: str, waiting: bool) -> None:
    """For the fault list; the service may have died meanwhile."""
    line = json.dumps({"fault": fault, "words": words, "waiting": waiting})
    print(f"black box: {words}", file=sys.stderr, flush=True)
    with contextlib.suppress(OSError):
        os.write(sys.stdout.fileno(), f"{line}\n".encode())


def watch(p: BlackBoxOrder) -> None:
    """Look until the real-time process is gone; what found no room by then is kept until the service ends."""
    watcher = Watcher(p)
    with contextlib.suppress(BrokenPipeError):  # the service may have died meanwhile: that is to be kept, too
        os.write(sys.stdout.fileno(), b"ready\n")
    gone = False
    while not gone:
        gone = watcher.ring.closed or word_of(p.alive, POLL) == b""
        watcher.look(gone)
    while watcher.kept and not select.select([sys.stdin], [], [], BOX_RETRY)[0]:
        watcher.write()
    watcher.give_up()


def main() -> None:
    """Entry of the process; signals to the service's group are none of its business."""
    watch(order_of(signal.SIGINT, signal.SIGTERM))


if __name__ == "__main__":
    main()
