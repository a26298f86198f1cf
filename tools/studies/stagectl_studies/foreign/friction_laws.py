"""Machines by their law of friction: the exam's stages, with the noise of the ball-screw paper's drive."""

from collections.abc import Callable

import numpy as np

from stagectl_studies.machine.machine import BRISTLE, Drive, Law, Machine, Speed
from stagectl_studies.machine.stages import dahl_law, maxwell, stage
from stagectl_studies.reproduction.bench import NOISE

Random = np.random.Generator
RISE = (0.1, 0.3)  # of Stribeck's curve, over Coulomb friction; chosen, as of a greased ball screw
STRIBECK_SPEED = (0.5, 5.0)  # rad/s: 1 to 10 mm/s of table travel


def _bristle(random: Random, breakaway: float) -> Law:
    """LuGre at a breakaway of 0, else elasto-plastic; lengths and damping as the exam draws them."""
    length = float(random.uniform(1.5e-3, 3e-3))  # rad: 3 to 6 um of travel
    damping, speed = float(random.uniform(0.01, 0.06)), float(random.uniform(0.05, 0.5))
    return Law(BRISTLE, np.ones(1), np.ones(1), length, 1.0, breakaway, damping, speed)


def _stribeck(random: Random) -> Speed:
    """A rise towards zero speed that bounds each element, as in GMS and LuGre."""
    rise, speed = float(random.uniform(*RISE)), float(np.exp(random.uniform(*np.log(STRIBECK_SPEED))))
    return Speed(limits=True, stribeck=rise, stribeck_speed=speed, stribeck_exponent=float(random.uniform(1.0, 2.0)))


LAWS: dict[str, Callable[[Random], tuple[Law, Speed]]] = {
    "Maxwell": lambda random: (maxwell(random), Speed()),
    "GMS": lambda random: (maxwell(random), _stribeck(random)),
    "elasto-plastic": lambda random: (_bristle(random, float(random.uniform(0.1, 0.6))), Speed()),
    "Dahl": lambda random: (dahl_law(random), Speed()),
    "LuGre": lambda random: (_bristle(random, 0.0), Speed()),
    "LuGre, Stribeck": lambda random: (_bristle(random, 0.0), _stribeck(random)),
}


def machine(name: str, seed: int) -> Machine:
    """The machine with the friction law `name`, drawn by `seed`; its drive's current is noisy."""
    random = np.random.default_rng([seed, list(LAWS).index(name)])
    law, speed = LAWS[name](random)
    body = stage("maxwell", random).body
    return Machine(law, body, speed, drive=Drive(noise=NOISE))
