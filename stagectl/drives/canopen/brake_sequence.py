"""When a brake is released and engaged under a CiA 402 drive: torque before release, and after engagement."""

from __future__ import annotations

import math
from collections.abc import Callable

from stagectl.drives.brake import Brake
from stagectl.drives.limits import TORQUE_TIME


class BrakeSequence:
    """When a brake is released and engaged, period by period."""

    def __init__(self, brake: Brake, dt: float, output: Callable[[bool], None]) -> None:
        """With the period `dt` (s); `output` sets (True) or releases the brake where we work it."""
        self.present = brake.present
        self._output = output if brake.control == "output" else _nobody
        self._torque = math.ceil(TORQUE_TIME / dt) if brake.present else 0
        self._free = self._torque + math.ceil(brake.release / dt)
        self.engaging = math.ceil(brake.engage / dt) if brake.present else 0  # periods until it holds
        self.keeps_enabled = brake.control == "output"  # while it engages
        self._powered = 0  # periods in Operation enabled

    def released(self) -> bool:
        """Whether the axis may move, one period of Operation enabled later; releases the brake on the way."""
        if not self.present:
            return True
        if self._powered == self._torque:
            self._output(False)
        self._powered += 1
        return self._powered > self._free

    def engage(self) -> None:
        """Set the brake; it holds `engaging` periods later."""
        self._powered = 0
        self._output(True)


def _nobody(engaged: bool) -> None:
    """The drive works its brake by itself."""
