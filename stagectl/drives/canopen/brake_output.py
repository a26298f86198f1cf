"""A brake at the drive's digital outputs (0x60FE), worked by SDO beside the cycle, and read back.

::

    order  --- write 0x60FE:01 --->      again after BRAKE_REPEAT_CYCLES, until it is confirmed
           <-- taken --------------
           --- read -------------->
           <-- outputs ------------      confirmed where bit 0 is as ordered, or the drive does not let it be read
"""

import struct
from collections.abc import Callable

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.fault_texts import UNTAKEN_BRAKE, Deviation
from stagectl.drives.limits import BRAKE_REPEAT_CYCLES

_OUTPUTS = struct.pack("<HB", cia402.DIGITAL_OUTPUTS, 1)
_KIND, _TAKEN, _VALUE, _ABORTED = 0xE0, 0x60, 0x40, 0x80  # of an SDO answer, by its top three bits


class BrakeOutput:
    """The last order to the brake, which nothing confirms but the drive."""

    def __init__(self, works: bool, write: Callable[[int, int, int], None], read: Callable[[int, int], None]) -> None:
        """Where it `works` the brake, by requests to `write` and `read` an object, which wait for no answer.

        Otherwise the drive works it by itself, and all is confirmed.
        """
        self._works, self._write, self._read = works, write, read
        self._engaged = self._confirmed = True
        self._asked = self._repeated = False
        self._periods = 0  # since the order

    @property
    def problem(self) -> Deviation | None:
        """What is wrong while an order is not confirmed, though it was repeated."""
        missing = self._repeated and not self._confirmed
        return UNTAKEN_BRAKE.filled("set" if self._engaged else "released") if missing else None

    def order(self, engaged: bool) -> None:
        """Set the brake (True), or release it."""
        self._engaged, self._repeated = engaged, False
        self._send()

    def _send(self) -> None:
        self._confirmed, self._asked, self._periods = not self._works, False, 0
        if self._works:
            self._write(cia402.DIGITAL_OUTPUTS, 1, cia402.BRAKE_BIT * self._engaged)

    def confirmed(self) -> bool:
        """Whether the drive has it as ordered; asked once a period, as an order that is lost is given again."""
        if not self._confirmed:
            self._periods += 1
            if self._periods >= BRAKE_REPEAT_CYCLES:
                self._repeated = True
                self._send()
        return self._confirmed

    def hear(self, answer: bytes) -> None:
        """An SDO answer (eight bytes) that may be of the outputs."""
        if self._confirmed or answer[1:4] != _OUTPUTS:
            return
        kind = answer[0] & _KIND
        if kind == _TAKEN:
            self._asked = True
            self._read(cia402.DIGITAL_OUTPUTS, 1)
        elif kind == _VALUE:
            self._confirmed = bool(answer[4] & cia402.BRAKE_BIT) == self._engaged
        elif kind == _ABORTED:
            self._confirmed = self._asked  # the write was taken, and the outputs cannot be read
