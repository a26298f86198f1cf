"""The power side of the virtual drive: CiA 402 state machine, its own stop, and the plant.

The drive's own stop is an internal velocity loop on a ramp: ``i = gain (v_ref - v)``, ``v_ref`` falls to
zero with the quick stop deceleration (0x6085).  It needs neither the bus nor the controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import Command, State
from stagectl.drives.simulated import Plant
from stagectl.drives.virtual.sensor import Actuator, Sensor, Undo

_VOLTAGE, _REMOTE, _FOLLOWS = 0x0010, 0x0200, 0x1000  # bits of the statusword besides the state
_STANDS = 0.01  # s without motion that count as standing still
_STANDING = 1e-4  # s of the ramp's deceleration: speed below which the axis counts as standing
_STOP_LIMIT = 2.0  # s beyond the ramp after which the drive gives up and cuts the power
_STOPPING = (State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE)
_POWERED = (State.OPERATION_ENABLED, *_STOPPING)


class Options(NamedTuple):
    """What the object dictionary says about stops, in SI units of the axis."""

    quick_stop: int  # 0x605A
    fault_reaction: int  # 0x605E
    abort_connection: int  # 0x6007
    deceleration: float  # rad/s^2 | m/s^2, 0x6085
    current_limit: float  # A, 0x6072 and 0x6073


class Stop(NamedTuple):
    """How a stop went."""

    duration: float  # s
    distance: float  # rad | m, from where it began
    stands: bool  # False where the axis still moved at the end and the power was cut


class Axis:
    """Power stage and plant; `advance` is one control period of it."""

    def __init__(self, plant: Plant, gain: float, stopped: Callable[[Stop], None]) -> None:
        """`gain` of the stop's velocity loop (A s/rad | A s/m); `stopped` is called when a stop is over."""
        self.plant, self._gain, self._stopped = plant, gain, stopped
        self.sensor, self._actuator, self._sto = Sensor(plant), Actuator(), False
        self.options = Options(2, 2, 3, 1.0, math.inf)
        self.state = State.SWITCH_ON_DISABLED
        self.mode = 0
        self.target = 0.0  # A, last received
        self.controlword = 0
        self.applied = 0.0  # A, what acts since the last SYNC
        self._after_stop = State.SWITCH_ON_DISABLED
        self._reference = 0.0  # velocity on the ramp
        self._began = self._still = 0.0  # where the stop began; how long it has stood, s
        self._elapsed = self._limit = 0.0

    @property
    def stopping(self) -> bool:
        """Whether the drive is braking by itself."""
        return self._limit > 0.0

    @property
    def enabled(self) -> bool:
        """Whether current may flow."""
        return self.state in _POWERED

    @property
    def statusword(self) -> int:
        """0x6041 as it stands."""
        bits: int = self.state.value[1] | _REMOTE | _VOLTAGE
        follows = self.state is State.OPERATION_ENABLED and self.mode == cia402.CYCLIC_SYNCHRONOUS_TORQUE
        return bits | _FOLLOWS if follows else bits

    def control(self, controlword: int) -> None:
        """Obey a controlword: at most one transition."""
        reset = controlword & ~self.controlword & 0x80
        self.controlword = controlword
        command = Command.FAULT_RESET if reset and self.state is State.FAULT else cia402.command(controlword)
        if command is None:
            return
        target = cia402.TRANSITIONS.get((self.state, command))
        if self._sto and target in _POWERED:
            return
        if target is State.QUICK_STOP_ACTIVE:
            self.quick_stop()
        elif self.state is State.QUICK_STOP_ACTIVE and command is Command.ENABLE_OPERATION:
            if self.options.quick_stop >= 5 and not self.stopping:  # transition 16
                self._enter(State.OPERATION_ENABLED)
        elif target is not None:
            self._enter(target)

    def latch(self) -> None:
        """What was received acts from now on."""
        obeys = self.state is State.OPERATION_ENABLED and self.mode == cia402.CYCLIC_SYNCHRONOUS_TORQUE
        limit = self.options.current_limit
        self.applied = min(max(self.target, -limit), limit) if obeys else 0.0
        self.plant.command(self._actuator(self.applied))

    def advance(self, seconds: float) -> None:
        """Let time go on by a period or less, under the applied command or the drive's own stop."""
        if not self.stopping:
            self.plant.drift(seconds)
            return
        self._reference = _towards_zero(self._reference, self.options.deceleration * seconds)
        self.plant.command(self._actuator(self._gain * (self._reference - self.sensor.velocity)))
        self.plant.drift(seconds)
        self._watch_stop(seconds)

    def quick_stop(self) -> None:
        """Transition 11: brake as 0x605A says, whoever asked for it."""
        option = self.options.quick_stop
        if option == 0:
            self._enter(State.SWITCH_ON_DISABLED)
        else:
            self._enter(State.QUICK_STOP_ACTIVE)
            self._brake(State.QUICK_STOP_ACTIVE if option >= 5 else State.SWITCH_ON_DISABLED)

    def trip(self) -> None:
        """Transition 13: an error inside the drive; brake as 0x605E says, then Fault."""
        if self.state in (State.FAULT, State.FAULT_REACTION_ACTIVE):
            return
        if self.enabled and self.options.fault_reaction != 0:
            self._enter(State.FAULT_REACTION_ACTIVE)
            self._brake(State.FAULT)
        else:
            self._enter(State.FAULT)

    def connection_lost(self) -> bool:
        """React as 0x6007 says; whether anything had to be done."""
        option = self.options.abort_connection
        if self.state is not State.OPERATION_ENABLED or option == 0:
            return False
        {1: self.trip, 2: self._cut, 3: self.quick_stop}[option]()
        return True

    def restart(self) -> None:
        """As after power-on, with the machine as new: so that a run can be repeated to the last bit."""
        self._enter(State.SWITCH_ON_DISABLED)
        self.mode = self.controlword = 0
        self.plant.restart()

    def power_cycled(self) -> None:
        """As after power-on, the machine staying where it is and coasting on."""
        self._enter(State.SWITCH_ON_DISABLED)
        self.mode = self.controlword = 0

    def open_sto(self) -> Undo:
        """Safe torque off: no power until the answer is called."""
        self._sto = True
        self._enter(State.SWITCH_ON_DISABLED)

        def close() -> None:
            self._sto = False

        return close

    def distort(self, distortion: Callable[[float], float]) -> Undo:
        """Distort the motor's current until the answer is called."""
        return self._actuator.distort(distortion)

    def _cut(self) -> None:
        self._enter(State.SWITCH_ON_DISABLED)

    def _enter(self, state: State) -> None:
        self.state = state
        self.applied = self.target = self._limit = 0.0
        self.plant.powered = self.enabled
        self.plant.command(0.0)

    def _brake(self, after: State) -> None:
        self._after_stop = after
        self._began, self._reference = self.plant.state.position, self.sensor.velocity
        self._elapsed = self._still = 0.0
        self._limit = abs(self._reference) / self.options.deceleration + _STOP_LIMIT

    def _watch_stop(self, dt: float) -> None:
        velocity = self.sensor.velocity
        self._elapsed += dt
        standing = self.options.deceleration * _STANDING + self.plant.p.encoder.step / _STANDS
        still = self._reference == 0.0 and abs(velocity) < standing
        self._still = self._still + dt if still else 0.0
        if self._still < _STANDS and self._elapsed < self._limit:
            return
        stop = Stop(self._elapsed - self._still, self.plant.state.position - self._began, still)
        self._limit = 0.0
        after = self._after_stop
        if not still and after is State.QUICK_STOP_ACTIVE:  # it would stay powered: an axis that cannot be held is cut
            after = State.SWITCH_ON_DISABLED
        if after is not self.state:
            self._enter(after)
        self._stopped(stop)


def _towards_zero(value: float, step: float) -> float:
    return math.copysign(max(abs(value) - step, 0.0), value)
