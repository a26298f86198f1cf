"""What is known of mechanics and Coulomb friction before the fit: the stage file's values, or next to nothing.

A share of a value that is wrong by far is no knowledge.  So inertia and viscous friction each have two priors: the
stage file's with its doubt, and one as wide as the log's effort.  A rough model, one stop operator next to the
mechanics, says under which of them the log is likeliest; the diagnosis of the gap chooses in the same way
(`gap.selection.priors`).  Its rows count as `FORM_VALUES` values: what it leaves is an error of form.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from stagectl import gaussian_evidence as gaussian
from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous import friction_columns
from stagectl.identification.simultaneous.captured_motion import Motion
from stagectl.identification.simultaneous.regressors import ACCELERATION, RIPPLE, VELOCITY, currents

MECHANICAL = (ACCELERATION, VELOCITY)


class Beliefs(NamedTuple):
    """Inertia, viscous friction and Coulomb friction before the fit."""

    mean: tuple[float, float]  # of inertia and viscous friction: the stage file's, or the rough model's where doubted
    deviation: tuple[float, float]
    doubted: tuple[bool, bool]  # whether the log says that the stage file's value is wrong by far
    inertia: float  # kg m^2 | kg, of the rough model: a search begins there
    coulomb: float  # N m | N, about

    @property
    def inertia_doubt(self) -> float:
        """Standard deviation of the inertia's logarithm."""
        return math.log1p(self.deviation[0] / self.mean[0])


def beliefs(seen: Motion, file: StageFile, delay: float) -> Beliefs:
    """The likeliest of the priors, with the Coulomb friction that the rough model finds beside it."""
    some = np.column_stack([np.vstack(seen.free)[:, : RIPPLE.start + 2 * seen.gravity], _state(seen)])
    force = file.motor.force_constant * currents(seen.parts, np.array([delay]))[:, 0]
    rms, mean = float(np.sqrt(np.mean(force * force))), (file.mechanics.inertia, file.mechanics.viscous)
    narrow = _doubts(file)
    wide = rms / np.sqrt(np.mean(some[:, MECHANICAL] ** 2, axis=0))
    gram, right, square = some.T @ some, some.T @ force, float(force @ force)

    def known(doubted: tuple[bool, bool], power: float) -> gaussian.Posterior:
        center, spread = np.zeros(len(gram)), np.full(len(gram), rms)
        center[list(MECHANICAL)], spread[list(MECHANICAL)] = mean, np.where(doubted, wide, narrow)
        prior = gaussian.independent(center, spread)
        return gaussian.posterior(gaussian.Sums(power * gram, power * right, power * square), prior)

    left = float(np.mean((force - some @ np.linalg.lstsq(some, force, rcond=None)[0]) ** 2))
    worth = thresholds.FORM_VALUES / (len(force) * max(left, (thresholds.ROUGH_RESIDUAL * rms) ** 2))
    choices = [(bool(first), bool(second)) for first, second in itertools.product((False, True), repeat=2)]
    doubted = max(choices, key=lambda choice: known(choice, worth).log_evidence)
    rough = 1.0 / (thresholds.WINDOW_CORRELATION * (thresholds.ROUGH_RESIDUAL * rms) ** 2)
    found = known(doubted, rough).mean
    inertia = max(float(found[ACCELERATION]), thresholds.LEAST_INERTIA * mean[0])
    center = np.where(doubted, [inertia, found[VELOCITY]], mean).tolist()
    spread = np.where(doubted, wide, narrow).tolist()
    friction = max(abs(float(found[-1])), thresholds.LEAST_FRICTION * rms)
    return Beliefs((center[0], center[1]), (spread[0], spread[1]), doubted, inertia, friction)


def _state(seen: Motion) -> Array:
    """One stop operator (rows,) of middle slip."""
    slip = float(seen.shapes.slip[len(seen.shapes.slip) // 2])
    return np.concatenate([x.smoothed(friction_columns.operator(x.position, slip)) for x in seen.paths])


def _doubts(file: StageFile) -> tuple[float, float]:
    """Standard deviations of the stage file's inertia and viscous friction."""
    p = file.mechanics
    viscous = thresholds.VISCOUS_DOUBT * p.viscous + thresholds.NATURAL_DAMPING * p.inertia
    return thresholds.INERTIA_DOUBT * p.inertia, viscous
