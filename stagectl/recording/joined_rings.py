"""Rings of axes that one process writes, side by side: a row is what all of them wrote in the same period.

Each ring counts its own rows, from when its drive was connected on; in one period the first axis writes first::

    x   |  7 |  8 |  9 | 10 |          ahead of y by 4, always,
    y        |  3 |  4 |  5 |  6 |     but for the moment in which x has written and y has not: then by 5
"""

import time
from collections.abc import Sequence

import numpy as np

from stagectl.recording.constants import LOOK_PAUSE, LOOK_TRIES, LOOKS, REJOIN
from stagectl.recording.ring import Ring


class Joined:
    """Reads as a `Ring` does; its rows have the number of the first ring's."""

    def __init__(self, rings: Sequence[Ring]) -> None:
        """`rings` in the order in which their axes are served."""
        self.rings = tuple(rings)
        self.width = sum(ring.width for ring in rings)
        self.capacity = min(ring.capacity for ring in rings)
        self._ahead = [ahead(rings[0], ring) for ring in rings]
        self._since = time.monotonic()

    @property
    def written(self) -> int:
        """Rows that all have written."""
        return min(ring.written + ahead for ring, ahead in zip(self.rings, self._ahead, strict=True))

    @property
    def apart(self) -> bool:
        """Whether one of them has stood still, or began again, since they were joined."""
        if time.monotonic() - self._since < REJOIN:
            return False
        leader = self.rings[0].written
        return any(abs(leader - ring.written - n) > LOOKS for ring, n in zip(self.rings, self._ahead, strict=True))

    def read(self, start: int, most: int) -> tuple[int, bytes]:
        """As `Ring.read`: the rows that all of them still have."""
        end = min(start + most, self.written)
        parts, firsts = [], []
        for ring, n in zip(self.rings, self._ahead, strict=True):
            first, raw = ring.read(max(start - n, 0), end - start)
            parts.append(np.frombuffer(raw).reshape(-1, ring.width)[: max(end - n - first, 0)])
            firsts.append(first + n)
        begin = max(firsts)
        kept = [part[begin - first :] for part, first in zip(parts, firsts, strict=True)]
        count = min(map(len, kept))
        return begin, np.hstack([part[:count] for part in kept]).tobytes()


Source = Ring | Joined


def ahead(leader: Ring, ring: Ring) -> int:
    """Rows that `leader` has more, once both have written in a period."""
    differences = []
    for _ in range(LOOK_TRIES):
        before, other = leader.written, ring.written
        if leader.written == before:  # no period has begun in between
            differences.append(before - other)
        if len(differences) == LOOKS:
            break
        time.sleep(LOOK_PAUSE)
    return min(differences)
