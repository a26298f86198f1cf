"""How late the periods of the last minute began, as a histogram; counted from the ring, when somebody asks."""

from __future__ import annotations

import collections
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.recording.ring import Ring
from stagectl.service.axis_controller import COLUMNS
from stagectl.web.limits import EDGES, KEPT

_COLUMN = COLUMNS.index("lateness")


class _Part(NamedTuple):
    rows: int
    counts: NDArray[np.intp]
    largest: float


class Lateness:
    """Of one axis' ring."""

    def __init__(self, ring: Ring, dt: float) -> None:
        self.ring, self._most = ring, round(KEPT / dt)
        self._done, self._rows = 0, 0
        self._parts: collections.deque[_Part] = collections.deque()
        self._counts = np.zeros(len(EDGES) + 1, dtype=np.intp)  # of all parts: reported ten times a second

    def histogram(self) -> dict[str, Any]:
        """Counts below the first edge, between two edges, and from the last one on; largest (s); rows counted."""
        self._count()
        return {
            "edges": list(EDGES),
            "counts": self._counts.tolist(),
            "largest": max((part.largest for part in self._parts), default=0.0),
            "rows": self._rows,
        }

    def _count(self) -> None:
        first, raw = self.ring.read(self._done, self.ring.capacity)
        late = np.frombuffer(raw).reshape(-1, self.ring.width)[:, _COLUMN]
        self._done = first + len(late)
        if not len(late):
            return
        places = np.searchsorted(EDGES, late, side="right")
        part = _Part(len(late), np.bincount(places, minlength=len(EDGES) + 1), float(late.max()))
        self._parts.append(part)
        self._rows, self._counts = self._rows + part.rows, self._counts + part.counts
        while self._rows - self._parts[0].rows >= self._most:
            old = self._parts.popleft()
            self._rows, self._counts = self._rows - old.rows, self._counts - old.counts
