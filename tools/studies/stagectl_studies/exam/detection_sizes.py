"""The size at which half of the trials with an effect are noticed at all, by class of effect.

    P(noticed) = 1 / (1 + exp(-k (log2 s - log2 s50)))

with one steepness for all classes and a limit for each, which a weak prior holds near that of all; s is the realised
size in units of the typical one.  Noticed: the answer says anything beyond what is true without the effect.  Naming is
judged at twice that limit: a class that is not noticed within `LARGEST` has no trials there, and is told.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from stagectl_studies.exam.rules import CLASS_OF

SMALLEST, LARGEST = 0.25, 8.0  # of the typical size; no trial tells more
SPREAD = 2.0  # octaves by which limits of classes differ
STEEPNESS = (2.0, 0.7)  # of the curve: mean and spread of its logarithm's prior, per octave


class Noticed(NamedTuple):
    """One single effect of an exam."""

    kind: str
    scale: float
    noticed: bool


def singles(records: Sequence[dict[str, Any]]) -> list[Noticed]:
    """All trials with one effect."""
    curves = []
    for record in records:
        if record["stratum"].startswith("single"):
            effect = next(each for each in record["truth"]["effects"] if not each["companion"])
            kind = CLASS_OF[effect["name"]]
            curves.append(Noticed(kind, effect["realised_scale"], bool(record["naming"]["alarm"])))
    return curves


def limits(trials: Sequence[Noticed]) -> dict[str, float]:
    """s50 of each class, between `SMALLEST` and `LARGEST`."""
    return {kind: float(_bounded(middle)) for kind, (middle, _) in _fitted(trials).items()}


def intervals_of(trials: Sequence[Noticed]) -> dict[str, tuple[float, float]]:
    """The same with 95 %: of the posterior's normal approximation, within the same bounds."""
    return {
        kind: (float(_bounded(middle - 1.96 * width)), float(_bounded(middle + 1.96 * width)))
        for kind, (middle, width) in _fitted(trials).items()
    }


def _bounded(octaves: float) -> Any:
    return np.clip(2.0**octaves, SMALLEST, LARGEST)


def _fitted(trials: Sequence[Noticed]) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of log2 s50 of each class."""
    kinds = sorted({trial.kind for trial in trials})
    if not kinds:
        return {}
    place = np.array([kinds.index(trial.kind) for trial in trials])
    octaves = np.log2([trial.scale for trial in trials])
    seen = np.array([1.0 if trial.noticed else -1.0 for trial in trials])

    def cost(p: Any) -> float:
        steep, middle, each = np.exp(p[0]), p[1], p[2:]
        margin = seen * steep * (octaves - each[place])
        prior = ((p[0] - np.log(STEEPNESS[0])) / STEEPNESS[1]) ** 2 + (middle / 4.0) ** 2
        prior += float(np.sum(((each - middle) / SPREAD) ** 2))
        return float(np.sum(np.logaddexp(0.0, -margin)) + 0.5 * prior)

    start = np.concatenate([[np.log(STEEPNESS[0])], np.zeros(1 + len(kinds))])
    best = minimize(cost, start, method="BFGS").x
    width = np.sqrt(np.diag(np.linalg.inv(_curvature(cost, best))))
    return {kind: (float(best[k]), float(width[k])) for k, kind in enumerate(kinds, start=2)}


def _curvature(cost: Callable[[Any], float], at: NDArray[np.float64], step: float = 1e-3) -> NDArray[np.float64]:
    """Second derivatives (n, n) of a smooth cost, by central differences."""
    moves = step * np.eye(len(at))
    hessian = [
        [cost(at + a + b) - cost(at + a - b) - cost(at - a + b) + cost(at - a - b) for b in moves] for a in moves
    ]
    return np.array(hessian) / (4.0 * step * step)


def beyond(record: dict[str, Any], known: dict[str, float], factor: float = 2.0) -> bool:
    """Whether the one effect of a trial is at least `factor` times the limit of its class."""
    effect = next(each for each in record["truth"]["effects"] if not each["companion"])
    limit = known.get(CLASS_OF.get(effect["name"], ""), LARGEST)
    return bool(effect["realised_scale"] >= factor * limit * (1.0 - 1e-9))
