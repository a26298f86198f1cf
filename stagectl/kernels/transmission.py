"""What moves: motor, load behind a compliance with backlash, the machine's base; and the velocity Verlet that moves it.

::

    effort --> [ motor ] --spring, damper, gap-- [ load ] <-- bias, cable
                  |  friction, 1 - load_friction     |  friction, load_friction
              ----+----------------- base -----------+----  on its feet: frequency, damping

Positions are relative to the base, as the encoder sees them.  With the efforts E between base and bodies, the moving
inertia J and the base's position x_b::

    q'' = (1 + mu) E / J + w^2 x_b + 2 zeta w x_b'          x_b'' = -mu E / J - w^2 x_b - 2 zeta w x_b'

Friction is a law of the motor's own motion and the same law of the load's, by their shares, each with its own memory:
within the gap the load rests on its own friction while the motor turns.

**Steps.**  Verlet turns a mode's phase too fast by ``(w h)^2 / 24``; `finer` divides the step until w h is at most
0.15, 0.1 % of the frequency, for the faster of resonance and base.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.kernels import effects
from stagectl.kernels.constants import LARGEST_ANGLE, STRAIGHT_BELOW
from stagectl.kernels.jit import kernel
from stagectl.kernels.plant import Mechanics


class Bodies(NamedTuple):
    """Positions (rad | m) and velocities (rad/s | m/s); without a transmission the load is the motor."""

    position: float
    velocity: float
    load: float
    load_velocity: float
    base: float
    base_velocity: float


class Coefficients(NamedTuple):
    """What holds during one drift."""

    half: float  # s, half a step
    motor: float  # inertia of the motor, all of it where rigid
    load: float  # inertia of the load; 0: rigid
    spring: float  # N m/rad | N/m
    damper: float  # N m s/rad | N s/m
    gap: float  # rad | m, half the backlash
    share: float  # of the friction at the load
    viscous: tuple[float, float]  # backward, forward
    base: tuple[float, float, float]  # mu, w^2, 2 zeta w


@kernel
def neutral(p: Mechanics) -> bool:
    """Whether one inertia with viscous friction is all there is."""
    smooth = p.viscous_power.effort == 0.0 and p.viscous_asymmetry == 0.0
    still = p.viscous_warming.rise == 0.0 and p.viscous_step.share == 0.0
    return smooth and still and not sprung(p) and p.base.ratio == 0.0 and free(p)


@kernel
def sprung(p: Mechanics) -> bool:
    """Whether a part of the inertia is behind a spring."""
    return p.transmission.load_share > 0.0 and p.transmission.resonance > 0.0


def rubbed_inertia(p: Mechanics) -> float:
    """Inertia that vibrates on the stiffness of the whole friction as fast as the faster body does on its share."""
    if not sprung(p):
        return p.inertia
    load, rubbed = p.transmission.load_share, p.transmission.load_friction
    return p.inertia / max(rubbed / load, (1.0 - rubbed) / (1.0 - load))


@kernel
def free(p: Mechanics) -> bool:
    """Whether neither cable nor gravity pulls."""
    return p.cable.stiffness == 0.0 and p.cable.hysteresis == 0.0 and p.gravity.amplitude == 0.0


@kernel
def finer(p: Mechanics, h: float) -> int:
    """Into how many steps one of `h` (s) is divided."""
    fastest = p.base.frequency if p.base.ratio > 0.0 else 0.0
    if p.transmission.load_share > 0.0:
        fastest = max(fastest, p.transmission.resonance)
    return max(math.ceil(2.0 * math.pi * fastest * h / LARGEST_ANGLE), 1)


@kernel
def coefficients(p: Mechanics, time: float, h: float) -> Coefficients:
    """At the session clock `time` (s), for steps of `h` (s)."""
    t = p.transmission
    load = p.inertia * t.load_share if t.resonance > 0.0 else 0.0
    motor, turning = p.inertia - load, 2.0 * math.pi * t.resonance
    reduced = motor * load / p.inertia
    viscous = p.viscous * effects.drifting(p.viscous_warming, p.viscous_step, time)
    foot = 2.0 * math.pi * p.base.frequency
    return Coefficients(
        0.5 * h,
        motor,
        load,
        turning * turning * reduced,
        2.0 * t.damping * turning * reduced,
        0.5 * t.backlash,
        t.load_friction if load > 0.0 else 0.0,
        (viscous * (1.0 - p.viscous_asymmetry), viscous * (1.0 + p.viscous_asymmetry)),
        (p.base.ratio, foot * foot, 2.0 * p.base.damping * foot),
    )


@kernel
def viscous(p: Mechanics, c: Coefficients, v: float) -> float:
    """Friction over velocity at `v`: ``D (1 + e sgn v) + c |v / v_c|^n / |v|``."""
    damping = c.viscous[1] if v > 0.0 else c.viscous[0]
    power = p.viscous_power
    if power.effort == 0.0:
        return damping
    ratio = (abs(v) + STRAIGHT_BELOW) / power.speed
    damping += power.effort / power.speed * math.pow(ratio, power.exponent - 1.0)
    # Far above the speeds at which it was fitted, a falling power must not drive the axis.
    if power.exponent > 1.0:
        damping = max(damping, 0.0)
    return damping


@kernel
def transmitted(c: Coefficients, x: Bodies) -> float:
    """Effort that the motor gives to the load; at a flank of the gap it pushes, and never pulls."""
    wound = x.position - x.load
    bent = wound - min(max(wound, -c.gap), c.gap)
    if c.gap > 0.0 and bent == 0.0:
        return 0.0
    carried_effort = c.spring * bent + c.damper * (x.velocity - x.load_velocity)
    return 0.0 if c.gap > 0.0 and carried_effort * bent < 0.0 else carried_effort


@kernel
def kicked(p: Mechanics, c: Coefficients, x: Bodies, efforts: tuple[float, float, float, float]) -> Bodies:
    """Half a step of velocity under `efforts` (N m | N) on motor and load, and their frictions without a viscous part.

    One inertia is exact while effort and viscous coefficient hold.
    """
    driving, pulling, friction, behind = efforts
    if c.load == 0.0:
        damping = viscous(p, c, x.velocity)
        gain = c.half / c.motor
        dv = gain * effects.relaxed(damping * gain) * (driving + pulling - friction - damping * x.velocity)
        return _recoiled(c, x, dv, dv)
    friction = (1.0 - c.share) * (friction + _drag(p, c, x.velocity, (1.0 - c.share) / c.motor))
    behind = c.share * (behind + _drag(p, c, x.load_velocity, c.share / c.load))
    carried_effort = transmitted(c, x)
    dv = c.half / c.motor * (driving - carried_effort - friction)
    return _recoiled(c, x, dv, c.half / c.load * (carried_effort + pulling - behind))


@kernel
def _drag(p: Mechanics, c: Coefficients, v: float, mobility: float) -> float:
    """Mean viscous friction (N m | N) over half a step of a body, `mobility`: its share of it over its inertia."""
    damping = viscous(p, c, v)
    return damping * v * effects.relaxed(damping * c.half * mobility)


@kernel
def _recoiled(c: Coefficients, x: Bodies, dv: float, dv_load: float) -> Bodies:
    """Both kicks, and the base's; the kicks of the bodies are those that they would have on the ground."""
    mass_ratio, stiffness, damping = c.base
    if mass_ratio == 0.0:
        return Bodies(x.position, x.velocity + dv, x.load, x.load_velocity + dv_load, x.base, x.base_velocity)
    share = c.load / (c.motor + c.load)
    recoil = -mass_ratio * (dv + share * (dv_load - dv)) - c.half * (stiffness * x.base + damping * x.base_velocity)
    velocity, load_velocity = x.velocity + dv - recoil, x.load_velocity + dv_load - recoil
    return Bodies(x.position, velocity, x.load, load_velocity, x.base, x.base_velocity + recoil)


@kernel
def moved(c: Coefficients, x: Bodies) -> Bodies:
    """A whole step of position."""
    h = 2.0 * c.half
    position = x.position + h * x.velocity
    load = x.load + h * x.load_velocity if c.load > 0.0 else position
    return Bodies(position, x.velocity, load, x.load_velocity, x.base + h * x.base_velocity, x.base_velocity)


@kernel
def pulled(p: Mechanics, position: float, element: float) -> float:
    """Effort against the motion of cable and gravity; `element`: with how much of its force it drags, in [-1, 1]."""
    cable = p.cable.stiffness * (position - p.cable.centre) + p.cable.hysteresis * element
    return cable + effects.wave(p.gravity, effects.TURN / p.pitch * position)
