"""Where a cable spring does not pull: a centre beside the middle of the travel and a constant force are one direction.

::

    bias - k (x - middle)  =  nominal bias - k (x - centre),    centre = middle + (bias - nominal bias) / k

The data cannot tell the two apart.  A spring's centre lies within the travel, about as surely as a normal deviate lies
within its standard deviation; a bias is off by its prior width or not at all.  The more probable of the two is said.
"""

import math
from collections.abc import Mapping

from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels.fields import put

SPRING, BIAS = "cable_spring", "bias"


def centred(e: Evidence, now: Fitted) -> Fitted:
    """`now`, its constant force as the place of the spring's centre where that is the more probable cause of it."""
    spring, moved = _spring(now), e.base.prior.moved(now.model, BIAS)
    if spring is None:
        return now
    if bias_odds(moved, reach(now), e.base.prior.width(BIAS)) > 1.0:
        moved = 0.0
    stiffness = spring.values["stiffness"]
    centre = spring.values["centre"] + moved / stiffness
    placed = EffectValues(spring.effect, {"stiffness": stiffness, "centre": centre})  # in the order of texts
    effects = tuple(placed if valued is spring else valued for valued in now.effects)
    bias = now.model.stage.mechanics.bias - moved
    return now._replace(model=put(now.model, "stage.mechanics.bias", bias), effects=effects)


def bias_odds(moved: float, reach: float, width: float) -> float:
    """Odds of a bias that is off by a deviate of `width` and a centre, against a centre alone: `moved` is their force.

    All in N m | N; `reach` is the force of a centre one standard deviation off.
    """
    if reach == 0.0:
        return math.inf
    alone, both = reach * reach, reach * reach + width * width
    log_odds = 0.5 * (moved * moved * (1.0 / alone - 1.0 / both) - math.log(both / alone))
    return math.exp(min(log_odds, 700.0))


def reach(now: Fitted) -> float:
    """Constant force (N m | N) that a centre at either end of the travel gives; 0 without a spring."""
    spring = _spring(now)
    return abs(spring.values["stiffness"]) * _half_travel(spring) if spring else 0.0


def with_centre(now: Fitted, deviation: Mapping[str, float]) -> dict[str, float]:
    """Standard `deviation` of all parameters with that of the spring's centre: beside a bias that is off, the prior."""
    spring = _spring(now)
    if spring is None:
        return dict(deviation)
    centre, stiffness = spring.values["centre"], abs(spring.values["stiffness"])
    away = centre - spring.effect.shapes[0].grid[0]
    force = math.hypot(deviation.get(BIAS, 0.0), away * deviation[f"{SPRING}.stiffness"])
    return {**deviation, f"{SPRING}.centre": force / stiffness if away else _half_travel(spring)}


def _half_travel(spring: EffectValues) -> float:
    return 0.5 * (spring.effect.shapes[0].high - spring.effect.shapes[0].low)


def _spring(now: Fitted) -> EffectValues | None:
    """The cable spring of the model; none of no stiffness."""
    found = (valued for valued in now.effects if valued.effect.name == SPRING and valued.values["stiffness"])
    return next(found, None)
