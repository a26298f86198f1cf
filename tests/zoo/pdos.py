"""Process data of a foreign drive: mappings as the object dictionary holds them, SYNC, and late answers."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from tests.zoo.variants import PDO_LOST

Number = Callable[[int], int]
_SYNCHRONOUS = 240  # the largest synchronous transmission type


class Pdo:
    """One PDO by the indices of its parameter and mapping records."""

    def __init__(self, number: Number, parameters: int, mapping: int) -> None:
        """Of the records at these indices."""
        self._number, self._parameters, self._mapping = number, parameters, mapping
        self.mapped: list[tuple[int, int]] = []  # key and bytes
        self.cob_id = self.transmission = self.length = 0
        self.valid = False
        self._syncs = 0

    def configure(self) -> None:
        """Read what the dictionary holds now."""
        cob_id = self._number(self._parameters << 8 | 1)
        self.valid, self.cob_id = not cob_id & PDO_LOST, cob_id & 0x7FF
        self.transmission = self._number(self._parameters << 8 | 2)
        entries = [self._number(self._mapping << 8 | n + 1) for n in range(self._number(self._mapping << 8))]
        self.mapped = [(entry >> 8, (entry & 0xFF) // 8) for entry in entries if entry]
        self.length = sum(size for _, size in self.mapped)

    @property
    def synchronous(self) -> bool:
        """Whether it belongs to SYNC."""
        return self.transmission <= _SYNCHRONOUS

    def due(self) -> bool:
        """Whether this SYNC wants it; types 2 to 240 take each so many-th."""
        if not self.valid or not self.synchronous or not self.mapped:
            return False
        self._syncs += 1
        return self._syncs % max(self.transmission, 1) == 0

    def packed(self, raw: Callable[[int], bytes]) -> bytes:
        """The frame's data."""
        return b"".join(raw(key)[:size] for key, size in self.mapped)

    def unpacked(self, data: bytes) -> dict[int, bytes]:
        """Values by key; data must be long enough."""
        values, place = {}, 0
        for key, size in self.mapped:
            values[key] = data[place : place + size]
            place += size
        return values


class Answers:
    """What TPDO 1 sends: the present answer, an older one, or always the same."""

    def __init__(self, age: int) -> None:
        """`age` periods old."""
        self._kept: deque[bytes] = deque(maxlen=age + 1)
        self.frozen = self.silent = False

    def next(self, present: bytes) -> bytes | None:
        """What goes out now; None: nothing."""
        if not self.frozen or not self._kept:
            self._kept.append(present)
        return None if self.silent else self._kept[0]
