"""How large a gain comes from a wrong friction law alone: an ensemble of machines without any effect.

Each has another law of the family (Maxwell slip with random elements, Dahl with a random exponent, LuGre), as strong
and about as long as the refitted one, and moves along the same measured path.  What the base model then lacks is
form error and nothing else; the search runs over it exactly as over the data.  An effect counts as found only where
its gain is beyond all that the ensemble gives that very effect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.sensitivities import Direction, Model
from stagectl.kernels import friction, friction_bristle, stage

PREFIX = "null_"


def members(model: Model, count: int, seed: int, usual: float) -> list[Direction]:
    """Machines without an effect, as directions whose "column" is what the base model lacks on them.

    Where the refit has left the model no friction at all, theirs is the `usual` one (N m | N).
    """
    source, p = np.random.default_rng(seed), model.stage.friction
    coulomb = stage.sliding(p) or usual
    return [_member(f"{PREFIX}{k}", _law(p, coulomb, k, source)) for k in range(count)]


def _member(name: str, law: stage.Friction) -> Direction:
    return Direction(name, lambda m: m._replace(stage=m.stage._replace(friction=law)), 1.0)


def _law(p: stage.Friction, coulomb: float, number: int, source: Generator) -> stage.Friction:
    """A law of the family in turn, of this strength; as long as `p` within a fifth."""
    zone = friction_family.length(p) * float(np.exp(0.2 * source.standard_normal()))
    if number % 3 == 0:
        return _maxwell(p, coulomb, zone, source)
    exponent = 1.0 if number % 3 == 1 else float(source.uniform(0.5, 2.0))
    damping = float(source.uniform(0.0, 0.02)) if number % 3 == 1 else 0.0
    return _bristle(p, (coulomb, zone, exponent, damping))


def _maxwell(p: stage.Friction, coulomb: float, zone: float, source: Generator) -> stage.Friction:
    count = int(source.integers(5, 16))
    slip = zone * np.exp(source.uniform(np.log(0.02), np.log(0.55), count))
    weight = source.dirichlet(np.full(count, 1.5)) * coulomb
    return p._replace(operators=friction.bundle(weight, np.sort(slip)), bristle=friction_bristle.NEUTRAL)


def _bristle(p: stage.Friction, shape: tuple[float, float, float, float]) -> stage.Friction:
    coulomb, zone, exponent, damping = shape
    # 95 % of a reversal after zone: of a Dahl bristle of n = 1 that is log(40/2) of its range, less or more of others.
    stiffness = coulomb * _reach(exponent) / zone
    micro = damping * 2.0 * np.sqrt(stiffness * 1e-6)  # small beside the rest: it damps, it does not carry
    bristle = friction_bristle.Bristle(coulomb, stiffness, exponent, float(micro), p.stribeck)
    return p._replace(operators=friction.bundle([0.0], [1.0]), bristle=bristle)


def _reach(exponent: float) -> float:
    """Range lengths after which a bristle has come 95 % of the way from -1 to 1."""
    if exponent == 1.0:
        return float(np.log(2.0 / 0.1))
    e = 1.0 - exponent
    return float((2.0**e - 0.1**e) / e)


def gains(names: Sequence[str]) -> list[str]:
    """The members among column names."""
    return [name for name in names if name.startswith(PREFIX)]
