"""Virtual time: a clock that jumps to the next event, and a bus of two ends with true transmission times on it.

A controller that waits lets the other end run.  Nothing sleeps, so a simulated second takes as long as its events.
"""

from __future__ import annotations

import collections
import heapq
import itertools
from collections.abc import Callable

from stagectl.drives.cycle_time import frame_bits


class Timeline:
    """A clock whose time goes on only while somebody waits on it."""

    def __init__(self) -> None:
        self._now = 0.0
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._serial = itertools.count()

    def now(self) -> float:
        """Virtual time (s)."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Let `seconds` pass, with all events in them."""
        self.run(self._now + seconds, lambda: False)

    def at(self, time: float, event: Callable[[], None]) -> None:
        """Schedule `event` at `time` (s)."""
        heapq.heappush(self._events, (time, next(self._serial), event))

    def every(self, period: float, event: Callable[[], None]) -> None:
        """Schedule `event` every `period` (s) from now on."""
        due = self._now + period

        def again() -> None:
            nonlocal due
            due += period
            self.at(due, again)
            event()

        self.at(due, again)

    def run(self, until: float, done: Callable[[], bool]) -> None:
        """Let time go on to `until` (s), or to the event after which it is `done`."""
        events = self._events
        while not done():
            if not events or events[0][0] > until:
                self._now = max(self._now, until)
                return
            time, _, event = heapq.heappop(events)
            self._now = max(self._now, time)
            event()


class End:
    """One end of a bus with two."""

    def __init__(self, timeline: Timeline, wire: Wire) -> None:
        self._timeline, self._wire = timeline, wire
        self.wakes: Callable[[], None] | None = None  # is called for each frame that arrives; then it never waits
        self.inbox: collections.deque[bytes] = collections.deque()
        self.down = False

    def send(self, frame: bytes) -> None:
        """Put a frame on the wire.  Raises OSError where the interface is down."""
        if self.down:
            raise OSError("network is down")
        self._wire.carry(self, frame)

    def receive(self, timeout: float) -> bytes | None:
        """Next frame, or None after `timeout` (s)."""
        if self.down:
            raise OSError("network is down")
        if not self.inbox and timeout > 0.0 and self.wakes is None:
            self._timeline.run(self._timeline.now() + timeout, lambda: bool(self.inbox))
        return self.inbox.popleft() if self.inbox else None

    def take(self, frame: bytes) -> None:
        """A frame has arrived."""
        self.inbox.append(frame)
        if self.wakes is not None:
            self.wakes()

    def close(self) -> None:
        """Nothing to close."""


class Wire:
    """The wire between two ends: one frame at a time, each as long as its bits take at worst."""

    def __init__(self, timeline: Timeline, bitrate: float) -> None:
        self._timeline, self._bitrate, self._free = timeline, bitrate, 0.0
        self.ends = (End(timeline, self), End(timeline, self))

    def carry(self, sender: End, frame: bytes) -> None:
        """Send a frame to the other end as soon as the wire is free."""
        other = self.ends[0] if sender is self.ends[1] else self.ends[1]
        self._free = max(self._free, self._timeline.now()) + frame_bits(min(frame[4], 8)) / self._bitrate
        self._timeline.at(self._free, lambda: other.take(frame))
