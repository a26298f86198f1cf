"""What a wrong friction law alone leaves: an ensemble of machines without any effect.

Each has another law of the family (Maxwell slip with random elements, Dahl with a random exponent, LuGre), with the
strength and about the length of the refitted one, and moves along the same measured path.  The residual of the base
model on such a machine is form error and nothing else: a column that the evidence integrates out.
"""

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.sensitivities import Direction, TrackedModel
from stagectl.gap.selection import thresholds
from stagectl.kernels import friction, friction_bristle, stage
from stagectl.kernels.fields import put

PREFIX = "null_"


def members(model: TrackedModel, count: int, seed: int, usual: float) -> list[Direction]:
    """Machines without an effect, as directions whose "column" is the residual of the base model on them.

    Where the refit has left no friction in the model, theirs is `usual` (N m | N).
    """
    source, p = np.random.default_rng(seed), model.stage.friction
    coulomb = stage.sliding(p) or usual
    return [_member(f"{PREFIX}{k}", _law(p, coulomb, k, source)) for k in range(count)]


def _member(name: str, law: stage.Friction) -> Direction:
    return Direction(name, lambda m: put(m, "stage.friction", law), 1.0)


def _law(p: stage.Friction, coulomb: float, number: int, source: Generator) -> stage.Friction:
    """The law of member `number`: Maxwell slip, LuGre and Dahl in turn."""
    zone = friction_family.length(p) * float(np.exp(thresholds.ZONE_SPREAD * source.standard_normal()))
    if number % 3 == 0:
        return _maxwell(p, coulomb, zone, source)
    lugre = number % 3 == 1
    exponent = 1.0 if lugre else float(source.uniform(*thresholds.EXPONENT_RANGE))
    damping = float(source.uniform(*thresholds.DAMPING_RANGE)) if lugre else 0.0
    return _bristle(p, coulomb, zone, exponent, damping)


def _maxwell(p: stage.Friction, coulomb: float, zone: float, source: Generator) -> stage.Friction:
    count = int(source.integers(*thresholds.ELEMENT_COUNTS))
    shortest, longest = thresholds.SLIP_RANGE
    slip = zone * np.exp(source.uniform(np.log(shortest), np.log(longest), count))
    weight = source.dirichlet(np.full(count, thresholds.WEIGHT_CONCENTRATION)) * coulomb
    return p._replace(operators=friction.bundle(weight, np.sort(slip)), bristle=friction_bristle.NEUTRAL)


def _bristle(p: stage.Friction, coulomb: float, zone: float, exponent: float, damping: float) -> stage.Friction:
    """A bristle that has reversed by 95 % after `zone`; `damping` is in twice the root of its stiffness times 1e-6."""
    stiffness = coulomb * _reach(exponent) / zone
    micro = damping * 2.0 * np.sqrt(stiffness * 1e-6)  # small: it damps, it does not carry
    bristle = friction_bristle.Bristle(coulomb, stiffness, exponent, float(micro), p.stribeck)
    return p._replace(operators=friction.bundle([0.0], [1.0]), bristle=bristle)


def _reach(exponent: float) -> float:
    """Range lengths after which a bristle has moved 95 % of the way from -1 to 1."""
    if exponent == 1.0:
        return float(np.log(2.0 / thresholds.RANGE_LEFT))
    e = 1.0 - exponent
    return float((2.0**e - thresholds.RANGE_LEFT**e) / e)


def member_names(names: Sequence[str]) -> list[str]:
    """The members among column names."""
    return [name for name in names if name.startswith(PREFIX)]
