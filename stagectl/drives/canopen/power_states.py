"""The transition of a CiA 402 drive to the requested power: one controlword a period, from any state."""

from __future__ import annotations

import math

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.drive import Fault, Feedback, Power
from stagectl.drives.limits import FAULT_RESET_CYCLES, STANDING, STANDSTILL_CYCLES

_ORDERS = {
    Power.QUICK_STOP: cia402.DeviceCommand.QUICK_STOP.controlword,
    Power.OFF: cia402.DeviceCommand.DISABLE_VOLTAGE.controlword,
}


class Standstill:
    """Whether the position stays within `tolerance` (rad | m) for so many cycles, noise or not."""

    CYCLES = STANDSTILL_CYCLES

    def __init__(self, tolerance: float) -> None:
        self._tolerance, self._anchor, self._cycles = tolerance, math.nan, 0

    @classmethod
    def of_ramp(cls, deceleration: float, step: float, dt: float) -> Standstill:
        """Slower than any motion of a `deceleration` (rad/s^2 | m/s^2) that matters, with an encoder's `step`."""
        return cls(max(2.0 * step, deceleration * STANDING * STANDSTILL_CYCLES * dt))

    def stands(self, position: float) -> bool:
        """Whether the axis stands still, with this period's `position` (rad | m)."""
        if abs(position - self._anchor) <= self._tolerance:
            self._cycles += 1
        else:
            self._anchor, self._cycles = position, 0
        return self._cycles >= STANDSTILL_CYCLES


class PowerTransition:
    """The way to one power; `controlword` is that of the next period."""

    def __init__(self, power: Power, still: Standstill) -> None:
        self.power, self._still, self._cycle = power, still, 0
        self.controlword = _ORDERS.get(power, 0)

    def step(self, now: Feedback) -> DriveState:
        """Read this period's feedback; the state of the drive."""
        state, stands = cia402.state(now.statusword), self._still.stands(now.position)
        if self.power is Power.ON and now.fault is not Fault.FEEDBACK_LOST:
            self.controlword = _towards_enabled(state, self._cycle, stands)
        self._cycle += 1
        return state


def _towards_enabled(state: DriveState, cycle: int, stands: bool) -> int:
    """Controlword of the next step; a fault is reset by edges, a quick stop left when the axis stands."""
    if state is DriveState.FAULT and cycle // FAULT_RESET_CYCLES % 2 == 0:
        return 0
    if state is DriveState.QUICK_STOP_ACTIVE and stands:
        return cia402.DeviceCommand.DISABLE_VOLTAGE.controlword
    return cia402.TOWARDS_ENABLED[state].controlword
