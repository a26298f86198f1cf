"""How an axis finds where it is after power-on: the block `homing` of a stage file."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

from stagectl.units import Quantity


class Homing(NamedTuple):
    """How the axis finds where it is after power-on."""

    method: Annotated[
        Literal["none", "here", "limit", "index", "current"],
        "none: positions are absolute; here: where it stands; limit: a switch; index: a mark; current: an end stop",
    ] = "none"
    speed: Annotated[float, Quantity("rad/s | m/s", "[-1e6, 1e6]", "of the search, signed: its direction")] = 0.0
    distance: Annotated[float, Quantity("rad | m", "[0, 1e6]", "longest way of the search")] = 0.0
    current: Annotated[float, Quantity("A", "[0, 1e4]", "that tells an end stop")] = 0.0
    bit: Annotated[int, Quantity("", "[0, 15]", "of the statusword that shows switch or index; 11: internal limit")] = (
        11
    )
    position: Annotated[float, Quantity("rad | m", "[-1e6, 1e6]", "what the found place is called")] = 0.0
