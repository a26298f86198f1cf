"""The transition of a CiA 402 drive to the requested power: one controlword a period, from any state but Fault.

With a brake, torque comes before its release and stays until it holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from stagectl.drives import limits
from stagectl.drives.brake import Brake
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.drive import Fault, Feedback, Power

_OFF = cia402.DeviceCommand.DISABLE_VOLTAGE.controlword
_ORDERS = {Power.QUICK_STOP: cia402.DeviceCommand.QUICK_STOP.controlword}


class Standstill:
    """Whether the position stays within `tolerance` (rad | m) for so many cycles, noise or not."""

    def __init__(self, tolerance: float) -> None:
        self._tolerance, self._anchor, self._cycles = tolerance, math.nan, 0

    @classmethod
    def of_ramp(cls, deceleration: float, step: float, dt: float) -> Standstill:
        """Slower than any motion of a `deceleration` (rad/s^2 | m/s^2) that matters, with an encoder's `step`."""
        return cls(max(2.0 * step, deceleration * limits.STANDING * limits.STANDSTILL_CYCLES * dt))

    def stands(self, position: float) -> bool:
        """Whether the axis stands still, with this period's `position` (rad | m)."""
        if abs(position - self._anchor) <= self._tolerance:
            self._cycles += 1
        else:
            self._anchor, self._cycles = position, 0
        return self._cycles >= limits.STANDSTILL_CYCLES


class PowerTransition:
    """The way to one power; `controlword` is that of the next period."""

    def __init__(self, power: Power, still: Standstill, engaging: int = 0, holding: int = _OFF) -> None:
        """Where a brake takes `engaging` periods to hold, the controlword is `holding` so long before power is cut."""
        self.power, self._still, self._engaging = power, still, engaging
        self._answers = 0  # since this power was asked for
        self.controlword = holding if engaging else _ORDERS.get(power, _OFF)

    @property
    def certain(self) -> bool:
        """Whether the statusword is later than the order: the first answers may show the time before it."""
        return self._answers > limits.OLD_ANSWERS

    def step(self, now: Feedback) -> DriveState:
        """Read this period's feedback; the state of the drive."""
        self._answers += 1
        state, stands = cia402.state(now.statusword), self._still.stands(now.position)
        if self.power is Power.ON and now.fault is not Fault.FEEDBACK_LOST:
            self.controlword = _towards_enabled(state, stands)
        return state

    def wait(self) -> bool:
        """One period on the way without power; whether the brake is told again, as the first time may be lost."""
        if not self._engaging:
            return False
        self._engaging -= 1
        if not self._engaging:
            self.controlword = _OFF
        return self._engaging % limits.BRAKE_REPEAT_CYCLES == 0


class BrakeSequence:
    """When a brake is released and engaged, period by period."""

    def __init__(self, brake: Brake, dt: float, output: Callable[[bool], None]) -> None:
        """With the period `dt` (s); `output` sets (True) or releases the brake where we work it."""
        self.present = brake.present
        self._output = output if brake.control == "output" else lambda _: None  # the drive works its brake by itself
        self._torque = math.ceil(limits.TORQUE_TIME / dt) if brake.present else 0
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

    def watch(self, powered: bool) -> None:
        """Set a brake that is released where the drive leaves Operation enabled on the way to power: nothing holds."""
        if self._powered > self._torque and not powered:
            self.engage()


def fault_reset(elapsed: float) -> int:
    """Bit 7 of the controlword (transition 15), `elapsed` (s) after the beginning: few edges, a pause between them."""
    held = elapsed % (limits.RESET_HOLD + limits.RESET_PAUSE) < limits.RESET_HOLD
    return cia402.DeviceCommand.FAULT_RESET.controlword if held else _OFF


def _towards_enabled(state: DriveState, stands: bool) -> int:
    """Controlword of the next step; a fault stays, as a person resets it; a quick stop is left when the axis stands."""
    if state is DriveState.FAULT or (state is DriveState.QUICK_STOP_ACTIVE and stands):
        return _OFF
    return cia402.TOWARDS_ENABLED[state].controlword
