"""Rows from the loop to whoever listens, through shared memory: one writer that never waits.

::

    | written | closed |  row 0 | row 1 | ... | row capacity-1 |
      uint64    uint64    width x float64 each

The writer counts up after each row; a reader that falls more than `capacity` rows behind has lost some, and
knows how many.  The memory has no name: its file descriptor is inherited, and it goes with its last user.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Sequence
from typing import NamedTuple

HEADER = 64
_WRITTEN, _CLOSED = 0, 1  # places among the counts


def counts(memory: mmap.mmap, size: int) -> memoryview:
    """The first `size` bytes of shared memory as uint64, each written in a single store.

    Nothing else will do for a number that another process looks at: `struct` clears the bytes that it packs into, and
    a reader sees a count of 0 now and then (2 % of the looks at one that is counted up all the time).
    """
    return memoryview(memory)[:size].cast("Q")


class RingPlace(NamedTuple):
    """Where a ring is, for another process: `Ring(*place)` joins it."""

    descriptor: int
    width: int
    capacity: int


def shared(name: str, size: int) -> int:
    """The descriptor of new shared memory of so many bytes, which is a file to the system.  Raises OSError."""
    descriptor = os.memfd_create(f"stagectl-{name}")
    try:
        os.ftruncate(descriptor, size)
    except OSError as error:
        os.close(descriptor)
        error.filename = f"the axis' shared memory ({name}, {size} bytes)"
        raise
    return descriptor


class Ring:
    """Shared rows of `width` float64; create with `Ring.create`, join with the descriptor."""

    def __init__(self, descriptor: int, width: int, capacity: int) -> None:
        self.descriptor, self.width, self.capacity = descriptor, width, capacity
        self.memory = mmap.mmap(descriptor, HEADER + 8 * width * capacity)
        self._row = struct.Struct(f"<{width}d")
        self._pack = self._row.pack_into  # looked up once, not in every cycle
        self._counts = counts(self.memory, HEADER)
        self._written = self.written

    @classmethod
    def create(cls, width: int, capacity: int = 1 << 15) -> Ring:
        """New shared memory; its descriptor is inheritable by the processes it is handed to."""
        return cls(shared("ring", HEADER + 8 * width * capacity), width, capacity)

    @property
    def place(self) -> RingPlace:
        """What another process joins it by."""
        return RingPlace(self.descriptor, self.width, self.capacity)

    @property
    def written(self) -> int:
        """Rows written since the start."""
        return self._counts[_WRITTEN]

    @property
    def closed(self) -> bool:
        """Whether the writer has said that no more rows will come."""
        return bool(self._counts[_CLOSED])

    def write(self, row: Sequence[float]) -> None:
        """Add one row; never waits, never fails."""
        written = self._written
        self._pack(self.memory, HEADER + written % self.capacity * self._row.size, *row)
        self._written = self._counts[_WRITTEN] = written + 1

    def close(self) -> None:
        """Say that no more rows will come."""
        self._counts[_CLOSED] = 1

    def read(self, start: int, most: int) -> tuple[int, bytes]:
        """Rows from number `start` on, at most `most`: (number of the first one returned, their bytes).

        The first number is larger than `start` where the rows between have been overwritten.
        """
        first = max(start, self.written - self.capacity)
        count = min(self.written - first, most)
        parts, number = [], first
        while number < first + count:
            slot = number % self.capacity
            run = min(first + count - number, self.capacity - slot)
            begin = HEADER + slot * self._row.size
            parts.append(self.memory[begin : begin + run * self._row.size])
            number += run
        overwritten = max(0, self.written - self.capacity - first)  # while this was copying
        return first + overwritten, b"".join(parts)[overwritten * self._row.size :]
