"""The transition of a CiA 402 drive to the requested power: one controlword a period, from any state but Fault.

With a brake, torque comes before its release and stays until it holds.
"""

from __future__ import annotations

import math

from stagectl.drives import limits
from stagectl.drives.brake import Brake
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.brake_output import BrakeOutput
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.drive import Fault, Feedback, Power

_OFF = cia402.DeviceCommand.DISABLE_VOLTAGE.controlword
_ENABLED = cia402.DeviceCommand.ENABLE_OPERATION.controlword
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

    def __init__(self, power: Power, still: Standstill, holding: int | None = None) -> None:
        """The controlword is `holding` until `let_go`, where a brake must hold before power is cut."""
        self.power, self._still, self.waits = power, still, holding is not None
        self._answers = 0  # since this power was asked for
        self.controlword = _ORDERS.get(power, _OFF) if holding is None else holding

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

    def let_go(self) -> None:
        """The brake holds: power is cut."""
        self.waits, self.controlword = False, _OFF


class BrakeSequence:
    """When a brake is released and engaged, period by period."""

    def __init__(self, brake: Brake, dt: float, output: BrakeOutput) -> None:
        """With the period `dt` (s); `output` works the brake where we do."""
        self.present, self._output = brake.present, output
        self._torque = math.ceil(limits.TORQUE_TIME / dt)
        self._free = self._torque + max(math.ceil(brake.release / dt), 1)
        self._engaging = math.ceil(brake.engage / dt)
        self._patience = math.ceil(2.0 * limits.BRAKE_PATIENCE / dt)  # the axis gives up first, and says why
        self.keeps_enabled = brake.control == "output"  # while it engages
        self._powered = 0  # periods in Operation enabled, less those in which a release is not confirmed
        self._left = self._unconfirmed = 0  # periods until a brake that was set holds; in which it was not confirmed

    def released(self) -> bool:
        """Whether the axis may move, one period of Operation enabled later; releases the brake on the way."""
        if not self.present:
            return True
        if self._powered == self._torque:
            self._output.order(False)
        if self._powered <= self._torque or self._output.confirmed():
            self._powered += 1
        return self._powered > self._free

    def engage(self) -> None:
        """Set the brake."""
        self._powered, self._left, self._unconfirmed = 0, self._engaging, 0
        self._output.order(True)

    def holds(self) -> bool:
        """Whether a brake that was set holds, one period later; one that does not confirm it is not waited for ever."""
        if self._output.confirmed():  # from then on it takes its time
            self._left -= 1
            return self._left <= 0
        self._unconfirmed += 1
        return self._unconfirmed > self._patience

    def watch(self, powered: bool) -> None:
        """Set a brake that is released where the drive leaves Operation enabled on the way to power: nothing holds."""
        if powered:
            return
        if self._powered > self._torque:
            self.engage()
        self._output.confirmed()


def keeps_power(state: DriveState, controlword: int) -> bool:
    """Whether a drive in this state has not followed a `controlword` that ends its power: its commands may be lost."""
    if state is DriveState.QUICK_STOP_ACTIVE:  # of some, at rest and for good
        return controlword == _OFF
    return state is DriveState.OPERATION_ENABLED and controlword & 0x0F != _ENABLED


def fault_reset(elapsed: float) -> int:
    """Bit 7 of the controlword (transition 15), `elapsed` (s) after the beginning: few edges, a pause between them."""
    held = elapsed % (limits.RESET_HOLD + limits.RESET_PAUSE) < limits.RESET_HOLD
    return cia402.DeviceCommand.FAULT_RESET.controlword if held else _OFF


def _towards_enabled(state: DriveState, stands: bool) -> int:
    """Controlword of the next step; a fault stays, as a person resets it; a quick stop is left when the axis stands."""
    if state is DriveState.FAULT or (state is DriveState.QUICK_STOP_ACTIVE and stands):
        return _OFF
    return cia402.TOWARDS_ENABLED[state].controlword
