"""The homing mode of the virtual drive (CiA 402, mode of operation 6): to a reference mark, or where it stands.

::

    start (bit 4) --> run to the mark (33: downwards, 34: upwards) --> come to rest --> bits 10 and 12
                      35, 37: the present position                     any other number: bit 13
"""

import math
from typing import NamedTuple

from stagectl.drives.canopen import cia402
from stagectl.drives.limits import STANDING
from stagectl.drives.virtual.sensor import Sensor

DIRECTIONS = {33: -1.0, 34: 1.0, 35: 0.0, 37: 0.0}  # of the methods that it has (0x6098)


class HomingOptions(NamedTuple):
    """What the object dictionary says about homing, in SI units of the axis."""

    method: int = 0  # 0x6098
    speed: float = 0.0  # rad/s | m/s, 0x6099:01
    acceleration: float = 1.0  # rad/s^2 | m/s^2, 0x609A
    offset: int = 0  # counts, 0x607C: position of the home


class VirtualHoming:
    """One homing after the other; `reference` is the velocity that the drive's own loop follows."""

    def __init__(self, sensor: Sensor, mark: float) -> None:
        """The reference mark is at `mark` (rad | m), as the axis is counted from power-on."""
        self._sensor, self._mark = sensor, mark
        self.options = HomingOptions()
        self.restart()

    def restart(self) -> None:
        """As after power-on: counted from where it stood then."""
        self._sensor.origin = 0
        self.bits = cia402.TARGET_REACHED  # not started
        self._target, self.reference = 0.0, 0.0  # velocities: wanted, on the ramp
        self._above, self._found = False, math.nan

    def order(self, start: bool) -> None:
        """An edge of bit 4: begin, or break off."""
        self._target, self.bits, self._found = 0.0, 0 if start else cia402.TARGET_REACHED, math.nan
        direction = DIRECTIONS.get(self.options.method)
        if not start:
            return
        if direction is None:
            self.bits = cia402.HOMING_ERROR | cia402.TARGET_REACHED
        elif direction:
            self._target, self._above = direction * self.options.speed, self._is_above()
        else:
            self._found = self._sensor.machine_counts

    def advance(self, seconds: float) -> None:
        """Let time go on."""
        step = self.options.acceleration * seconds
        self.reference += min(max(self._target - self.reference, -step), step)
        if self._target and self._is_above() is not self._above:
            self._found, self._target = self._sensor.machine_counts, 0.0
        still = abs(self._sensor.velocity) <= max(self.options.acceleration * STANDING, self._sensor.step / _LOOK)
        if not math.isnan(self._found) and self.reference == 0.0 and still:
            self._sensor.origin = int(self._found) - self.options.offset
            self.bits, self._found = cia402.HOMING_ATTAINED | cia402.TARGET_REACHED, math.nan

    def _is_above(self) -> bool:
        return self._sensor.machine_counts * self._sensor.step >= self._mark


_LOOK = 0.01  # s in which a count is motion
