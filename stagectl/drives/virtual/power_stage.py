"""The power side of the virtual drive: CiA 402 state machine, its own stop, and the plant.

The drive's own stop is an internal velocity loop on a ramp: ``i = gain (v_ref - v)``, ``v_ref`` falls to
zero with the quick stop deceleration (0x6085).  It needs neither the bus nor the controller.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from stagectl.drives.brake import NO_BRAKE, Brake
from stagectl.drives.bus.faulty_bus import Undo
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DeviceCommand, DriveState
from stagectl.drives.limits import STANDING, STILL_TIME, STOP_GRACE
from stagectl.drives.simulated import Plant
from stagectl.drives.virtual.homing import VirtualHoming
from stagectl.drives.virtual.sensor import Actuator, HoldingBrake, Sensor

_VOLTAGE = 0x0010  # bit of the statusword


class StopOptions(NamedTuple):
    """What the object dictionary says about stops, in SI units of the axis."""

    quick_stop: int  # 0x605A
    fault_reaction: int  # 0x605E
    abort_connection: int  # 0x6007
    deceleration: float  # rad/s^2 | m/s^2, 0x6085
    current_limit: float  # A, 0x6072 and 0x6073


class StopReport(NamedTuple):
    """The result of a stop by the drive itself."""

    duration: float  # s
    distance: float  # rad | m, from where it began
    stands: bool  # False where the axis still moved at the end and the power was cut


class PowerStage:
    """Power stage and plant; `advance` is one control period of it."""

    def __init__(
        self,
        plant: Plant,
        gain: float,
        stopped: Callable[[StopReport], None],
        brake: Brake = NO_BRAKE,
        mark: float = 0.0,
    ) -> None:
        """`gain` of the stop's velocity loop (A s/rad | A s/m); `stopped` is called when a stop is over.

        The reference mark of its homing is at `mark` (rad | m).

        A `brake` that the drive works itself holds where there is no power, and takes over before that goes.
        """
        self.plant, self._gain, self._stopped = plant, gain, stopped
        self.sensor, self._actuator, self._sto = Sensor(plant), Actuator(), False
        self.options = StopOptions(2, 2, 3, 1.0, math.inf)
        self.homing = VirtualHoming(self.sensor, mark)
        self.state = DriveState.SWITCH_ON_DISABLED
        self.mode = 0
        self.target = 0.0  # A, last received
        self.controlword = 0
        self.applied = 0.0  # A, what acts since the last SYNC
        self._after_stop = DriveState.SWITCH_ON_DISABLED
        self._reference = 0.0  # velocity on the ramp
        self._began = self._still = 0.0  # rad | m where the stop began; s without motion
        self._elapsed = self._limit = self._engaging = 0.0
        self.brake = HoldingBrake(brake)
        # The drive's own loop carries the weight as its integral would.
        self._weight = plant.holding

    @property
    def stopping(self) -> bool:
        """Whether the drive is braking by itself."""
        return self._limit > 0.0

    @property
    def enabled(self) -> bool:
        """Whether current may flow."""
        return self.state in cia402.POWERED

    @property
    def statusword(self) -> int:
        """Statusword (0x6041) now."""
        bits: int = self.state.value[1] | cia402.REMOTE | _VOLTAGE
        if self._homes:
            return bits | self.homing.bits
        return bits | cia402.FOLLOWS if self._obeys else bits

    def control(self, controlword: int) -> None:
        """Obey a controlword: at most one transition."""
        reset = controlword & ~self.controlword & 0x80
        if self._homes and (controlword ^ self.controlword) & cia402.HOMING_START:
            self.homing.order(bool(controlword & cia402.HOMING_START))
        self.controlword = controlword
        command = DeviceCommand.FAULT_RESET if reset and self.state is DriveState.FAULT else cia402.command(controlword)
        if command is None:
            return
        target = cia402.TRANSITIONS.get((self.state, command))
        if self._sto and target in cia402.POWERED:
            return
        if target is DriveState.QUICK_STOP_ACTIVE:
            self.quick_stop()
        elif self.state is DriveState.QUICK_STOP_ACTIVE and command is DeviceCommand.ENABLE_OPERATION:
            if self.options.quick_stop >= 5 and not self.stopping:  # transition 16
                self._enter(DriveState.OPERATION_ENABLED)
        elif target is not None:
            self._leave_for(target)

    def latch(self) -> None:
        """Let the received command act from now on."""
        limit = self.options.current_limit
        self.applied = min(max(self.target, -limit), limit) if self._obeys else 0.0
        if not self._holds:
            self.plant.command(self._actuator(self.applied))

    def advance(self, seconds: float) -> None:
        """Let time go on by a period or less, under the applied command or the drive's own stop."""
        self.brake.advance(seconds, self.enabled)
        if self._holds:
            if self._homes:
                self.homing.advance(seconds)
                self._reference = self.homing.reference
            else:
                left = max(abs(self._reference) - self.options.deceleration * seconds, 0.0)
                self._reference = math.copysign(left, self._reference)
            current = self._gain * (self._reference - self.sensor.velocity) + self._weight
            self.plant.command(self._actuator(current))
        if self.brake.free:
            self.plant.drift(seconds)
        else:
            self.plant.arrest(seconds)
        if self.stopping:
            self._watch_stop(seconds)

    def quick_stop(self) -> None:
        """Transition 11: brake as 0x605A requires."""
        option = self.options.quick_stop
        if option == 0:
            self._enter(DriveState.SWITCH_ON_DISABLED)
        else:
            self._enter(DriveState.QUICK_STOP_ACTIVE)
            self._slow_down(DriveState.QUICK_STOP_ACTIVE if option >= 5 else DriveState.SWITCH_ON_DISABLED)

    @property
    def faulty(self) -> bool:
        """Whether an error has stopped it."""
        return self.state in (DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE)

    def trip(self) -> None:
        """Transition 13: an error inside the drive; brake as 0x605E says, then Fault."""
        if self.faulty:
            return
        if self.enabled and self.options.fault_reaction != 0:
            self._enter(DriveState.FAULT_REACTION_ACTIVE)
            self._slow_down(DriveState.FAULT)
        else:
            self._enter(DriveState.FAULT)

    def connection_lost(self) -> bool:
        """React as 0x6007 says; whether anything had to be done."""
        option = self.options.abort_connection
        if self.state is not DriveState.OPERATION_ENABLED or option == 0:
            return False
        if option == 2:  # power off
            self._leave_for(DriveState.SWITCH_ON_DISABLED)
        else:
            {1: self.trip, 3: self.quick_stop}[option]()
        return True

    def restart(self) -> None:
        """As after power-on, with the machine as new: so that a run can be repeated to the last bit."""
        self.power_cycled()
        self.plant.restart()
        self.homing.restart()

    def power_cycled(self) -> None:
        """As after power-on, the machine staying where it is and coasting on."""
        self._enter(DriveState.SWITCH_ON_DISABLED)
        self.mode = self.controlword = 0

    def open_sto(self) -> Undo:
        """Safe torque off: no power until the returned function is called."""
        self._sto = True
        self._enter(DriveState.SWITCH_ON_DISABLED)

        def close() -> None:
            self._sto = False

        return close

    def distort(self, distortion: Callable[[float], float]) -> Undo:
        """Distort the motor's current until the returned function is called."""
        return self._actuator.distort(distortion)

    def _enter(self, state: DriveState) -> None:
        self.state = state
        self.applied = self.target = self._limit = 0.0
        self.plant.powered = self.enabled
        self.plant.command(0.0)
        if self.brake.by_drive and not self.enabled:
            self.brake.free = False

    @property
    def _obeys(self) -> bool:
        """Whether the command acts: not while the brake engages, as the drive then holds the axis itself."""
        cyclic = self.mode == cia402.CYCLIC_SYNCHRONOUS_TORQUE
        return cyclic and self.state is DriveState.OPERATION_ENABLED and not self.stopping

    @property
    def _holds(self) -> bool:
        """Whether its own velocity loop acts: on the ramp, at rest under power behind it, and in homing."""
        return self.stopping or self.state is DriveState.QUICK_STOP_ACTIVE or self._homes

    @property
    def _homes(self) -> bool:
        """Whether it is in the homing mode under power."""
        return self.mode == cia402.HOMING and self.state is DriveState.OPERATION_ENABLED and not self.stopping

    def _leave_for(self, target: DriveState) -> None:
        """Go to another state; where power ends with it, the brake holds first."""
        if not (self.brake.by_drive and self.enabled and target not in cia402.POWERED):
            self._enter(target)
        elif not self.stopping:
            self._slow_down(target)

    def _slow_down(self, after: DriveState) -> None:
        self._after_stop = after
        self._began, self._reference = self.plant.state.position, self.sensor.velocity
        self._elapsed = self._still = self._engaging = 0.0
        self._limit = abs(self._reference) / self.options.deceleration + STOP_GRACE

    def _watch_stop(self, dt: float) -> None:
        velocity = self.sensor.velocity
        self._elapsed += dt
        standing = self.options.deceleration * STANDING + self.plant.p.encoder.step / STILL_TIME
        still = self._reference == 0.0 and abs(velocity) < standing
        self._still = self._still + dt if still else 0.0
        if self._still < STILL_TIME and self._elapsed < self._limit:
            return
        if still and self.brake.by_drive and self._engaging < self.brake.engage:
            self._engaging += dt  # held under power until the brake holds
            return
        stop = StopReport(self._elapsed - self._still, self.plant.state.position - self._began, still)
        self._limit = 0.0
        after = self._after_stop
        if not still and after is DriveState.QUICK_STOP_ACTIVE:  # under power: an axis that cannot be held is cut
            after = DriveState.SWITCH_ON_DISABLED
        if after is not self.state:
            self._enter(after)
        self._stopped(stop)
