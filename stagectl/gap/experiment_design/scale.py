"""What of a stage its experiments are scaled to, and how much motion its limits and its current leave."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.gap.logs.session import GapError
from stagectl.kernels.stage import Friction

BACK = 0.95  # of friction after a reversal
LEAST_REACH = 0.02  # of the stroke, to its nearer end
WORKING = 0.5  # of the largest current, that must do more than hold friction
COARSEST = 100.0  # encoder steps: a shorter presliding length cannot be seen


class Scale(NamedTuple):
    """A stage in its unit of travel: metres of table, or radians where an axis has no lead."""

    unit: str  # m | rad
    low: float  # lowest position, from where the axis stands
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
        return rounded(min(max(0.01 * self.span, 4.0 * self.presliding), 0.2 * self.reach))

    @property
    def reach(self) -> float:
        """The shorter way to an end of the travel, from where the axis stands (m)."""
        return min(-self.low, self.high)


def scale_of(setup: Setup) -> Scale:
    """The scale of this stage.

    Raises GapError where it has no room to move both ways, or not the current to.
    """
    return checked(_scale(setup), str(setup.path))


def checked(found: Scale, place: str) -> Scale:
    """`found`, which `place` describes, where its axis can move.

    Raises GapError where it has no room to move both ways, or not the current to.
    """
    if not found.reach > max(LEAST_REACH * found.span, 8.0 * found.presliding):
        raise GapError(
            f"limits.travel = [{found.low:g}, {found.high:g}] {found.unit} in {place}; the experiments move both "
            f"ways from where the axis stands, so both ends must be at least "
            f"{max(LEAST_REACH * found.span, 8.0 * found.presliding):.3g} {found.unit} away from 0: count the travel "
            "from a place within the stroke, and start there"
        )
    if not WORKING * found.effort > found.resisting:
        raise GapError(
            f"drive.current_limit = {found.current_limit:g} A in {place} gives an effort of {found.effort:g}; "
            f"friction and bias alone take {found.resisting:g}, and at least {found.resisting / WORKING:.3g} is needed "
            "to move freely: raise the limit, or correct the model's friction"
        )
    return found


def _scale(setup: Setup) -> Scale:
    p, axis, limits = setup.stage, setup.file.axis, setup.file.limits
    per_unit = axis.travel_per_unit
    return Scale(
        unit=axis.travel_unit,
        low=limits.travel[0] * per_unit,
        high=limits.travel[1] * per_unit,
        speed=limits.speed * per_unit,
        acceleration=limits.acceleration * per_unit,
        effort=p.motor.force_constant * p.drive.current_limit,
        resisting=_coulomb(p.friction) + abs(p.mechanics.bias),
        viscous=p.mechanics.viscous / per_unit,
        inertia=p.mechanics.inertia / per_unit,
        presliding=max(presliding(p.friction), COARSEST * p.encoder.step) * per_unit,
        pitch=p.mechanics.pitch * per_unit,
        encoder_step=p.encoder.step * per_unit,
        current_limit=p.drive.current_limit,
        dt=setup.dt,
    )


def presliding(p: Friction) -> float:
    """Travel (rad | m) from a reversal until friction is back at 95 % of itself; 0 without friction.

    Stop operators that were all slipping give ``sum alpha_j min(x / delta_j - 1, 1)``, a bristle of exponent 1
    ``T_c (1 - 2 exp(-sigma_0 x / T_c))``.
    """
    weight, slip = np.asarray(p.operators.weight), np.asarray(p.operators.slip)
    bristle = p.bristle.coulomb * math.log(2.0 / (1.0 - BACK)) / p.bristle.stiffness
    if not weight.sum() > 0.0:
        return bristle
    x = np.linspace(0.0, 2.0 * slip[weight > 0.0].max(), 2001)
    force = np.minimum(x[:, None] / slip - 1.0, 1.0) @ weight
    return max(float(x[np.argmax(force >= BACK * weight.sum())]), bristle)


def _coulomb(p: Friction) -> float:
    bristle = p.bristle
    return float(np.sum(p.operators.weight)) * (1.0 + p.stribeck.rise) + bristle.coulomb * (1.0 + bristle.stribeck.rise)


def rounded(value: float, digits: int = 3) -> float:
    """As a person would write it in a file."""
    return float(f"{value:.{digits}g}")


def largest_acceleration(p: Scale, share: float, speed: float = 0.0) -> float:
    """What this share of the current, and of the limit, leaves for accelerating at `speed` (m/s^2)."""
    left = max(share * p.effort - p.resisting - p.viscous * speed, 0.05 * p.effort)
    return min(share * p.acceleration, left / p.inertia)


def largest_speed(p: Scale, share: float) -> float:
    """What this share of the current holds for ever, and of the limit allows (m/s)."""
    left = max(share * p.effort - p.resisting, 0.05 * p.effort)
    return min(share * p.speed, left / p.viscous if p.viscous else math.inf)


def largest_amplitude(p: Scale, share: float, frequency: float) -> float:
    """Of a sine that takes this share of the current, and of the limits of speed, acceleration and travel (m)."""
    w = 2.0 * math.pi * frequency
    left = max(share * p.effort - p.resisting, 0.05 * p.effort)
    per_travel = sine_effort(p, 1.0, frequency) - p.resisting
    return min(share * p.reach, share * p.speed / w, share * p.acceleration / (w * w), left / per_travel)


def sine_effort(p: Scale, amplitude: float, frequency: float) -> float:
    """Largest effort (N m | N) of a sine, ``|J w^2 + i D w| A + T_c``: a bound, as friction peaks with velocity."""
    w = 2.0 * math.pi * frequency
    return amplitude * w * math.hypot(p.inertia * w, p.viscous) + p.resisting
