"""What moves beside the motor: a load behind a compliance with backlash, the machine's base, a cable."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from stagectl.units import Quantity


class Cable(NamedTuple):
    """A cable that pulls towards its centre, with a Maxwell element: ``k (x - centre) + hysteresis s``."""

    stiffness: Annotated[float, Quantity("N m/rad | N/m", "[0, 1e9]", "k; 0 is neutral")] = 0.0
    centre: Annotated[float, Quantity("rad | m", "[-1e6, 1e6]", "where it does not pull")] = 0.0
    hysteresis: Annotated[float, Quantity("N m | N", "[0, 1e6]", "force of the element that slips; 0 is neutral")] = 0.0
    slip: Annotated[float, Quantity("rad | m", "(0, 1e3]", "displacement at which that element slips")] = 1.0


class Transmission(NamedTuple):
    """Motor and load with a spring, a damper and a gap between them; rigid without share or resonance."""

    load_share: Annotated[float, Quantity("", "[0, 0.99]", "of the inertia behind the spring; 0: rigid")] = 0.0
    resonance: Annotated[float, Quantity("Hz", "[0, 5000]", "of motor against load, both free; 0: rigid")] = 0.0
    damping: Annotated[float, Quantity("", "[0, 2]", "ratio of that resonance")] = 0.03
    backlash: Annotated[float, Quantity("rad | m", "[0, 1]", "full gap between motor and load")] = 0.0
    load_friction: Annotated[float, Quantity("", "[0, 1]", "share of friction at the load; the rest at the motor")] = (
        1.0
    )


class Base(NamedTuple):
    """The machine's base on its feet, pushed back by the motor."""

    ratio: Annotated[float, Quantity("", "[0, 10]", "moving mass over that of the base, mu; 0 is neutral")] = 0.0
    frequency: Annotated[float, Quantity("Hz", "(0, 1000]", "of the base on its feet")] = 20.0
    damping: Annotated[float, Quantity("", "[0, 2]", "ratio of that mode")] = 0.02
