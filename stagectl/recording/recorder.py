"""The recorder process: empties the ring into the file, so that no disk ever delays the loop.

Run as ``python -m stagectl.recording.recorder``; its orders come as one pickled `Order` on standard input.  It ends
when the loop closes the ring or dies: the loop holds the only writing end of the `alive` pipe.  A service that records
for a while holds that end itself, and says `ENOUGH`.
"""

import os
import signal
import sys
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.recording.beside import order_of, word_of
from stagectl.recording.constants import BLOCK, POLL
from stagectl.recording.hdf5 import DamagedError, RecordingError, Writer
from stagectl.recording.ring import Ring, RingPlace

ENOUGH = b"."  # what is in the ring now is the end


class Order(NamedTuple):
    """What to record, and where to."""

    ring: RingPlace
    alive: int  # descriptor of the pipe's reading end
    path: str
    meta: dict[str, Any]
    columns: tuple[str, ...]
    start: int = 0  # number of the first row


class Tape:
    """What of the loop's rows reaches the disk, and what does not: a disk that is full costs rows, a dead one all."""

    def __init__(self, writer: Writer, width: int, start: int = 0) -> None:
        self.done, self.lost = start, 0
        self.gaps: list[tuple[int, int]] = []  # rows before it, rows lost
        self._writer, self._row = writer, 8 * width
        self._kept, self._full, self._damaged = 0, False, False

    def take(self, first: int, rows: bytes) -> None:
        """Rows from number `first` on; those before it have been overwritten."""
        count = len(rows) // self._row
        self._lose(first - self.done)
        self.done = first + count
        if self._written(rows):
            self._kept += count
        else:
            self._lose(count)

    def close(self, ended: str, complete: bool) -> bool:
        """Finish the file; False where it is damaged."""
        if self._damaged:
            return False
        try:
            self._writer.close(ended, self.lost, complete, self.gaps)
        except RecordingError as error:
            _say(str(error))
            return False
        return True

    def _written(self, rows: bytes) -> bool:
        if self._damaged:
            return False
        try:
            self._writer.append(rows)
        except RecordingError as error:
            if not self._full:
                _say(f"{error}; rows are lost from row {self._kept} on")
            self._full, self._damaged = True, isinstance(error, DamagedError)
            return False
        self._full = False
        return True

    def _lose(self, count: int) -> None:
        if count and self.gaps and self.gaps[-1][0] == self._kept:
            self.gaps[-1] = (self._kept, self.gaps[-1][1] + count)
        elif count:
            self.gaps.append((self._kept, count))
        self.lost += count


def record(order: Order) -> bool:
    """Write blocks until the ring closes or its writer is gone; False where the disk failed."""
    ring = Ring(*order.ring)
    tape = Tape(Writer(Path(order.path), order.meta, order.columns), ring.width, order.start)
    print("ready", flush=True)
    while True:
        message = word_of(order.alive, POLL)  # ENOUGH, or empty: the loop is gone
        over = ring.closed or message is not None
        while ring.written - tape.done >= (1 if over else BLOCK):
            tape.take(*ring.read(tape.done, BLOCK))
        if over:
            break
    complete = ring.closed or message == ENOUGH
    whole = tape.close("complete" if complete else "the loop process died", complete)
    if tape.lost:
        where = f"{order.path} marks where" if whole else f"{order.path} is cut off before them"
        _say(f"{tape.lost} of {tape.done - order.start} rows are lost; {where}")
    if tape.done == order.start:  # nothing has moved: no recording
        os.unlink(order.path)
    return whole


def _say(words: str) -> None:
    print(f"recorder: {words}", file=sys.stderr, flush=True)


def main() -> None:
    """Entry of the process."""
    order: Order | None = order_of(signal.SIGINT)
    if order is None:
        return
    try:
        whole = record(order)
    except (OSError, RecordingError) as error:
        _say(str(error))
        print(error, flush=True)  # in the place of "ready", for the process that waits for it
        whole = False
    if not whole:
        os._exit(2)  # HDF5 would try to write the rest again, at exit


if __name__ == "__main__":
    main()
