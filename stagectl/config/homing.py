"""How an axis finds where it is after power-on: the block `homing` of a stage file."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

from stagectl.units import Quantity


class Homing(NamedTuple):
    """How the axis finds its position after power-on."""

    method: Annotated[
        Literal["none", "here", "limit", "index", "current"],
        "none: positions are absolute; here: the present position; limit: switch; index: mark; current: end stop",
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
