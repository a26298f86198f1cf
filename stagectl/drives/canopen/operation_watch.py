"""What a drive under power must go on showing: statusword bits 9, 11 and 12, and its mode of operation.

::

    statusword & mask == expected      one comparison in each good period
         |
         no --> not in Operation enabled: at once
                bit 9 or 12 lost for STATUS_BIT_TIME: by name

A drive that has never shown its mode (0x6061) as cyclic synchronous torque is not ready, power or not.
Which of the bits a drive drives at all is learned under power, unless the stage file names them: it is ready as soon as
it shows them all, or after LEARNING_TIME; a bit that it never showed is not demanded.
Source: CiA 402-2 (IEC 61800-7-201), statusword and 0x6061.
"""

import math
from collections.abc import Sequence

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.fault_texts import LOST_BITS, WRONG_MODE, Deviation
from stagectl.drives.canopen.pdo import PdoMap
from stagectl.drives.limits import CERTAIN_CYCLES, LEARNING_TIME, STATUS_BIT_TIME, WRONG_MODES

_ENABLED_MASK, _ENABLED = DriveState.OPERATION_ENABLED.value
_DATA = 8  # first byte behind identifier and length
_NEVER = -1  # equals no statusword: each period is looked at
_LEARNABLE = cia402.REMOTE | cia402.FOLLOWS
_UPLOAD, _VALUE = 0x40, 0x40  # SDO: upload request; an expedited answer, by its top three bits
MODE_REQUEST = bytes([_UPLOAD, cia402.MODE_DISPLAY & 0xFF, cia402.MODE_DISPLAY >> 8, 0, 0, 0, 0, 0])


def periods(seconds: float, dt: float, least: int = 1) -> int:
    """Control periods of `dt` (s) that last `seconds`, at `least` so many."""
    return max(least, math.ceil(seconds / dt - 1e-9))


def mode_place(tpdo: PdoMap) -> int:
    """First byte of 0x6061 in a frame with this map; 0 where it is not mapped."""
    bits = 0
    for entry in tpdo.entries:
        if entry >> 8 == cia402.MODE_DISPLAY << 8:
            return _DATA + bits // 8
        bits += entry & 0xFF
    return 0


class OperationWatch:
    """The drive's statusword and mode while it has power; `mask` and `expected` are for the cyclic path."""

    def __init__(self, dt: float, bits: Sequence[int] | None) -> None:
        """With the period `dt` (s); `bits` are demanded by number, None: those that the drive shows."""
        self._named = None if bits is None else sum(1 << bit for bit in set(bits))
        self._learning_periods = periods(LEARNING_TIME, dt)
        self._patience = periods(STATUS_BIT_TIME, dt, CERTAIN_CYCLES)
        self._shown = 0  # bits that the drive has shown under power, ever
        self.wanted = cia402.CYCLIC_SYNCHRONOUS_TORQUE  # mode of operation
        self.mode_shown, self.last_mode = False, 0  # whether it has shown the wanted one; the last that it showed
        self.begin()

    def begin(self) -> None:
        """Power is being switched on: learn again what the drive shows under it."""
        self._demanded, self._learned, self._lost, self._wrong = 0, 0, 0, 0
        self.mask, self.expected = _ENABLED_MASK, _NEVER

    def want(self, mode: int) -> None:
        """Another mode of operation is ordered; in homing, bit 12 has a meaning of its own and is not demanded."""
        self.wanted, self.mode_shown, self._wrong = mode, False, 0
        homing = mode == cia402.HOMING
        self.mask, self.expected = _ENABLED_MASK, _ENABLED if homing else _NEVER

    @property
    def learned(self) -> bool:
        """Whether it has shown all that is demanded, or had the time for it: before, it may not follow commands yet."""
        return self._learned >= self._learning_periods

    @property
    def unshown(self) -> tuple[int, ...]:
        """Numbers of the bits that are not demanded, because the drive has not shown them."""
        return tuple(bit for bit in LOST_BITS if not (self._shown if self._named is None else self._named) >> bit & 1)

    def look(self, statusword: int) -> Deviation | None:
        """A statusword of Operation enabled that is not as `expected`: what is wrong, once that is certain."""
        if not self.learned:
            self._learn(statusword)
            return None
        missing = self._demanded & ~statusword
        self._lost = self._lost + 1 if missing else 0
        if self._lost >= self._patience:
            return LOST_BITS[(missing & -missing).bit_length() - 1]
        self.mask = _ENABLED_MASK | self._demanded
        self.expected = _NEVER if missing else _ENABLED | self._demanded
        return None

    def mode(self, answer: bytes) -> Deviation | None:
        """An SDO answer (eight bytes) that may be of 0x6061: what is wrong, once that is certain."""
        if answer[1:4] != MODE_REQUEST[1:4] or answer[0] & 0xE0 != _VALUE:  # aborted: it is not watched
            return None
        return self.shown_mode(int.from_bytes(answer[4:5], "little", signed=True))

    def shown_mode(self, mode: int) -> Deviation | None:
        """What is wrong with a mode of operation (0x6061) that the drive shows, once that is certain."""
        right = mode == self.wanted
        self.last_mode = mode
        self.mode_shown = self.mode_shown or right  # some show it only under power; none moves before
        self._wrong = 0 if right or not self.mode_shown else self._wrong + 1
        return WRONG_MODE.filled(mode, self.wanted) if self._wrong >= WRONG_MODES else None

    def _learn(self, statusword: int) -> None:
        self._shown |= statusword
        wanted = _LEARNABLE if self._named is None else self._named
        self._learned = self._learned + 1 if wanted & ~statusword else self._learning_periods
        if self.learned:
            self._demanded = self._shown & _LEARNABLE if self._named is None else self._named
            self.mask, self.expected = _ENABLED_MASK | self._demanded, _ENABLED | self._demanded
