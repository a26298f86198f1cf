"""What of a stage its experiments are scaled to, and how much motion its limits and its current allow."""

import math
from typing import NamedTuple

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.gap.experiment_design import thresholds
from stagectl.gap.logs.session import GapError
from stagectl.kernels.stage import Friction, Stage
from stagectl.problem import Problem, ProblemKind


class StageScale(NamedTuple):
    """A stage in its unit of travel: metres of table, or radians where an axis has no lead."""

    unit: str  # m | rad
    low: float  # lowest position, relative to the initial one
    high: float
    speed: float  # limit, m/s
    acceleration: float  # limit, m/s^2
    effort: float  # of the largest current, N m | N
    resisting: float  # Coulomb friction at its highest, and the bias, N m | N
    viscous: float  # N m | N per m/s
    inertia: float  # N m | N per m/s^2
    presliding: float  # m, travel after which friction is back at 95 % after a reversal
    pitch: float  # m, over which screw, motor and encoder repeat
    encoder_step: float  # m
    current_limit: float  # A
    dt: float  # s, control period

    @property
    def span(self) -> float:
        """The whole stroke (m)."""
        return self.high - self.low

    @property
    def short(self) -> float:
        """A stroke far beyond presliding, and a small part of the whole one (m)."""
        short = max(thresholds.SHORT_SHARE * self.span, thresholds.SHORT_LENGTHS * self.presliding)
        return rounded(min(short, thresholds.SHORT_REACH * self.reach))

    @property
    def reach(self) -> float:
        """The shorter way to an end of the travel, from the initial position (m)."""
        return min(-self.low, self.high)


def scale_of(setup: Setup) -> StageScale:
    """The scale of this stage.  Raises GapError where it has no room to move both ways, or not the current to."""
    p, axis, limits = setup.stage, setup.file.axis, setup.file.limits
    per_unit = axis.travel_per_unit
    scale = StageScale(
        unit=axis.travel_unit,
        low=limits.travel[0] * per_unit,
        high=limits.travel[1] * per_unit,
        speed=limits.speed * per_unit,
        acceleration=limits.acceleration * per_unit,
        effort=p.motor.force_constant * p.drive.current_limit,
        resisting=_coulomb(p.friction) + abs(p.mechanics.bias),
        viscous=p.mechanics.viscous / per_unit,
        inertia=p.mechanics.inertia / per_unit,
        presliding=visible_presliding(p) * per_unit,
        pitch=p.mechanics.pitch * per_unit,
        encoder_step=p.encoder.step * per_unit,
        current_limit=p.drive.current_limit,
        dt=setup.dt,
    )
    return checked(scale, str(setup.path))


def checked(scale: StageScale, place: str) -> StageScale:
    """`scale`, which `place` describes, where its axis can move.

    Raises GapError where it has no room to move both ways, or not the current to.
    """
    least = max(thresholds.LEAST_REACH * scale.span, thresholds.LEAST_REACH_LENGTHS * scale.presliding)
    if not scale.reach > least:
        value = f"[{scale.low:g}, {scale.high:g}] {scale.unit}"
        reason = (
            f"in {place} the experiments move both ways from the initial position, so both ends must be at least "
            f"{least:.3g} {scale.unit} away from 0"
        )
        remedy = "count the travel from a place within the stroke, and start there"
        raise GapError(Problem(reason, ProblemKind.RANGE, "limits.travel", value, scale.unit, remedy=remedy))
    if not thresholds.WORKING_EFFORT * scale.effort > scale.resisting:
        needed = scale.resisting / thresholds.WORKING_EFFORT
        reason = (
            f"in {place} it gives an effort of {scale.effort:g}; friction and bias alone take {scale.resisting:g}, and "
            f"at least {needed:.3g} is needed to move freely"
        )
        value, remedy = f"{scale.current_limit:g} A", "raise the limit, or correct the model's friction"
        raise GapError(Problem(reason, ProblemKind.RANGE, "drive.current_limit", value, "A", remedy=remedy))
    return scale


def visible_presliding(p: Stage) -> float:
    """Presliding length (rad | m), or what the encoder resolves of it."""
    return max(presliding(p.friction), thresholds.RESOLVED_STEPS * p.encoder.step)


def presliding(p: Friction) -> float:
    """Travel (rad | m) from a reversal until friction is back at 95 % of itself; 0 without friction.

    Stop operators that were all slipping give ``sum alpha_j min(x / delta_j - 1, 1)``, a bristle of exponent 1
    ``T_c (1 - 2 exp(-sigma_0 x / T_c))``.
    """
    weight, slip = np.asarray(p.operators.weight), np.asarray(p.operators.slip)
    bristle = p.bristle.coulomb * math.log(2.0 / (1.0 - thresholds.FRICTION_BACK)) / p.bristle.stiffness
    if not weight.sum() > 0.0:
        return bristle
    x = np.linspace(0.0, 2.0 * slip[weight > 0.0].max(), 2001)
    force = np.minimum(x[:, None] / slip - 1.0, 1.0) @ weight
    return max(float(x[np.argmax(force >= thresholds.FRICTION_BACK * weight.sum())]), bristle)


def _coulomb(p: Friction) -> float:
    bristle = p.bristle
    return float(np.sum(p.operators.weight)) * (1.0 + p.stribeck.rise) + bristle.coulomb * (1.0 + bristle.stribeck.rise)


def rounded(value: float, digits: int = 3) -> float:
    """As a person would write it in a file."""
    return float(f"{value:.{digits}g}")


def _free_effort(p: StageScale, share: float, damping: float = 0.0) -> float:
    """What this share of the effort leaves beyond friction, bias and `damping` (N m | N)."""
    return max(share * p.effort - p.resisting - damping, thresholds.LEAST_EFFORT * p.effort)


def largest_acceleration(p: StageScale, share: float, speed: float = 0.0) -> float:
    """Acceleration at `speed` that this share of the current, and of the limit, allows (m/s^2)."""
    return min(share * p.acceleration, _free_effort(p, share, p.viscous * speed) / p.inertia)


def largest_speed(p: StageScale, share: float) -> float:
    """Speed that this share of the current sustains, and of the limit allows (m/s)."""
    return min(share * p.speed, _free_effort(p, share) / p.viscous if p.viscous else math.inf)


def largest_amplitude(p: StageScale, share: float, frequency: float) -> float:
    """Of a sine that takes this share of the current, and of the limits of speed, acceleration and travel (m)."""
    w = 2.0 * math.pi * frequency
    per_travel = sine_effort(p, 1.0, frequency) - p.resisting
    by_effort = _free_effort(p, share) / per_travel
    return min(share * p.reach, share * p.speed / w, share * p.acceleration / (w * w), by_effort)


def sine_effort(p: StageScale, amplitude: float, frequency: float) -> float:
    """Largest effort (N m | N) of a sine, ``|J w^2 + i D w| A + T_c``: a bound, as friction peaks with velocity."""
    w = 2.0 * math.pi * frequency
    return amplitude * w * math.hypot(p.inertia * w, p.viscous) + p.resisting
