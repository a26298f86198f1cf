"""Shapes that effects of the plant share: a harmonic of the position, a drift, a step in time, a table.

Each is neutral by default.  Source of the list and of realistic sizes: the design of the gap's diagnosis, section 4.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple, get_args

from stagectl.kernels.constants import CLOCK_ROUNDING, SERIES_BELOW
from stagectl.kernels.jit import kernel, table
from stagectl.units import Quantity

TURN = 2.0 * math.pi
NONE, VELOCITY, SINCE_REVERSAL, POSITION, POSITION_MOD_PITCH, CURRENT, TIME, SPEED = range(8)
Coordinate = Literal[
    "none",
    "velocity",  # rad/s | m/s, signed
    "displacement_since_reversal",  # rad | m, positive after a turn towards positive positions
    "position",  # rad | m
    "position_mod_pitch",  # rad | m, in [0, pitch)
    "current",  # A, in the motor
    "time",  # s, session clock
    "speed",  # rad/s | m/s, without its sign
]
COORDINATES: tuple[Coordinate, ...] = get_args(Coordinate)  # of a residual table, by their code


class Harmonic(NamedTuple):
    """A harmonic of the position, ``amplitude sin(order angle + phase)``, ``angle = 2 pi position / pitch``."""

    amplitude: Annotated[float, Quantity("", "[-1e6, 1e6]", "amplitude; 0 is neutral")] = 0.0
    order: Annotated[float, Quantity("", "(0, 1e6]", "periods per pitch")] = 1.0
    phase: Annotated[float, Quantity("rad", "[-1e3, 1e3]", "phase at position 0")] = 0.0


class Warming(NamedTuple):
    """A factor ``1 + rise exp(-t / time)`` over the session clock t: cold at 0, warm at last."""

    rise: Annotated[float, Quantity("", "[-1, 100]", "cold over warm, less 1; 0 is neutral")] = 0.0
    time: Annotated[float, Quantity("s", "(0, 1e6]", "time constant of the warming")] = 600.0


class Step(NamedTuple):
    """A factor that jumps from 1 to ``1 + share`` at one instant of the session clock."""

    share: Annotated[float, Quantity("", "[-1, 100]", "change; 0 is neutral")] = 0.0
    at: Annotated[float, Quantity("s", "[-1e9, 1e9]", "session clock of the change")] = 0.0


class Table(NamedTuple):
    """A data-based effort over one coordinate, added to what opposes the motor: straight between rows, flat beyond."""

    coordinate: int = NONE  # code in COORDINATES
    start: float = 0.0  # of the first row, in the coordinate's SI unit
    step: float = 1.0  # between rows
    values: Any = table([0.0])  # (n,) N m | N


NO_TABLE = Table()


@kernel
def wave(p: Harmonic, angle: float) -> float:
    """The harmonic at `angle` (rad); exactly 0 when neutral."""
    if p.amplitude == 0.0:
        return 0.0
    return p.amplitude * math.sin(p.order * angle + p.phase)


@kernel
def drifting(warming: Warming, step: Step, time: float) -> float:
    """Both factors over the session clock; exactly 1 when neutral."""
    factor = 1.0
    if warming.rise != 0.0:
        factor += warming.rise * math.exp(-time / warming.time)
    if step.share != 0.0 and time >= step.at - CLOCK_ROUNDING:
        factor *= 1.0 + step.share
    return factor


@kernel
def looked_up(p: Table, place: float) -> float:
    """The table at `place` on its coordinate."""
    last = len(p.values) - 1
    rows = (place - p.start) / p.step
    if rows <= 0.0:
        return float(p.values[0])
    if rows >= last:
        return float(p.values[last])
    j = int(rows)
    return float(p.values[j] + (rows - j) * (p.values[j + 1] - p.values[j]))


@kernel
def relaxed(y: float) -> float:
    """``(1 - exp(-y)) / y`` for y >= 0: mean of a decay over its step."""
    if y < SERIES_BELOW:
        even = y * y
        return 1.0 - 0.5 * y + even * (1.0 / 6.0 - (1.0 / 24.0) * y + even * (1.0 / 120.0 - (1.0 / 720.0) * y))
    return -math.expm1(-y) / y


@kernel
def decayed(y: float) -> tuple[float, float]:
    """``exp(-y)`` for y >= 0, to one rounding of 1, and its mean on the way there."""
    mean = relaxed(y)
    return 1.0 - y * mean, mean
