"""What an identification has found, whichever the method: the one form for screen, JSON, figures and stage file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Progress = Callable[[int, int], object]  # (steps done, steps in all)
NOTHING: Mapping[str, Any] = MappingProxyType({})


class Parameter(NamedTuple):
    """A value with its 95 % interval, in `unit` (SI)."""

    value: float
    low: float
    high: float
    unit: str


class Characteristic(NamedTuple):
    """Rolling friction: stop operators, and the reversal table they make.

    ``force(s) = sum_j clip(-weight_j + weight_j / slip_j s, -weight_j, weight_j)``, s from a reversal on.
    """

    displacement: NDArray[np.float64]  # (m,) rad | m, from 0 up
    force: NDArray[np.float64]  # (m,) N m | N, from -T_c to +T_c
    weight: NDArray[np.float64]  # (j,) N m | N
    slip: NDArray[np.float64]  # (j,) rad | m


class Found(NamedTuple):
    """One method's answer from all captures together."""

    parameters: dict[str, Parameter]  # inertia, viscous, coulomb, offset, delay, ...
    table: Characteristic | None = None
    details: Mapping[str, Any] = NOTHING  # JSON values: correlations, residuals, curves that the figures draw
    notes: tuple[str, ...] = ()  # for the user, in words: what cannot be separated, what is doubtful
    changes: Mapping[str, Any] = NOTHING  # of the stage file, by dotted key, SI: {"mechanics.inertia": 0.0101}
