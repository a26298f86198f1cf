"""What one viewer looks at: strips that go on, a scope that waits for its trigger; from the ring to numbers to send.

A message of numbers is float64 throughout, little-endian::

    kind | channels | buckets | rows a bucket | time of the first (s) | period (s) | time of the trigger | number
    lowest  of channel 1, bucket by bucket; of channel 2; ...
    highest of channel 1, ...

Where a bucket is one row the highest values are left out: they are the lowest.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.recording.extremes import Extremes, extremes
from stagectl.recording.joined_rings import Source
from stagectl.recording.ring import Ring
from stagectl.recording.triggering import Capture, Scope, Settings
from stagectl.web.channels import Channel

STRIP, CAPTURE, DETAIL, FREE = 0.0, 1.0, 2.0, 3.0  # kinds; FREE: a capture that no trigger began
HEAD = 8  # numbers before the values, as above
Array = NDArray[np.float64]


class Window(NamedTuple):
    """What is looked at, how long and how finely."""

    channels: tuple[Channel, ...]
    span: float  # s
    points: int  # buckets at most


class Scale:
    """Rows of the ring in the units of some channels; thirty times a second, so its tables are made once."""

    def __init__(self, channels: tuple[Channel, ...]) -> None:
        self._columns = np.array([channel.column for channel in channels], dtype=np.intp)
        self._scales = np.array([channel.scale for channel in channels])

    def __call__(self, rows: Array) -> Array:
        """(n, channels) of rows (n, width)."""
        return np.asarray(rows.take(self._columns, axis=1) * self._scales)


def rows_a_bucket(span: float, points: int, dt: float) -> int:
    """Rows that share a point, so that `span` (s) has no more than `points`."""
    return max(1, -int(-span / dt // points))


class Strip:
    """Goes on as the ring does."""

    def __init__(self, ring: Ring, dt: float, window: Window) -> None:
        self._ring, self._dt, self._scale = ring, dt, Scale(window.channels)
        self.size = rows_a_bucket(window.span, window.points, dt)
        self._next = max(ring.written - round(window.span / dt), 0) // self.size * self.size

    def look(self, number: int) -> bytes | None:
        """The buckets that have become whole since the last look."""
        count = (self._ring.written - self._next) // self.size * self.size
        if count <= 0:
            return None
        first, raw = self._ring.read(self._next, count)
        skipped = -(first - self._next) % self.size if first > self._next else 0  # begin with a whole bucket again
        rows = np.frombuffer(raw).reshape(-1, self._ring.width)[skipped:]
        rows = rows[: len(rows) // self.size * self.size]
        first += skipped
        self._next = first + len(rows)
        if not len(rows):
            return None
        extrema = extremes(self._scale(rows), first, self.size)
        return packed(STRIP, extrema, self._dt, number)


class ScopeView:
    """A scope with its last capture, which can be sent again at finer resolution."""

    def __init__(self, ring: Source, dt: float, window: Window, settings: Settings) -> None:
        self._ring, self._dt, self._points, self._scale = ring, dt, window.points, Scale(window.channels)
        self._scope = Scope(settings, ring.written)
        self.held: Capture | None = None

    @property
    def waiting(self) -> tuple[float, float] | None:
        """Between what the trigger's channel has stayed, in its unit, while it does not trigger; None: no trigger."""
        trigger, (low, high) = self._scope.settings.trigger, self._scope.seen
        return (low * trigger.scale, high * trigger.scale) if trigger and low <= high else None

    def look(self, number: int) -> bytes | None:
        """The next capture, coarse."""
        capture = self._scope.look(self._ring)
        if capture is None:
            return None
        self.held = capture
        kind = CAPTURE if capture.triggered else FREE
        return self._shown(capture, (0, len(capture.rows)), self._points, (kind, number))

    def closer(self, start: float, end: float, points: int, number: int) -> bytes | None:
        """What is held between two times (s, from the trigger), in as many points as it may have."""
        if self.held is None:
            return None
        at, count = self.held.at, len(self.held.rows)
        low = min(max(int(np.floor(start / self._dt)) + at, 0), count - 1)
        high = min(max(int(np.ceil(end / self._dt)) + at + 1, low + 1), count)
        return self._shown(self.held, (low, high), points, (DETAIL, number))

    def _shown(self, capture: Capture, part: tuple[int, int], points: int, what: tuple[float, int]) -> bytes:
        low, high = part
        size = max(1, -(-(high - low) // points))
        extrema = extremes(self._scale(capture.rows[low:high]), capture.first + low, size)
        at = (capture.first + capture.at + 1) * self._dt
        return packed(what[0], extrema, self._dt, what[1], at)


def packed(kind: float, extrema: Extremes, dt: float, number: int, at: float = 0.0) -> bytes:
    """The message; row n is of the time (n + 1) dt, as the loop counts."""
    channels, buckets = extrema.low.shape
    parts = 1 if extrema.size == 1 else 2
    message = np.empty(HEAD + parts * channels * buckets, dtype="<f8")
    message[:HEAD] = kind, channels, buckets, extrema.size, (extrema.first + 1) * dt, dt, at, number
    body = message[HEAD:].reshape(parts, channels, buckets)
    body[0], body[-1] = extrema.low, extrema.high
    return message.tobytes()
