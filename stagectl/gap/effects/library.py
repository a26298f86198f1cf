"""The effects by name: where each sits in the stage model, how large it usually is, and what it is mistaken for.

An effect is written as amplitudes, which enter almost linearly and are zero when it is absent, and shapes, which
are not and come from a grid.  It changes the stage model and nothing else: the same fields play it in the virtual
drive and are written into the stage file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import numpy as np

from stagectl.kernels import stage
from stagectl.kernels.stage import Stage

Values = Mapping[str, float]
Block = TypeVar("Block")  # a NamedTuple of parameters


class Scales(NamedTuple):
    """Sizes of one machine and its session, from which typical values and grids follow."""

    coulomb: float  # N m | N
    viscous: float  # N m s/rad | N s/m
    inertia: float  # kg m^2 | kg
    force_constant: float  # N m/A | N/A
    length: float  # rad | m, of the rolling zone
    speed: float  # rad/s | m/s, largest in the logs
    centre: float  # rad | m, middle of the travel in the logs
    stroke: float  # rad | m, half of that travel
    current: float  # A, largest in the logs
    pitch: float  # rad | m
    dt: float  # s
    session: tuple[float, ...] = ()  # s, session clock of each log's first row
    voltage: float = 0.0  # V, largest that the motor needed; 0: resistance or back-EMF not known
    modes: tuple[float, ...] = ()  # Hz, at which what is left rings
    periods: float = 0.0  # encoder periods per pitch; 0: not known
    orders: Mapping[str, tuple[float, ...]] = MappingProxyType(
        {}
    )  # of each harmonic effect, as the residual shows them


class Amplitude(NamedTuple):
    """A parameter that is zero when the effect is absent, and enters almost linearly around its typical sizes."""

    name: str
    unit: str  # rotary | linear
    typical: tuple[float, ...]  # sizes from which the column is taken; several where it bends
    low: float = -math.inf
    high: float = math.inf


class Shape(NamedTuple):
    """A parameter that does not enter linearly: searched on a grid, then refined between its ends."""

    name: str
    unit: str
    grid: tuple[float, ...]
    refined: bool = True  # False: a choice
    low: float = 0.0
    high: float = math.inf


class TimeVariation(NamedTuple):
    """How an effect runs on the session clock: a factor on what a scaled parameter does, as slow as it is."""

    of: Mapping[str, str]  # parameter that each amplitude scales: coulomb | viscous
    factor: Callable[[Values, Any], Any]  # of the shapes and of the session clock (n,) s


class Definition(NamedTuple):
    """An effect as the diagnosis knows it."""

    name: str
    block: str  # drive | mechanics | sensor
    coordinate: str  # what its residual lives in
    amplitudes: tuple[Amplitude, ...]
    shapes: tuple[Shape, ...]
    apply: Callable[[Stage, Values], Stage]
    time_variation: TimeVariation | None = None  # runs on the session clock: repeats differ by it
    resonant: bool = False  # so sharp in its shapes that a fit must begin near: every place on their grid is tried
    nonlinear: bool = False  # so far from linear that its columns hold at their typical sizes only


def put(p: Block, place: str, value: Any) -> Block:
    """`p` with the field at the dotted `place` replaced."""
    name, _, rest = place.partition(".")
    block: Any = p
    changed: Block = block._replace(**{name: put(getattr(p, name), rest, value) if rest else value})
    return changed


def get(p: Any, place: str) -> Any:
    """The field of `p` at the dotted `place`."""
    for name in place.split("."):
        p = getattr(p, name)
    return p


def scaled(place: str) -> Callable[[Stage, Values], Stage]:
    """An effect that multiplies a field by 1 + size."""
    return lambda p, v: put(p, place, get(p, place) * (1.0 + v["size"]))


def added(**places: str) -> Callable[[Stage, Values], Stage]:
    """An effect that adds each of its parameters to a field."""

    def apply(p: Stage, v: Values) -> Stage:
        for name, place in places.items():
            p = put(p, place, get(p, place) + v[name])
        return p

    return apply


def harmonic(place: str) -> Callable[[Stage, Values], Stage]:
    """``sine sin(order angle) + cosine cos(order angle)`` as amplitude, order and phase of the Harmonic at `place`."""

    def apply(p: Stage, v: Values) -> Stage:
        size, phase = math.hypot(v["sine"], v["cosine"]), math.atan2(v["cosine"], v["sine"])
        return put(p, place, get(p, place)._replace(amplitude=size, order=v["order"], phase=phase))

    return apply


def coulomb(p: Stage, v: Values) -> Stage:
    """All friction but the viscous part, scaled."""
    return p._replace(friction=stage.scaled_friction(p.friction, 1.0 + v["size"]))


def cold(v: Values, t: Any) -> Any:
    """``exp(-t / time)``: what is left of the cold at the session clock `t` (n,) s."""
    return np.exp(-t / v["time"])


def stretched(p: Stage, v: Values) -> Stage:
    """The rolling zone, longer by the share `size`."""
    return p._replace(friction=stage.stretched_friction(p.friction, 1.0 + v["size"]))
