"""The friction of a stage file: which law, and the plant's parameters that follow from it."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from stagectl.kernels import friction, friction_bristle, plant, stage
from stagectl.kernels.effects import Harmonic, Step, Warming
from stagectl.kernels.plant import Along, Dwell
from stagectl.units import Quantity


class Rolling(NamedTuple):
    """Rolling friction: equal elements whose slips are spaced geometrically."""

    coulomb: Annotated[float, Quantity("N m | N", "[0, 1e6]", "friction when all elements slip, T_c")]
    shortest: Annotated[float, Quantity("rad | m", "(0, 1e3]", "slip of the stiffest element")]
    longest: Annotated[float, Quantity("rad | m", "(0, 1e3]", "slip of the softest element")]
    elements: Annotated[int, Quantity("", "[1, 64]", "number of stop operators")] = 12
    stribeck: friction.Stribeck = friction.Stribeck()
    lag: plant.Lag = 0.0
    asymmetry: plant.Asymmetry = 0.0
    dwell: Dwell = Dwell()
    load: plant.LoadShare = 0.0
    along: Along = Along()
    lead: plant.Lead = Harmonic()
    ball_pass: plant.BallPass = Harmonic()
    warming: Warming = Warming()
    step: Step = Step()

    def operators(self) -> friction.StopOperators:
        """The elements, one by one."""
        steps = max(self.elements - 1, 1)
        ratio = self.longest / self.shortest
        slips = [self.shortest * ratio ** (j / steps) for j in range(self.elements)]
        return friction.bundle([self.coulomb / self.elements] * self.elements, slips)


class Operators(NamedTuple):
    """Rolling friction element by element, as an identification writes it."""

    weight: Annotated[tuple[float, ...], Quantity("N m | N", "[0, 1e6]", "force at which each element slips")]
    slip: Annotated[tuple[float, ...], Quantity("rad | m", "(0, 1e3]", "displacement at which each element slips")]
    stribeck: friction.Stribeck = friction.Stribeck()
    lag: plant.Lag = 0.0
    asymmetry: plant.Asymmetry = 0.0
    dwell: Dwell = Dwell()
    load: plant.LoadShare = 0.0
    along: Along = Along()
    lead: plant.Lead = Harmonic()
    ball_pass: plant.BallPass = Harmonic()
    warming: Warming = Warming()
    step: Step = Step()

    def operators(self) -> friction.StopOperators:
        """The elements, as given."""
        return friction.bundle(self.weight, self.slip)


class Dahl(NamedTuple):
    """Dahl's friction: one bristle that bends towards its limit as the axis moves."""

    coulomb: Annotated[float, Quantity("N m | N", "(0, 1e6]", "friction at speed, T_c")]
    range: Annotated[float, Quantity("rad | m", "(0, 1e3]", "T_c over the stiffness at rest, sigma_0")]
    exponent: Annotated[float, Quantity("", "[0.2, 4]", "n, the shape of the approach; 1 is exponential")] = 1.0
    lag: plant.Lag = 0.0
    asymmetry: plant.Asymmetry = 0.0
    dwell: Dwell = Dwell()
    load: plant.LoadShare = 0.0
    along: Along = Along()
    lead: plant.Lead = Harmonic()
    ball_pass: plant.BallPass = Harmonic()
    warming: Warming = Warming()
    step: Step = Step()

    def bristle(self) -> friction_bristle.Bristle:
        """The law, ready to run."""
        return friction_bristle.Bristle(self.coulomb, self.coulomb / self.range, self.exponent)


class Lugre(NamedTuple):
    """LuGre friction: a damped bristle whose limit follows Stribeck's curve."""

    coulomb: Annotated[float, Quantity("N m | N", "(0, 1e6]", "friction at speed, T_c")]
    range: Annotated[float, Quantity("rad | m", "(0, 1e3]", "T_c over the stiffness at rest, sigma_0")]
    damping: Annotated[float, Quantity("N m s/rad | N s/m", "[0, 1e9]", "damping of the bristle, sigma_1")] = 0.0
    stribeck: friction.Stribeck = friction.Stribeck()
    lag: plant.Lag = 0.0
    asymmetry: plant.Asymmetry = 0.0
    dwell: Dwell = Dwell()
    load: plant.LoadShare = 0.0
    along: Along = Along()
    lead: plant.Lead = Harmonic()
    ball_pass: plant.BallPass = Harmonic()
    warming: Warming = Warming()
    step: Step = Step()

    def bristle(self) -> friction_bristle.Bristle:
        """The law, ready to run."""
        return friction_bristle.Bristle(self.coulomb, self.coulomb / self.range, 1.0, self.damping, self.stribeck)


LAWS = {"rolling": Rolling, "stop-operators": Operators, "dahl": Dahl, "lugre": Lugre}


EFFECTS = ("lag", "asymmetry", "dwell", "load", "along", "lead", "ball_pass", "warming", "step")  # of every law


def friction_of(law: Rolling | Operators | Dahl | Lugre) -> stage.Friction:
    """The plant's friction: a bundle of stop operators, or a bristle with a bundle that carries nothing."""
    if isinstance(law, Rolling | Operators):
        friction_ = stage.Friction(law.operators(), law.stribeck)
    else:
        friction_ = stage.Friction(friction.bundle([0.0], [1.0]), friction.Stribeck(), law.bristle())
    return friction_._replace(**effects_of(law))


def effects_of(law: Rolling | Operators | Dahl | Lugre) -> dict[str, Any]:
    """What changes the law's limit, by field; the same for every law."""
    return {name: getattr(law, name) for name in EFFECTS}
