"""How an axis finds where it is after power-on: the block `homing` of a stage file."""

from typing import Annotated, Literal, NamedTuple

from stagectl.drives.limits import HOMING_GRACE, SLOW_SHARE
from stagectl.units import Quantity

_IN_PLACE = (35, 37)  # methods of CiA 402 that take the present position


class Homing(NamedTuple):
    """How the axis finds its position after power-on."""

    method: Annotated[
        Literal["none", "here", "limit", "index", "current", "drive"],
        "none: positions are absolute; here: the present position; limit: switch; index: mark; current: end stop;"
        " drive: the drive's own homing, by number",
    ] = "none"
    speed: Annotated[
        float, Quantity("rad/s | m/s", "[-1e6, 1e6]", "speed of the search; its sign is the direction")
    ] = 0.0
    distance: Annotated[float, Quantity("rad | m", "[0, 1e6]", "longest distance of the search")] = 0.0
    current: Annotated[float, Quantity("A", "[0, 1e4]", "current at which an end stop is recognised")] = 0.0
    bit: Annotated[
        int, Quantity("", "[0, 15]", "bit of the statusword that shows switch or index; 11: internal limit")
    ] = 11
    position: Annotated[float, Quantity("rad | m", "[-1e6, 1e6]", "position that is assigned to the place found")] = 0.0
    number: Annotated[
        int, Quantity("", "[-128, 37]", "method drive: number of the drive's method (0x6098, CiA 402); 35, 37: here")
    ] = 0
    slow: Annotated[
        float, Quantity("rad/s | m/s", "[0, 1e6]", "method drive: speed at the switch (0x6099:02); 0: a fifth of speed")
    ] = 0.0

    @property
    def by_drive(self) -> bool:
        """Whether the drive searches by itself, in its mode of operation 6."""
        return self.method == "drive"

    @property
    def moves(self) -> bool:
        """Whether the axis must move to find its home; CiA 402's 35 and 37 take the place where it stands."""
        return self.method not in ("none", "here") and not (self.by_drive and self.number in _IN_PLACE)

    @property
    def slowly(self) -> float:
        """Speed (rad/s | m/s) at the switch."""
        return self.slow or abs(self.speed) * SLOW_SHARE

    @property
    def longest(self) -> float:
        """Longest time (s) of the drive's search: there and back, and slowly over all of the distance."""
        there = 2.0 * self.distance / abs(self.speed) + self.distance / self.slowly if self.moves else 0.0
        return there + HOMING_GRACE


NO_HOMING = Homing()
