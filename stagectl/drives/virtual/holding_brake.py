"""The brake of a virtual axis: worked by its drive, or by bit 0 of the drive's digital outputs (0x60FE)."""

from __future__ import annotations

from stagectl.drives.brake import Brake
from stagectl.drives.canopen.cia402 import BRAKE_BIT


class HoldingBrake:
    """`free` says whether the axis can move; without a brake it always can."""

    def __init__(self, p: Brake) -> None:
        self._p = p
        self.present, self.by_drive = p.present, p.control == "drive"
        self.engage = p.engage  # s until it holds
        self.restart()

    def restart(self) -> None:
        """As after power-on: the brake holds, and no output is worked."""
        self.free = not self.present
        self.outputs, self.mask = BRAKE_BIT, 0  # 0x60FE:01 and :02
        self._elapsed = 0.0  # s since it was told otherwise

    def advance(self, seconds: float) -> None:
        """Let time go on: an output takes effect after the brake's own time."""
        wanted = bool(self.mask & ~self.outputs & BRAKE_BIT)
        if self.by_drive or not self.present or wanted == self.free:
            self._elapsed = 0.0
            return
        self._elapsed += seconds
        if self._elapsed >= (self._p.release if wanted else self._p.engage):
            self.free = wanted
