"""Encoder and current path of the virtual drive, between plant and electronics: where faults act.

Without a fault both pass their signal on unchanged.
"""

from __future__ import annotations

import collections
from collections.abc import Callable
from typing import NamedTuple

from stagectl.drives.bus.faulty_bus import Undo, added
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
