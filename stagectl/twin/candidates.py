"""What the model may be off by: each candidate with the model that is off by a small step of it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from stagectl.kernels import stage
from stagectl.twin import thresholds

PRESLIDING, BEND = "presliding", "presliding_curve"  # always in the fit: another friction law is no effect
FORM = (PRESLIDING, BEND)

Change = Callable[[stage.Stage], stage.Stage]


class TwinCandidate(NamedTuple):
    """What the model may be off by; its size theta is in units of `scale`."""

    name: str
    unit: str  # rotary | linear, of scale and nominal
    nominal: float
    scale: float
    material: float  # theta below which it does not matter
    prior: float  # theta, one standard deviation of what is thinkable
    gauge: str  # of theta: % | Ts | ...


def of_mechanics(p: stage.Stage, dt: float) -> list[tuple[TwinCandidate, Change]]:
    """Each candidate of the mechanics that `p` has a scale for, with its change of the model by `thresholds.NUDGE`."""
    body, sliding = p.mechanics, stage.sliding(p.friction)
    viscous = body.viscous or thresholds.NATURAL_RATE * body.inertia
    holding = sliding or thresholds.NATURAL_RATE * viscous
    length = friction_length(p.friction)
    form = (thresholds.MATERIAL_FORM, thresholds.PRIOR_FORM, "%")
    shift = TwinCandidate("time_shift", "s", 0.0, dt, thresholds.MATERIAL_SHIFT, thresholds.PRIOR_SHIFT, "Ts")
    coulomb = TwinCandidate("coulomb", "N m | N", sliding, sliding, thresholds.MATERIAL, thresholds.PRIOR, "%")
    changes: list[tuple[TwinCandidate, Change]] = [
        _parameter(body, "mechanics", "inertia", "kg m^2 | kg", body.inertia),
        _parameter(body, "mechanics", "viscous", "N m s/rad | N s/m", viscous),
        (coulomb, _friction(stage.scaled_friction)),
        _parameter(body, "mechanics", "bias", "N m | N", holding),
        (shift, lambda p: p),  # its rows are nudged, not its model
        _parameter(p.motor, "motor", "force_constant", "N m/A | N/A", p.motor.force_constant),
        (TwinCandidate(PRESLIDING, "rad | m", length, length, *form), _friction(stage.stretched_friction)),
        (TwinCandidate(BEND, "", 0.0, float(length > 0.0), *form), _bent),
    ]
    return [pair for pair in changes if pair[0].scale > 0.0]


def of_drive(p: stage.Stage, dt: float) -> tuple[TwinCandidate, ...]:
    """The candidates of the drive, whose columns need no other model."""
    holding = (stage.sliding(p.friction) or thresholds.NATURAL_RATE * p.mechanics.inertia) / p.motor.force_constant
    return (
        TwinCandidate("current_gain", "", 0.0, 1.0, thresholds.MATERIAL_GAIN, thresholds.PRIOR, "%"),
        TwinCandidate("current_offset", "A", 0.0, holding, thresholds.MATERIAL, thresholds.PRIOR, "%"),
        TwinCandidate("dead_time", "s", 0.0, dt, thresholds.MATERIAL_DEAD_TIME, thresholds.PRIOR_SHIFT, "Ts"),
    )


def friction_length(p: stage.Friction) -> float:
    """Displacement (rad | m) after which all of the friction slips; 0 without presliding."""
    pairs = zip(p.operators.weight, p.operators.slip, strict=True)
    longest = max((float(slip) for weight, slip in pairs if weight > 0.0), default=0.0)
    return max(longest, 3.0 * p.bristle.coulomb / p.bristle.stiffness)


def _parameter(block: Any, of: str, name: str, unit: str, scale: float) -> tuple[TwinCandidate, Change]:
    """A field of the model's `block` that is called `of`, and the model with a small step of it."""
    nominal: float = getattr(block, name)
    stepped = block._replace(**{name: nominal + thresholds.NUDGE * scale})
    candidate = TwinCandidate(name, unit, nominal, scale, thresholds.MATERIAL, thresholds.PRIOR, "%")
    return candidate, lambda p: p._replace(**{of: stepped})


def _friction(change: Callable[[stage.Friction, float], stage.Friction]) -> Change:
    return lambda p: p._replace(friction=change(p.friction, 1.0 + thresholds.NUDGE))


def _bent(p: stage.Stage) -> stage.Stage:
    """Another curve into the same friction: weight from short elements to long ones, or another exponent."""
    rolling, bristle = p.friction.operators, p.friction.bristle
    weight = np.asarray(rolling.weight, dtype=np.float64)
    order = np.log(np.maximum(np.asarray(rolling.slip, dtype=np.float64), 1e-300))
    lean = order - np.average(order, weights=weight) if weight.sum() > 0.0 else np.zeros(len(weight))
    leaning = weight * (1.0 + thresholds.NUDGE * lean / max(float(np.max(np.abs(lean))), 1e-300))
    curved = bristle._replace(exponent=bristle.exponent * (1.0 + thresholds.NUDGE))
    operators = rolling._replace(weight=leaning)
    return p._replace(friction=p.friction._replace(operators=operators, bristle=curved))
