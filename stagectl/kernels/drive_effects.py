"""What a drive does beside its current loop: dead time, its limits of heat and voltage, and what it reports."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from stagectl.units import Quantity


class Reported(NamedTuple):
    """From the motor current to the one the drive reports: ``i(t - late) (1 + gain) + offset``."""

    gain: Annotated[float, Quantity("", "[-0.9, 10]", "error of the scale")] = 0.0
    offset: Annotated[float, Quantity("A", "[-1e3, 1e3]", "added to the report alone")] = 0.0
    late: Annotated[float, Quantity("s", "[0, 0.1]", "age of the current in the report, up to a control period")] = 0.0
