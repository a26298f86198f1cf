"""What changes the friction's limit: age of the contact, load, place, temperature."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from stagectl.units import Quantity


class Dwell(NamedTuple):
    """Ageing of the contact at rest: a factor ``1 + rise ln(1 + t_d / time)``, wiped by slip."""

    rise: Annotated[float, Quantity("", "[0, 10]", "rise per e-fold of the time at rest; 0 is neutral")] = 0.0
    time: Annotated[float, Quantity("s", "(0, 1e6]", "time at rest from which it grows")] = 0.1


class Along(NamedTuple):
    """A factor over the stroke, ``1 + slope (x - centre) + bow (x - centre)^2``, never below 0."""

    slope: Annotated[float, Quantity("1/rad | 1/m", "[-1e6, 1e6]", "linear part; 0 is neutral")] = 0.0
    bow: Annotated[float, Quantity("1/rad^2 | 1/m^2", "[-1e9, 1e9]", "quadratic part; 0 is neutral")] = 0.0
    centre: Annotated[float, Quantity("rad | m", "[-1e6, 1e6]", "where the factor is 1")] = 0.0
