"""The effects of a stage by name: each changes a rig by `scale` times its typical size, its shape drawn at random.

A shape is drawn from a wider family than a one-formula model of it: second harmonics, other exponents, two time
constants.  The same random numbers give the same shape at every scale.
"""

import zlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from stagectl_studies.machine.controller import Loop
from stagectl_studies.machine.machine import Machine

Change = Callable[["Rig", "Draw"], "Rig"]


class Rig(NamedTuple):
    """Machine and the controller it really runs."""

    machine: Machine
    loop: Loop


class Around(NamedTuple):
    """What a realistic size hangs on."""

    session: float  # s, from the first capture to the last of those for diagnosis
    peak_current: float  # A, the nominal model's in this session
    peak_speed: float  # rad/s
    peak_voltage: float  # V
    half_stroke: float  # rad


class Draw(NamedTuple):
    """One draw: random numbers, scale, and sign."""

    random: np.random.Generator
    scale: float
    sign: float
    around: Around

    def uniform(self, low: float, high: float) -> float:
        """A number between two."""
        return float(self.random.uniform(low, high))

    def decades(self, low: float, high: float) -> float:
        """A number between two, its logarithm uniform."""
        return float(np.exp(self.random.uniform(np.log(low), np.log(high))))

    def phase(self) -> float:
        """An angle, rad."""
        return self.uniform(0.0, 2.0 * np.pi)


class Effect(NamedTuple):
    """How it changes a rig, and in what its share is seen: torque, current, reported, position or command."""

    change: Change
    seen_in: str


EFFECTS: dict[str, Effect] = {}
ALIENS: dict[str, Effect] = {}


def effect(name: str, seen_in: str, table: dict[str, Effect] = EFFECTS) -> Callable[[Change], Change]:
    """Enter an effect into a table."""

    def entered(change: Change) -> Change:
        table[name] = Effect(change, seen_in)
        return change

    return entered


def draw_of(name: str, seed: int, scale: float, around: Around) -> Draw:
    """The draw that belongs to a name and a seed, whatever else is drawn."""
    random = np.random.default_rng([seed, zlib.crc32(name.encode())])
    return Draw(random, scale, float(random.choice([-1.0, 1.0])), around)


def applied(name: str, rig: Rig, draw: Draw) -> Rig:
    """The rig with an effect of either table."""
    return (EFFECTS.get(name) or ALIENS[name]).change(rig, draw)


def factor(draw: Draw, share: float) -> float:
    """1 + sign scale share, kept positive: a large decrease becomes a reciprocal."""
    step = draw.scale * share
    return 1.0 + step if draw.sign > 0.0 else 1.0 / (1.0 + step)
