"""The twin's process: reads the loop's ring next to the recorder, compiled, and costs the loop nothing.

Run as ``python -m stagectl.twin.process``, with one pickled `TwinOrder` on standard input and, once it is ready, a line
with the position that the run begins at.  Every second it replaces a small file with what it sees now, every minute it
adds a line to the slow record; both are JSON.  It only reads the ring: no lock, no pipe, no call of the loop's depends
on it, and it may be killed at any time.
"""

import contextlib
import json
import math
import os
import signal
import sys
import time
from collections import deque
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.kernels import jit, law, rollout, stage
from stagectl.recording.beside import order_of, word_of
from stagectl.recording.ring import Ring, RingPlace
from stagectl.twin.estimate import status_of
from stagectl.twin.live_model import Twin, TwinBlock, TwinState, pieces, step, twin_of
from stagectl.twin.record import add, line_of, snapshot
from stagectl.twin.thresholds import BLOCK, NICENESS, POLL_PERIOD, SNAPSHOT_PERIOD, TOO_FAR_BEHIND, WINDOW


class TwinOrder(NamedTuple):
    """The axis that the twin runs next to, and where it writes."""

    ring: RingPlace
    alive: int  # descriptor of the pipe's reading end
    law: law.Law
    stage: stage.Stage
    dt: float
    about: dict[str, Any]  # name, kind, travel_per_unit, travel_unit, recording
    live: str  # file of the snapshot
    record: str  # slow record
    avoid: int | None  # CPU of the loop


class RingFollower:
    """The mutable shell around `live_model.step`: where in the ring it is, and what it has seen."""

    def __init__(self, order: TwinOrder, ring: Ring) -> None:
        self.order, self.ring = order, ring
        self.twin: Twin = twin_of(restored(order.law), restored(order.stage), order.dt)
        self.state: TwinState | None = None
        self.size = max(1, round(BLOCK / order.dt))
        self.live: deque[TwinBlock] = deque(maxlen=round(WINDOW / BLOCK))
        self.minute: list[TwinBlock] = []
        self.done, self.skipped, self.lag = 0, 0, 0

    def stands_at(self, line: bytes) -> None:
        """Where the run begins, as the drive counts (rad | m): a line of the run's; empty or NaN: not known."""
        origin = float(line or "nan")
        if math.isfinite(origin):
            self.twin = self.twin._replace(origin=origin)

    def catch_up(self, over: bool) -> None:
        """Take all whole blocks in the ring; the last, incomplete one too where the run is `over`."""
        self.lag = self.ring.written - self.done
        if self.lag > TOO_FAR_BEHIND * self.ring.capacity:
            self._skip(self.ring.written - self.size)
        while (waiting := self.ring.written - self.done) >= (1 if over else self.size):
            first, rows = self.ring.read(self.done, min(self.size, waiting))
            if first != self.done:
                self._skip(first)
            self.done += len(rows) // (8 * self.ring.width)
            self._take(np.frombuffer(rows).reshape(-1, self.ring.width))

    def _skip(self, to: int) -> None:
        """Go on at row `to`: a gap in time, which `live_model.step` notices."""
        self.skipped += to - self.done
        self.done = to

    def _take(self, rows: Array) -> None:
        for piece in pieces(rows, self.order.dt):
            block, self.state = step(self.twin, self.state, piece)
            self.live.append(block)
            self.minute.append(block)
        if sum(block.rows for block in self.minute) * self.order.dt >= WINDOW:
            self.note()

    def note(self) -> None:
        """Add a line to the slow record, of all since the last one, where the motion determined something."""
        line = line_of(self.order.about, status_of(self.twin, self.minute), time.time()) if self.minute else None
        if line is not None:
            add(Path(self.order.record), line)
        self.minute = []

    def show(self, ended: str, spent: float) -> None:
        """Replace the live file: a reader sees the old one or the new one, never a part."""
        if not self.live:
            return
        about = {
            **self.order.about,
            "process": os.getpid(),
            "written": time.time(),
            "ended": ended,
            "rows": self.done - self.skipped,
            "skipped_rows": self.skipped,
            "behind": self.lag * self.order.dt,
            "cpu_share": spent / max((self.done - self.skipped) * self.order.dt, 1e-9),
        }
        text = json.dumps(snapshot(status_of(self.twin, list(self.live)), about))
        path = Path(self.order.live)
        new = path.with_name(f".{path.name}.new")
        new.write_text(text + "\n", encoding="utf-8")
        new.replace(path)


def restored(p: Any) -> Any:
    """A block of parameters whose tables are what compiled kernels take; the inverse of `meta.portable`."""
    if hasattr(p, "_fields"):
        return type(p)(*map(restored, p))
    return jit.table(p) if isinstance(p, tuple) else p


def watch(order: TwinOrder) -> None:
    """Follow the ring until it closes or its writer is gone."""
    ring = Ring(*order.ring)
    _warmed(order, ring)
    follower = RingFollower(order, ring)
    print("ready", flush=True)
    follower.stands_at(sys.stdin.buffer.readline())
    start, shown = time.thread_time(), time.monotonic()
    while True:
        over = ring.closed or word_of(order.alive, POLL_PERIOD) == b""
        follower.catch_up(over)
        if over:
            break
        if time.monotonic() - shown >= SNAPSHOT_PERIOD:
            shown = time.monotonic()
            follower.show("", time.thread_time() - start)
    follower.note()
    follower.show("complete" if ring.closed else "the loop process died", time.thread_time() - start)


def _warmed(order: TwinOrder, ring: Ring) -> None:
    """Compile, before anything moves: two rows at rest."""
    rows = np.zeros((2, rollout.WIDTH))
    rows[:, 0] = (0.0, order.dt)
    step(RingFollower(order, ring).twin, None, rows)


def _stand_back(avoid: int | None) -> None:
    """The loop comes first: lower priority, and not on its CPU where there is another one."""
    with contextlib.suppress(OSError):
        os.nice(NICENESS)
    others = os.sched_getaffinity(0) - {avoid}
    if avoid is not None and others:
        os.sched_setaffinity(0, others)


def main() -> None:
    """Entry of the process."""
    order: TwinOrder | None = order_of(signal.SIGINT)
    if order is None:
        return
    _stand_back(order.avoid)
    try:
        watch(order)
    except OSError as error:
        print(f"twin: {error}", file=sys.stderr, flush=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
