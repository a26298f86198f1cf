"""What the service and the real-time process share of one axis: orders in, status out, setpoints ahead.

::

    service  -- order ---->  16 slots, each with its number; the loop looks at two counts a period
    service,   -- stop ---->  counts of stops, which need no slot; they come first, and make all earlier orders void
    stop path
             <-- verdict --  next to each order: taken or refused
             <-- status ---  one block, under a sequence count: at each change of state, and every 4 ms
             <-- words ----  why it stopped, as text, under a count of its own
             -- setpoints ->  a ring of rows; a motion may be longer than it, then it is filled up as it goes

One writer a field, no locks, no waiting: whatever the service does, or fails to do, costs the loop one look.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Sequence
from typing import NamedTuple

from stagectl.kernels import law
from stagectl.recording.ring import counts, shared
from stagectl.units import StageError

SLOTS, SLOT = 16, 1024  # orders, and bytes of each
AHEAD = 1 << 15  # rows of setpoints, 16 s at 2 kHz
_HEAD = 32  # bytes of a slot before the numbers: verdict and `_ORDER`
NUMBERS = (SLOT - _HEAD) // 8
_ORDER = struct.Struct("<QQQ")  # kind, count of its numbers, stops that there were when it was given
_ROW = struct.Struct(f"<{len(law.Setpoint._fields)}d")
_STATUS, _TEXT, _ORDERS, _ROWS = 64, 1024, 8192, 32768  # bytes from the start
_WRITTEN, _FILLED, _SEQUENCE, _LENGTH = 0, 1, 2, _TEXT // 8  # places among the counts
_STOPS, _HEEDED = 3, 4  # places of two words, each of four counts of 16 bits: stops asked for, and those taken
INTERFACE, STOP_PATH = 0, 2  # who asks for a stop: each has counts of its own, so that no writer waits for the other
HOLD, CUT = 0, 1  # its kind: brake and hold (category 2); brake, then power off (category 1)
_LONGEST = _ORDERS - _TEXT - 16  # bytes of text
PENDING, TAKEN, REFUSED = 0, 1, 2
_LOOKS = 1000  # at a status that is being written: longer than that only a process that died over it writes


class Status(NamedTuple):
    """One axis now, in axis units; every field is a number, so that it fits the board."""

    state: float = 0.0  # states.State
    fault: float = 0.0  # drives.drive.Fault that is in force, or was the last to stop the axis
    faults: float = 0.0  # count of them
    cycles: float = 0.0
    late: float = 0.0
    tick: float = 0.0  # s, monotonic clock, of the last sign of life
    patience: float = 0.0  # s after it that the next one may take
    position: float = 0.0  # rad | m
    speed: float = 0.0
    reference: float = 0.0
    target: float = 0.0  # what the encoder is to read: the reference, and what the encoder's map adds to it
    error: float = 0.0
    current: float = 0.0  # A
    statusword: float = 0.0
    homed: float = 0.0
    row: float = 0.0  # of the motion
    rows: float = 0.0
    motions: float = 0.0  # begun
    settled: float = 0.0  # s within the window of in position
    heat: float = 0.0  # A^2
    stop_time: float = 0.0  # s that the last stop took
    stop_distance: float = 0.0  # rad | m
    power: float = 0.0  # 1: our law acts


class Order(NamedTuple):
    """Something to be done."""

    kind: int
    numbers: tuple[float, ...] = ()
    stops: int | None = None  # `Board.stops` when it was asked for; None: now.  A stop since then makes it void


class Move(NamedTuple):
    """The numbers of an order to move: rows that are on the board, relative to where the motion begins."""

    first: float  # number of the first row
    rows: float
    low: float  # rad | m, lowest and highest position
    high: float
    together: float  # axes that begin in the same period


class BoardFullError(StageError):
    """An order that there is no room for: the loop takes none at present."""


_PACKED = struct.Struct(f"<{len(Status._fields)}d")


def _slot(number: int) -> int:
    """First byte of an order's slot: its verdict."""
    return _ORDERS + number % SLOTS * SLOT


class Board:
    """The shared memory of one axis; the service's side and the loop's side of it."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        size = os.fstat(descriptor).st_size
        self.memory, self.ahead = mmap.mmap(descriptor, size), (size - _ROWS) // _ROW.size
        self._pack, self._unpack = _PACKED.pack_into, _ROW.unpack_from  # looked up once, not in every period
        self._counts = counts(self.memory, _ROWS)
        self._stop_counts = memoryview(self.memory)[8 * _STOPS : 8 * _HEEDED].cast("H")
        self._heeded_counts = memoryview(self.memory)[8 * _HEEDED : 8 * _HEEDED + 8].cast("H")
        self._looked = self.ordered  # the next order to be taken
        self._stops = self._counts[_HEEDED]  # as the loop has seen them: one that came before its start still counts
        self._whole = Status()  # the last one that was read whole

    @classmethod
    def create(cls, ahead: int = AHEAD) -> Board:
        """New shared memory for `ahead` rows; its descriptor is inherited by the processes it is handed to."""
        return cls(shared("board", _ROWS + ahead * _ROW.size))

    # the service's side

    @property
    def ordered(self) -> int:
        """Orders given."""
        return self._counts[_WRITTEN]

    def order(self, order: Order) -> int:
        """Give an order; its number.  Raises BoardFullError where the loop has taken none of the last `SLOTS`."""
        number = self.ordered
        if number >= SLOTS and self.verdict(number - SLOTS) == PENDING:
            raise BoardFullError(
                f"{SLOTS} orders wait already, and the real-time process takes none while it configures a drive: "
                "`stagectl status`, then try again"
            )
        start = _slot(number)
        self._counts[start // 8] = PENDING
        stops = self.stops if order.stops is None else order.stops
        _ORDER.pack_into(self.memory, start + 8, order.kind, len(order.numbers), stops)
        struct.pack_into(f"<{len(order.numbers)}d", self.memory, start + _HEAD, *order.numbers)
        self._counts[_WRITTEN] = number + 1
        return number

    @property
    def stops(self) -> int:
        """The stops asked for so far, as one word; another word means that there has been one."""
        return self._counts[_STOPS]

    def stop(self, writer: int, kind: int) -> None:
        """Ask for a stop (HOLD or CUT): it is never refused, waits for nothing, and makes all earlier orders void."""
        place = writer + kind
        self._stop_counts[place] = (self._stop_counts[place] + 1) & 0xFFFF

    def heeded(self, writer: int) -> bool:
        """Whether the loop has taken all stops that this writer has asked for."""
        both = slice(writer, writer + 2)
        return self._stop_counts[both] == self._heeded_counts[both]

    def verdict(self, number: int) -> int:
        """What became of an order: PENDING, TAKEN or REFUSED."""
        return self._counts[_slot(number) // 8]

    def status(self) -> Status:
        """A status that was whole when it was read; the last such one where the writer died in the middle of it."""
        for _ in range(_LOOKS):
            before = self._counts[_SEQUENCE]
            numbers = _PACKED.unpack_from(self.memory, _STATUS)
            if before % 2 == 0 and before == self._counts[_SEQUENCE]:
                self._whole = Status(*numbers)
                break
        return self._whole

    @property
    def words(self) -> str:
        """The last thing that the loop had to say."""
        length = self._counts[_LENGTH]
        return bytes(self.memory[_TEXT + 8 : _TEXT + 8 + length]).decode(errors="replace")

    @property
    def filled(self) -> int:
        """Rows of setpoints put in so far."""
        return self._counts[_FILLED]

    def fill(self, rows: bytes) -> None:
        """Put rows behind the last one; there must be room: see `ahead`."""
        number, count, done = self.filled, len(rows) // _ROW.size, 0
        while done < count:
            slot = (number + done) % self.ahead
            run = min(count - done, self.ahead - slot)
            begin = _ROWS + slot * _ROW.size
            self.memory[begin : begin + run * _ROW.size] = rows[done * _ROW.size : (done + run) * _ROW.size]
            done += run
        self._counts[_FILLED] = number + count

    # the loop's side

    @property
    def called(self) -> bool:
        """Whether there is an order or a stop to look at."""
        return self._counts[_WRITTEN] != self._looked or self._counts[_STOPS] != self._stops

    def next_stops(self) -> list[int]:
        """The kinds of stop that are due, the gentlest first; they must be heeded."""
        word = self._counts[_STOPS]
        changed, self._stops = word ^ self._stops, word
        return [kind for kind in (HOLD, CUT) if any(changed >> 16 * (writer + kind) & 0xFFFF for writer in (0, 2))]

    def heed(self) -> None:
        """The stops that were due are taken, and the status shows what follows from them."""
        self._counts[_HEEDED] = self._stops

    def next_order(self) -> Order | None:
        """The order that is due, if there is one; it must be answered.  One from before a stop is refused here."""
        while self.ordered != self._looked:
            start = _slot(self._looked)
            kind, count, stops = _ORDER.unpack_from(self.memory, start + 8)
            if stops == self._stops:
                return Order(kind, struct.unpack_from(f"<{min(count, NUMBERS)}d", self.memory, start + _HEAD))
            if stops == self.stops:  # given after a stop that has come since the loop looked: that one is first
                return None
            self.answer(False)
        return None

    @property
    def waiting(self) -> int:
        """Orders that are not answered yet."""
        return self._counts[_WRITTEN] - self._looked

    def answer(self, taken: bool) -> None:
        """What becomes of the order that was due."""
        self._counts[_slot(self._looked) // 8] = TAKEN if taken else REFUSED
        self._looked += 1

    def show(self, status: Sequence[float]) -> None:
        """Put the status, the fields of `Status`, where the service sees it."""
        places = self._counts
        sequence = places[_SEQUENCE]
        places[_SEQUENCE] = sequence + 1
        self._pack(self.memory, _STATUS, *status)
        places[_SEQUENCE] = sequence + 2

    def say(self, words: str) -> None:
        """Tell something in words."""
        text = words.encode()[:_LONGEST]
        self.memory[_TEXT + 8 : _TEXT + 8 + len(text)] = text
        self._counts[_LENGTH] = len(text)

    def setpoint(self, number: int, origin: float = 0.0) -> law.Setpoint | None:
        """The row of this number, moved to `origin` (rad | m); None where it has not been put in yet."""
        if number >= self._counts[_FILLED]:
            return None
        row = self._unpack(self.memory, _ROWS + number % self.ahead * _ROW.size)
        return law.Setpoint._make((row[0] + origin, row[1] + origin, *row[2:]))
