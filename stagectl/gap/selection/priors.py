"""What is known of the base model before any data: a width around each nominal value, and bounds that the logs set.

A parameter that the motion does not excite stays where it was, with an interval as wide as what was known.  The data
count by their number of half strokes, not of samples, as what a model leaves is no noise::

    minimise   a |r - X d|^2 + sum ((d + moved) / width)^2          a = 1 / (1 + left / half strokes)

`left` is the sum of squares that no amplitude of the columns explains, above the floor of repeats.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import least_squares
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.selection import constants, evidence, thresholds
from stagectl.gap.selection.evidence import Conditioned, conditioned
from stagectl.kernels import stage

_Model = TypeVar("_Model")
WEIGHT, MEMBER = "weight_", "bristle_"
RELATIVE = ("bristle_size", "bristle_length")  # a step of these is a share of the nominal bristle


class Prior(NamedTuple):
    """The nominal model with free friction elements, and what the logs and the machine say about its parameters."""

    nominal: TrackedModel
    effort: float  # N m | N, rms of the logs' effort
    largest: float  # N m | N, largest effort of the logs
    speed: float  # rad/s | m/s, largest of the logs
    dt: float  # s
    strokes: int  # distinct half strokes that count
    force: float  # N m | N, standard deviation of each force of the friction and of the bias
    viscous: float  # N m s/rad | N s/m, that of the viscous friction

    def width(self, name: str) -> float:
        """Standard deviation of the parameter `name` around its nominal value, in its own unit."""
        p = self.nominal.stage
        known = {
            "inertia": constants.INERTIA * p.mechanics.inertia,
            "viscous": self.viscous,
            "time_shift": self.dt,
            "dead_time": self.dt,
        }
        known |= {"bristle_size": self.force / (p.friction.bristle.coulomb or 1.0), "bristle_length": constants.LENGTH}
        return known.get(name, self.force)

    def bounds(self, model: TrackedModel, name: str) -> tuple[float, float]:
        """How far `name` may move from its value in `model`: what drives no log, and rubs no more than its effort."""
        p = model.stage
        if name == "time_shift":
            most = thresholds.MOST_SHIFT * self.dt
            return -most - model.shift, most - model.shift
        if name == "dead_time":
            return -self.delay(model), thresholds.MOST_SHIFT * self.dt
        if name == "bias":
            return -self.largest - p.mechanics.bias, self.largest - p.mechanics.bias
        if name == "inertia":
            return thresholds.LOWEST_MECHANICS * p.mechanics.inertia, np.inf
        if name == "viscous":
            low, most = thresholds.LOWEST_MECHANICS * p.mechanics.viscous, self.largest / self.speed
            return low, max(most - p.mechanics.viscous, 0.0)
        if name in RELATIVE:
            return thresholds.LOWEST_BRISTLE, np.inf
        weight = p.friction.bristle.coulomb
        if name.startswith(WEIGHT):
            weight = float(p.friction.operators.weight[int(name.removeprefix(WEIGHT))])
        return -weight, max(self.largest - weight, 0.0)

    def moved(self, model: TrackedModel, name: str) -> float:
        """How far `name` is from its nominal value in `model`; as a share of that for the nominal bristle."""
        if name == "dead_time":
            return self.delay(model) - self.delay(self.nominal)
        nominal = _value(self.nominal, name)
        change = _value(model, name) - nominal
        return change / nominal if name in RELATIVE else change

    def delay(self, model: TrackedModel) -> float:
        """From a command to the drive's target (s)."""
        drive = model.stage.drive
        return drive.delay_samples * self.dt + drive.dead_time

    def limits(self, model: TrackedModel, names: Sequence[str]) -> Array:
        """`bounds` (k, 2) of all `names`."""
        return np.array([self.bounds(model, name) for name in names]).reshape(-1, 2)

    def informed(self, model: TrackedModel, names: Sequence[str]) -> dict[str, tuple[float, float]]:
        """How far each of `names` has moved in `model`, and its width."""
        return {name: (self.moved(model, name), self.width(name)) for name in names}

    def cost(self, model: TrackedModel, names: Sequence[str]) -> float:
        """Sum of the squares of how far all `names` have moved, in their widths."""
        return sum((moved / width) ** 2 for moved, width in self.informed(model, names).values())


def prior_of(nominal: TrackedModel, runs: Sequence[Run], dt: float) -> Prior:
    """What the logs of `runs` say before any fit; `nominal` has the free elements of the family."""
    constant = nominal.stage.motor.force_constant
    rows = np.concatenate([run.mean.rows for run in runs])
    effort = constant * np.where(np.isnan(rows[:, 2]), rows[:, 0], rows[:, 2])
    speed = max(float(np.abs(np.gradient(run.mean.rows[:, 1], dt)).max()) for run in runs)
    strokes = sum(len(np.unique(run.cluster[run.weight > 0.0])) for run in runs)
    largest, usual = float(np.nanmax(np.abs(constant * rows[:, 0]))), float(np.sqrt(np.nanmean(effort * effort)))
    force = constants.FRICTION * stage.sliding(nominal.stage.friction) or usual  # of no friction nothing is known
    viscous = constants.VISCOUS * nominal.stage.mechanics.viscous or usual / max(speed, 1e-12)
    return Prior(nominal, usual, largest, max(speed, 1e-12), dt, max(strokes, 1), force, viscous)


def believed(g: Grams, names: Sequence[str], prior: Prior) -> Prior:
    """`prior`, or with Coulomb or viscous friction as wide as the logs' effort, or both: what makes them likeliest.

    A share of a value that is wrong by far is no knowledge.  `g` is that of the nominal model.
    """
    weight, places = temper(g, names, prior), tuple(g.places(names))
    summed = weight * g.both.sum(axis=0)
    data = Conditioned(summed[:-1, :-1], summed[:-1, -1], 0.0)

    def log_evidence(p: Prior) -> float:
        width = np.array([p.width(name) for name in names])
        return conditioned(data, evidence.Prior(places, np.zeros(len(names)), width)).log_evidence

    forces, viscous = (prior.force, prior.effort), (prior.viscous, prior.effort / prior.speed)
    return max((prior._replace(force=f, viscous=v) for f in forces for v in viscous), key=log_evidence)


def _value(model: TrackedModel, name: str) -> float:
    p, friction = model.stage, model.stage.friction
    if name == "time_shift":
        return model.shift
    if name.startswith(WEIGHT):
        return float(friction.operators.weight[int(name.removeprefix(WEIGHT))])
    if name == "bristle_length":
        return friction.bristle.coulomb / friction.bristle.stiffness
    return friction.bristle.coulomb if name.startswith(MEMBER) else float(getattr(p.mechanics, name))


def temper(g: Grams, names: Sequence[str], prior: Prior) -> float:
    """Weight of the data against the prior: the more a model leaves, the less its samples are independent."""
    summed = g.both.sum(axis=0)
    left = least_squares.fit(summed, g.places(names)).residual_sum_of_squares - float(g.floor.sum())
    return evidence.temper(left, prior.strokes)


class Step(NamedTuple):
    """A Gauss-Newton step."""

    move: dict[str, float]
    promised: float  # by how much it lowers the cost if the model is linear


def bounded_step(
    g: Grams, names: Sequence[str], bounds: Array, informed: Mapping[str, tuple[float, float]], weight: float
) -> Step:
    """The step of the columns `names` within `bounds` (k, 2); `informed` has (moved, width) of those with a prior.

    `weight` is that of the data.
    """
    summed = g.both.sum(axis=0)
    places = g.places(names)
    for name, place in zip(names, places, strict=True):
        if name in informed:
            moved, width = informed[name]
            precision = 1.0 / (weight * width * width)
            summed[place, place] += precision
            summed[place, -1] -= precision * moved
    step = least_squares.bounded(summed, places, *bounds.T)
    left = least_squares.residual_sum_of_squares(summed, places, step)
    return Step(dict(zip(names, step.tolist(), strict=True)), weight * float(summed[-1, -1] - left))


def shortened(
    step: Mapping[str, float], moved: Callable[[dict[str, float]], _Model], cost: Callable[[_Model], float], now: _Model
) -> tuple[_Model, float]:
    """`moved` by the whole `step` or by the first share of it that costs less than `now`, and by how much less.

    `now` and 0 where none does.
    """
    before = cost(now)
    for share in thresholds.STEP_SHARES:
        after = moved({name: share * value for name, value in step.items()})
        if (remaining := cost(after)) < before:
            return after, before - remaining
    return now, 0.0
