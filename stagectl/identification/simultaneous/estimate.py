"""What an answer says of the parameters that a user reads: values, intervals, what the stage file had said before."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture
from stagectl.identification.result import Parameter
from stagectl.identification.simultaneous.evidence import Answer
from stagectl.identification.simultaneous.model import DelayPrior, Problem
from stagectl.identification.simultaneous.regressors import ACCELERATION, ONE, RIPPLE, VELOCITY
from stagectl.units import ROTARY

NAMES = ("inertia", "viscous", "coulomb", "offset", "delay")


class Estimate(NamedTuple):
    """The answer in the parameters of NAMES."""

    problem: Problem
    answer: Answer
    parameters: dict[str, Parameter]
    covariance: Array  # (5, 5) of NAMES; row and column of a given delay are 0
    per_delay: Array  # (5,) change of each per second of delay
    theta: Array  # (m,) of all columns, at the best scales and delay
    residual: Array  # (rows,) N m | N, there
    ripple: float | None  # N m | N, once per revolution; None: none is seen
    prior: dict[str, tuple[float, float]]  # value and half interval before the data: inertia, viscous, delay

    @property
    def file(self) -> StageFile:
        """The stage file of the axis."""
        return self.problem.file

    @property
    def delay_fitted(self) -> bool:
        """Whether the delay was not given."""
        return self.problem.delay.deviation > 0.0

    def rests_on_prior(self, name: str) -> bool:
        """Whether the data say little of a parameter."""
        before = self.prior.get(name, (0.0, math.inf))[1]
        return before > 0.0 and self.parameters[name].half > thresholds.NOT_EXCITED * before


def known_delay(captures: list[Capture], file: StageFile) -> DelayPrior:
    """The delay from the current column to the position as the stage file has it, and its doubt."""
    drive, period = file.drive, file.control.period
    late = 0.0
    if any(capture.current_column != "measured_current" for capture in captures):
        late = (drive.delay_samples + 0.5) * period + drive.current_lag
    return DelayPrior(late, max(thresholds.DELAY_PERIODS * period, thresholds.DELAY_DOUBT))


def estimated(answer: Answer) -> Estimate:
    """The parameters with their intervals of 95 %."""
    p = answer.problem
    sums = _sums(p)
    mean, covariance = answer.moments(sums)
    halves = thresholds.NORMAL_95 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    named = [*zip(NAMES, mean.tolist(), halves.tolist(), strict=True), *_gravity(p, answer)]
    parameters = {name: Parameter.named(name, p.file.axis.kind, value, half) for name, value, half in named}
    best = answer.best
    theta, delay = best.known.mean[:, best.best], float(best.delays[best.best])
    residual = p.forces(np.array([delay])).rows[:, 0] - p.columns @ theta
    return Estimate(
        p, answer, parameters, covariance, _per_delay(p, answer, sums), theta, residual, _ripple(p, answer), _prior(p)
    )


def _sums(p: Problem) -> Array:
    """(4, m) from all columns to NAMES without the delay."""
    sums = np.zeros((len(NAMES) - 1, len(p.gram)))
    sums[0, ACCELERATION] = sums[1, VELOCITY] = sums[3, ONE] = 1.0
    for name in ("operators", "bristles", "law"):
        sums[2, p.groups[name]] = 1.0
    return sums


def _per_delay(p: Problem, answer: Answer, sums: Array) -> Array:
    """(5,) change of each parameter per second of delay, at the best scales."""
    best = answer.best
    middle, step = float(best.delays[best.best]), thresholds.DELAY_STEP
    ends = p.forces(np.array([middle - step, middle + step]))
    power = 1.0 / (answer.worth * best.variance)
    prior = p.prior(best.scales)
    solved = np.linalg.solve(power * p.gram + prior.precision, power * ends.right)
    change = sums @ (solved[:, 1] - solved[:, 0]) / (2.0 * step)
    return np.append(change, 1.0)


def _once_per_turn(p: Problem, answer: Answer) -> tuple[Array, Array]:
    """Weights (2,) N m of sine and cosine of the angle, and their covariance (2, 2)."""
    pair = np.zeros((2, len(p.gram)))
    pair[:, RIPPLE.start : RIPPLE.start + 2] = np.eye(2)
    mean, covariance = answer.moments(pair)
    return mean[:2], covariance[:2, :2]


def _gravity(p: Problem, answer: Answer) -> list[tuple[str, float, float]]:
    """Names, values and half intervals (N m) of gravity's terms, where the axis turns in gravity."""
    if not p.gravity:
        return []
    mean, covariance = _once_per_turn(p, answer)
    halves = thresholds.NORMAL_95 * np.sqrt(np.diag(covariance))
    return list(zip(("gravity_sine", "gravity_cosine"), mean.tolist(), halves.tolist(), strict=True))


def _ripple(p: Problem, answer: Answer) -> float | None:
    """Amplitude (N m | N) of a ripple once per revolution that is beyond chance; gravity hides it."""
    travel = max(float(np.ptp(rows.capture.position)) for rows in p.parts)
    if p.gravity or p.file.axis.kind != ROTARY or travel < thresholds.RIPPLE_TRAVEL:
        return None
    mean, covariance = _once_per_turn(p, answer)
    wald = float(mean @ np.linalg.solve(covariance, mean))
    return math.hypot(*mean) if wald > thresholds.RIPPLE else None


def _prior(p: Problem) -> dict[str, tuple[float, float]]:
    """Value and half interval of what is known before the data."""
    before = p.prior(thresholds.FIRST_SCALES)
    deviation = 1.0 / np.sqrt(np.diag(before.precision))
    known = {
        name: (float(before.mean[place]), thresholds.NORMAL_95 * float(deviation[place]))
        for name, place in (("inertia", ACCELERATION), ("viscous", VELOCITY))
    }
    return known | {"delay": (p.delay.mean, thresholds.NORMAL_95 * p.delay.deviation)}
