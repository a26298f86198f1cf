"""A machine that nobody has seen: drawn around a stage's model, for a virtual drive or a simulation to be.

::

    seed --> inertia, viscous friction, force constant --> law and size of the friction --> one to three effects
"""

import random
from typing import NamedTuple

from stagectl.config.friction_laws import Dahl, Lugre, Rolling, friction_of
from stagectl.config.stage_file import Setup
from stagectl.gap.effects.effect import Definition, Scales, units_of
from stagectl.gap.effects.library import EFFECTS, definitions, label
from stagectl.kernels import friction, stage
from stagectl.kernels.fields import get, put

# What is drawn; chosen: as far as a data sheet is usually off, and as many effects as the exam's machines have.
OFF_BY = 0.15  # share of a parameter, to either side
MOST_EFFECTS = 3
LENGTHS = (0.7, 1.5)  # of the rolling zone, over the model's
NOISE = 2e-3  # of the current limit: current noise where the stage file has none, so that repeats differ
SLOWEST_RING = 80.0  # Hz; chosen. A precision stage's drive train is no softer: it would leave no bandwidth of 40 Hz.
_PARAMETERS = ("mechanics.inertia", "mechanics.viscous", "motor.force_constant")
_LAWS = ("rolling", "dahl", "lugre")


class Hidden(NamedTuple):
    """What was drawn."""

    parameters: dict[str, float]  # factors on those of the model, by their entries
    law: str
    effects: dict[str, dict[str, float]]  # values of each effect's parameters, SI
    units: dict[str, dict[str, str]]  # of those values

    @property
    def lines(self) -> list[str]:
        """A line for each thing that was drawn."""
        factors = [f"{place}: {factor:.4g} times the stage file's" for place, factor in self.parameters.items()]
        effects = [
            f"{label(name)}: {', '.join(f'{part} {values[part]:.4g} {unit}'.rstrip() for part, unit in units.items())}"
            for (name, values), units in zip(self.effects.items(), self.units.values(), strict=True)
        ]
        return [*factors, f"friction: {self.law}", *effects]


def drawn(setup: Setup, seed: int) -> tuple[Setup, Hidden]:
    """The stage as the machine of this `seed` has it, and what was drawn."""
    source = random.Random(seed)
    p = setup.stage
    factors = {place: source.uniform(1.0 - OFF_BY, 1.0 + OFF_BY) for place in _PARAMETERS}
    for place, factor in factors.items():
        p = put(p, place, factor * get(p, place))
    law = source.choice(_LAWS)
    p = p._replace(friction=_friction(p.friction, law, source))
    known = [effect for effect in definitions(scales_of(setup)) if EFFECTS[effect.name].answer in ("current", "map")]
    found, units = {}, {}
    for effect in source.sample(known, source.randint(1, MOST_EFFECTS)):
        found[effect.name] = values = _values(effect, source)
        units[effect.name] = units_of(effect, setup.file.axis.kind)
        p = effect.apply(p, values)
    simulation = setup.file.simulation
    noise = simulation.current_noise or NOISE * p.drive.current_limit
    file = setup.file._replace(simulation=simulation._replace(current_noise=noise))
    return setup._replace(stage=p, file=file), Hidden(factors, law, found, units)


def _friction(p: stage.Friction, law: str, source: random.Random) -> stage.Friction:
    """Friction of another law, about as large as that of the model and over about the same length."""
    coulomb = stage.sliding(p) * source.uniform(1.0 - OFF_BY, 1.0 + OFF_BY)
    length = _length(p) * source.uniform(*LENGTHS)
    if law == "rolling":
        return friction_of(Rolling(coulomb, 0.05 * length, 2.0 * length, 20))
    if law == "dahl":
        return friction_of(Dahl(coulomb, length, source.uniform(1.0, 2.0)))
    return friction_of(Lugre(coulomb, length, 0.0, friction.Stribeck(source.uniform(0.0, 0.1))))


def _length(p: stage.Friction) -> float:
    """Friction over its stiffness at rest (rad | m)."""
    return stage.sliding(p) / stage.stiffness(p) if stage.stiffness(p) else 1.0


def _values(effect: Definition, source: random.Random) -> dict[str, float]:
    """A typical size, and any of its shapes, but for resonances below `SLOWEST_RING`."""
    amplitudes = {amplitude.name: source.choice(amplitude.typical) for amplitude in effect.amplitudes}
    grids = {shape.name: shape.grid or (1.0, 2.0, 4.0) for shape in effect.shapes}
    if "resonance" in grids:
        grids["resonance"] = tuple(f for f in grids["resonance"] if f >= SLOWEST_RING)
    return amplitudes | {name: source.choice(grid) for name, grid in grids.items()}


def scales_of(setup: Setup) -> Scales:
    """Sizes of a session that uses half of what the stage allows."""
    p, limits = setup.stage, setup.file.limits
    low, high = limits.travel
    return Scales(
        coulomb=stage.sliding(p.friction),
        viscous=p.mechanics.viscous,
        force_constant=p.motor.force_constant,
        length=3.0 * _length(p.friction),
        speed=0.5 * limits.speed,
        centre=0.5 * (low + high),
        stroke=0.25 * (high - low),
        current=0.5 * p.drive.current_limit,
        pitch=p.mechanics.pitch,
        dt=setup.dt,
    )
