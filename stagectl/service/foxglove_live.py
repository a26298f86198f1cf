"""Foxglove's live view: a process that sends each row of the rings to whoever has connected.

Run as ``python -m stagectl.service.foxglove_live``; one pickled `Feed` comes on standard input, one line goes out when
it listens.  It only reads: the loop does not know of it.  Messages are those of the exported MCAP, one a period, a
topic an axis; the time of a message is the wall clock's.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from typing import Any, NamedTuple

import numpy as np

from stagectl.recording.beside import order_of
from stagectl.recording.mcap_log import CDR, DEFINITION
from stagectl.recording.ring import Ring, RingPlace

POLL = 1.0 / 60.0  # s
_OFF = 0.1  # s by which the axis' own time may be behind the wall clock's
_BACKLOG = 1 << 15  # messages that a slow viewer may be behind, 16 s of an axis at 2 kHz
_NS = 1_000_000_000


class Source(NamedTuple):
    """One axis."""

    topic: str
    ring: RingPlace
    columns: tuple[int, ...]  # places in a row; the first is its time
    definition: str  # of the message, in ROS 2's language


class Feed(NamedTuple):
    """The order of this process."""

    sources: tuple[Source, ...]
    host: str
    port: int
    alive: int  # reading end of the pipe that the real-time process holds


class Topic:
    """Sends the rows of one axis; `channel` is the SDK's."""

    def __init__(self, p: Source, channel: Any) -> None:
        self._p, self._channel = p, channel
        self._ring = Ring(*p.ring)
        self._next, self._offset = self._ring.written, 0.0

    def send(self, now: float) -> None:
        """All rows since the last look, at `now` (s, wall clock); those before a viewer came are nobody's."""
        first, packed = self._ring.read(self._next, self._ring.capacity)
        rows = np.frombuffer(packed).reshape(-1, self._ring.width)[:, self._p.columns]
        self._next = first + len(rows)
        if not len(rows):
            return
        # Only ever forwards: a period that was left out is none in the axis' own time.
        if (late := now - self._offset - float(rows[-1, 0])) > _OFF:
            self._offset += late
        if self._channel.has_sinks():
            for row in rows:
                self._channel.log(CDR + row.tobytes(), log_time=round((self._offset + float(row[0])) * _NS))


def serve(p: Feed) -> None:
    """Send until the real-time process is gone.  Exits with the reason where it cannot listen."""
    import foxglove

    try:
        server = foxglove.start_server(name="stagectl", host=p.host, port=p.port, message_backlog_size=_BACKLOG)
    except RuntimeError as error:
        sys.exit(f"--foxglove {p.host}:{p.port}: {error}; take another port")
    topics = [Topic(source, _channel(source)) for source in p.sources]
    print(f"ws://{p.host}:{server.port}", flush=True)
    while not select.select([p.alive], [], [], POLL)[0]:
        for topic in topics:
            topic.send(time.time())
    server.stop()


def _channel(p: Source) -> Any:
    from foxglove import Channel, Schema

    schema = Schema(name=DEFINITION, encoding="ros2msg", data=p.definition.encode())
    return Channel(f"/{p.topic}", schema=schema, message_encoding="cdr")


def main() -> None:
    """Entry of the process; signals to the service's group are none of its business: it ends with the loop."""
    serve(order_of(signal.SIGINT, signal.SIGTERM))
    os._exit(0)  # its server has threads of its own


if __name__ == "__main__":
    main()
