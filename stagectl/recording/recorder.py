"""The recorder process: empties the ring into the file, so that no disk ever delays the loop.

Run as ``python -m stagectl.recording.recorder``; its orders come as one pickled `Order` on standard input.  It ends
when the loop closes the ring or dies: the loop holds the only writing end of the `alive` pipe.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import sys
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.recording.hdf5 import BLOCK, RecordingError, Writer
from stagectl.recording.ring import Ring

POLL = 0.05  # s; the ring holds 16 s at 2 kHz


class Order(NamedTuple):
    """What to record, and where to."""

    ring: int  # descriptor
    width: int
    capacity: int
    alive: int  # descriptor of the pipe's reading end
    path: str
    meta: dict[str, Any]
    columns: tuple[str, ...]


def record(order: Order) -> None:
    """Write blocks until the ring closes or its writer is gone."""
    ring = Ring(order.ring, order.width, order.capacity)
    writer = Writer(Path(order.path), order.meta, order.columns)
    done, lost = 0, 0
    print("ready", flush=True)
    while True:
        over = ring.closed or _writer_gone(order.alive)
        while ring.written - done >= (1 if over else BLOCK):
            first, rows = ring.read(done, BLOCK)
            lost += first - done
            done = first + len(rows) // (8 * order.width)
            writer.append(rows)
        if over:
            break
    writer.close("complete" if ring.closed else "the loop process died", lost, complete=ring.closed)
    if done == 0:  # nothing has moved: no recording
        os.unlink(order.path)


def _writer_gone(alive: int) -> bool:
    readable, _, _ = select.select([alive], [], [], POLL)
    return bool(readable) and os.read(alive, 1) == b""


def main() -> None:
    """Entry of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the loop stops the axis; the recorder sees it to the end
    try:
        order: Order = pickle.load(sys.stdin.buffer)
    except EOFError:  # the run failed before there was anything to record
        return
    try:
        record(order)
    except (OSError, RecordingError) as error:
        print(f"recorder: {error}", file=sys.stderr, flush=True)
        os._exit(2)  # HDF5 would try to write the rest again, at exit


if __name__ == "__main__":
    main()
