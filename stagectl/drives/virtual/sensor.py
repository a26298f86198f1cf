"""Encoder, current path and brake of the virtual drive, between plant and electronics: where faults act.

Without a fault encoder and current path pass their signal on unchanged.
"""

import collections
from collections.abc import Callable
from typing import NamedTuple

from stagectl.drives.brake import Brake
from stagectl.drives.bus.faulty_bus import Undo, added
from stagectl.drives.canopen.cia402 import BRAKE_BIT
from stagectl.drives.limits import TORQUE_TIME
from stagectl.drives.simulated import Plant


class Distortion(NamedTuple):
    """What a fault makes of the encoder: of its counts, and of the velocity that the drive derives from them."""

    counts: Callable[[int], int]
    velocity: Callable[[float], float]


class Sensor:
    """The position as the drive's electronics see it."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._distortions: list[Distortion] = []
        self.step = plant.p.encoder.step  # rad | m
        self.origin = 0  # counts, of the position that the drive shows as 0

    @property
    def counts(self) -> int:
        """Position in encoder counts, from the home that homing has found."""
        return self.machine_counts - self.origin

    @property
    def machine_counts(self) -> int:
        """Position in encoder counts, from power-on."""
        counts = self._plant.position_counts
        for distortion in self._distortions:
            counts = distortion.counts(counts)
        return counts

    @property
    def velocity(self) -> float:
        """Velocity that the drive brakes by (rad/s | m/s)."""
        velocity = self._plant.state.velocity
        for distortion in self._distortions:
            velocity = distortion.velocity(velocity)
        return velocity

    def distort(self, distortion: Distortion) -> Undo:
        """Distort the measurement until the returned function is called."""
        return added(self._distortions, distortion)


class Actuator:
    """The current on its way from the drive's regulator to the motor."""

    def __init__(self) -> None:
        self._distortions: list[Callable[[float], float]] = []

    def __call__(self, current: float) -> float:
        """What reaches the motor of `current` (A)."""
        for distortion in self._distortions:
            current = distortion(current)
        return current

    def distort(self, distortion: Callable[[float], float]) -> Undo:
        """Distort the current until the returned function is called."""
        return added(self._distortions, distortion)


class HoldingBrake:
    """The brake of a virtual axis, worked by its drive or by bit 0 of the drive's digital outputs (0x60FE).

    `free` says whether the axis can move; without a brake it always can.
    """

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

    def advance(self, seconds: float, enabled: bool) -> None:
        """Let time go on: an order takes effect after the brake's own time.

        The drive orders its own to release once its current has come, and engages it when it has seen to the axis.
        """
        wanted = enabled if self.by_drive else bool(self.mask & ~self.outputs & BRAKE_BIT)
        if not self.present or wanted == self.free:
            self._elapsed = 0.0
            return
        self._elapsed += seconds
        torque = TORQUE_TIME if self.by_drive else 0.0
        if self._elapsed >= (torque + self._p.release if wanted else self._p.engage):
            self.free = wanted


def late(delay: int) -> Callable[[float], float]:
    """Current of `delay` control periods ago."""
    line: collections.deque[float] = collections.deque([0.0] * delay)

    def act(current: float) -> float:
        line.append(current)
        return line.popleft()

    return act


def held() -> Callable[[float], float]:
    """The first current for ever."""
    first: list[float] = []

    def act(current: float) -> float:
        if not first:
            first.append(current)
        return first[0]

    return act
