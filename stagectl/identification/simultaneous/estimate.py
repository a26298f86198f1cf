"""What an answer says of the parameters that a user reads: values, intervals, what the stage file had said before.

**The controller's answer to noise.**  Noise that moves the axis is in the acceleration, and `evidence` takes its
sum of squares n v out of ``a' a``, as for an axis that nothing holds.  A closed loop ``L = w_c / s`` answers it with a
current.  With its mean sensitivity up to the window's cut-off w, ``S = 1 - (w_c / w) atan(w / w_c)``:

* of the acceleration's noise the share S is left, so that n v (1 - S) too much was taken out;
* the current's rate has ``- n v J^2 w_c S`` in common with the noise, as if the current came later: the delay is late.

Neither averages out.  With the posterior's precision A they shift all parameters by ``A^-1`` times these sums, and the
shift is taken out.  As w_c is that of the stage file, and the loop may be another one, the intervals hold any shift
from none to twice this one.  Where a capture has neither a reference nor an injected current, a controller is taken to
have moved the axis.  Where the encoder's noise is seen, the rows pass all of the answer, and nothing shifts
(`whitening`).  What is wrong with any of this shows in some frequencies and not in others (`agreement`).

**Friction that bends with speed.**  Two columns, ``v |v|`` and ``v^3``, hold what no straight line does.  D is the
slope of the line, from the Coulomb friction on, that is nearest over the speeds moved: what a stage file can hold.

**Where the residual is large.**  Of a current that jumps a log shows to a row when: there the residual is largest, and
there the delay is read.  A posterior with one variance for all rows does not know that; no variance is below that of
the sum of each row's influence times its residual (`standard_errors`).

Source: direct identification in closed loop, L. Ljung, System Identification, 2nd ed., 1999, section 13.4.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve

from stagectl.config.stage_blocks import StageFile
from stagectl.design import Control
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture
from stagectl.identification.result import Parameter
from stagectl.identification.simultaneous import agreement, temper
from stagectl.identification.simultaneous.evidence import Answer
from stagectl.identification.simultaneous.model import DelayPrior, Problem
from stagectl.identification.simultaneous.regressors import (
    ACCELERATION,
    BEND,
    ONE,
    RIPPLE,
    VELOCITY,
    controlled,
    repeats,
    stepped,
)
from stagectl.kernels.effects import TURN

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
    bend: tuple[float, float] | None  # viscous friction over speed, at rest and at the fastest; None: it is straight
    ripple: float | None  # N m | N, once per turn; None: none is seen
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


def known_delay(captures: list[Capture], file: StageFile, given: float | None) -> DelayPrior:
    """The delay from the current column to the position as the stage file has it, and its doubt; or the one `given`."""
    if given is not None:
        return DelayPrior(given, 0.0)
    drive, period = file.drive, file.control.period
    late = 0.0
    if any(capture.current_column != "measured_current" for capture in captures):
        late = (drive.delay_samples + 0.5) * period + drive.current_lag
    return DelayPrior(late, max(thresholds.DELAY_PERIODS * period, thresholds.DELAY_DOUBT))


class _Delay(NamedTuple):
    """What the delay changes, at the best one."""

    slope: Array  # (n,) of the whitened force, per second
    products: Array  # (m,) of all columns with it
    weights: Array  # (m,) of all columns, per second
    parameters: Array  # (5,) of NAMES, per second
    variance: float  # s^2, of the delay


def estimated(answer: Answer) -> Estimate:
    """The parameters with their intervals of 95 %."""
    p, best = answer.problem, answer.best
    sums = _sums(p)
    mean, covariance = answer.moments(sums)
    delay = _delay(p, answer, sums, float(covariance[-1, -1]))
    shift = _answered_noise(p, answer, sums, delay)
    added = _added_by_noise(p, answer, sums, delay, shift)
    noise = p.noise_doubt * added
    mean, covariance = mean - shift, covariance + thresholds.OTHER_LOOP**2 * np.outer(shift, shift)
    covariance += np.outer(noise, noise)
    theta = best.known.mean[:, best.best]
    residual = p.forces(best.delays[[best.best]]).rows[:, 0] - p.columns @ theta
    least = _scatter(p, answer, sums, delay, p.whitening(residual), added)
    least[-1] = max(least[-1], p.delay.deviation and _uneven(p) ** 2)
    factors = np.sqrt(np.maximum(least / np.maximum(np.diag(covariance), 1e-300), 1.0))
    covariance *= np.outer(factors, factors)
    halves = thresholds.NORMAL_95 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    named = [*zip(NAMES, mean.tolist(), halves.tolist(), strict=True), *_gravity(p, answer)]
    parameters = {name: Parameter.named(name, p.file.axis.kind, value, half) for name, value, half in named}
    seen = (_bend(p, answer), _ripple(p, answer))
    return Estimate(p, answer, parameters, covariance, delay.parameters, theta, residual, *seen, _prior(p))


def _sums(p: Problem) -> Array:
    """(4, m) from all columns to NAMES without the delay."""
    sums = np.zeros((len(NAMES) - 1, len(p.gram)))
    sums[0, ACCELERATION] = sums[1, VELOCITY] = sums[3, ONE] = 1.0
    sums[1, BEND] = _mean_slopes(p)
    for name in ("operators", "bristles", "law"):
        sums[2, p.groups[name]] = 1.0
    return sums


def _mean_slopes(p: Problem) -> Array:
    """Slope (BEND,) of each bend over the moved speeds: that of the line from zero that is nearest to it."""
    velocity = p.columns[:, VELOCITY]
    return np.asarray(velocity @ p.columns[:, BEND] / (velocity @ velocity), dtype=np.float64)


def _bend(p: Problem, answer: Answer) -> tuple[float, float] | None:
    """Viscous friction over the speed at rest and at the fastest, where it bends beyond chance."""
    rows, fastest = np.zeros((3, len(p.gram))), p.shapes.fastest
    rows[0, VELOCITY], rows[1:, BEND] = 1.0, np.diag([fastest, fastest**2])
    mean, covariance = answer.moments(rows)
    rest, bend = float(mean[0]), mean[1:-1]
    wald = float(bend @ np.linalg.solve(covariance[1:-1, 1:-1], bend))
    return (rest, rest + float(bend.sum())) if wald > thresholds.RIPPLE else None


def _delay(p: Problem, answer: Answer, sums: Array, variance: float) -> _Delay:
    middle, step = float(answer.best.delays[answer.best.best]), thresholds.DELAY_STEP
    rows = p.whitening(p.forces(np.array([middle - step, middle + step])).rows)
    slope = (rows[:, 1] - rows[:, 0]) / (2.0 * step)
    products = p.white.T @ slope
    weights = cho_solve(answer.best.known.factor, answer.power * products)
    return _Delay(slope, products, weights, np.append(sums @ weights, 1.0), variance)


def _answered_noise(p: Problem, answer: Answer, sums: Array, delay: _Delay) -> Array:
    """Shift (5,) of the parameters by a controller's answer to the noise that moved the axis."""
    if not any(controlled(rows.capture) and not stepped(rows) for rows in p.parts):
        return np.zeros(len(NAMES))
    control = p.file.control
    bandwidth = control.bandwidth if isinstance(control, Control) else control.velocity_bandwidth
    crossover = 2.0 * math.pi * bandwidth
    left, noise = _sensitivity(p, crossover), _moved(p, answer)
    pull = np.zeros(len(p.gram))
    pull[ACCELERATION] = (1.0 - left) * noise
    direct = cho_solve(answer.best.known.factor, pull)
    late = answer.power * float(delay.products @ direct) + crossover * left * noise * _inertia(answer)
    return np.append(sums @ direct, 0.0) + late * delay.variance * delay.parameters


def _scatter(p: Problem, answer: Answer, sums: Array, delay: _Delay, residual: Array, added: Array) -> Array:
    """Variances (5,) of NAMES as frequencies and rows of the whitened `residual` disagree on them; 0: one is given."""
    direct = cho_solve(answer.best.known.factor, sums.T).T
    late = answer.power * delay.variance * (p.white @ delay.weights - delay.slope)
    influence = np.vstack([answer.power * direct @ p.white.T, np.zeros(len(late))]) + np.outer(delay.parameters, late)
    kept = p.whitening.kept
    bands = [agreement.variance(of, residual, more, kept) for of, more in zip(influence, added.tolist(), strict=True)]
    return np.maximum(bands, [temper.of_sum(of, residual, answer.worth) for of in influence])


def _added_by_noise(p: Problem, answer: Answer, sums: Array, delay: _Delay, shift: Array) -> Array:
    """What the noise in the acceleration would add to NAMES (5,), were it not taken out."""
    noise, direct = _moved(p, answer), cho_solve(answer.best.known.factor, sums.T).T
    added = np.append(noise * direct[:, ACCELERATION], 0.0) - shift
    return np.asarray(added + noise * delay.variance * delay.weights[ACCELERATION] * delay.parameters)


def _uneven(p: Problem) -> float:
    """How well (s) the time stamps tell when a row was: a logger that is late now and then is late on average."""
    return max(rows.capture.unevenness for rows in p.parts)


def _inertia(answer: Answer) -> float:
    return float(answer.best.known.mean[ACCELERATION, answer.best.best])


def _moved(p: Problem, answer: Answer) -> float:
    """What was taken out of the acceleration's products with the force, weighed as the rows are."""
    return answer.power * p.acceleration_noise * _inertia(answer)


def _sensitivity(p: Problem, crossover: float) -> float:
    """Share of the noise that a loop with this `crossover` (rad/s) leaves below the window's cut-off."""
    ratio = 2.0 * math.pi * thresholds.WINDOW_BAND / (p.parts[0].q * p.parts[0].capture.dt * crossover)
    return 1.0 - math.atan(ratio) / ratio


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


def turns(p: Problem) -> float:
    """Turns of a motion that shows a ripple once per turn; 0 where it does not, or gravity hides it."""
    travel = max(float(np.ptp(rows.angle)) for rows in p.parts)
    shown = travel >= thresholds.RIPPLE_TRAVEL and repeats(p.file) and not p.gravity
    return travel / TURN if shown else 0.0


def over_position(p: Estimate) -> float:
    """Share of the residual that the place alone explains: in equal parts of the travel, its mean."""
    place = np.concatenate([rows.capture.position[rows.places.samples] for rows in p.problem.parts])
    edges = np.linspace(place.min(), place.max(), thresholds.PLACES + 1)[1:-1]
    part, left = np.digitize(place, edges), p.residual - p.residual.mean()
    sums, rows = np.bincount(part, left), np.maximum(np.bincount(part), 1)
    return float(np.sum(sums**2 / rows) / max(left @ left, 1e-300))


def _ripple(p: Problem, answer: Answer) -> float | None:
    """Amplitude (N m | N) of a ripple once per turn that is beyond chance."""
    if not turns(p):
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
