"""Torques and accelerations of motor, load and base, and the explicit midpoint step."""

import math

from stagectl_studies.machine.contact import contact
from stagectl_studies.machine.jit import compiled
from stagectl_studies.machine.machine import INERTIA_SWING, MAGNETIC_SATURATION, Floats, Machine, Motion


@compiled
def generated(p: Machine, x: float, current: float) -> float:
    """Torque of the motor, N m."""
    m = p.motor
    factor = 1.0
    if m.ripple != 0.0:
        angle = m.pole_pairs * x
        factor += m.ripple * math.sin(6.0 * angle + m.ripple_phase)
        factor += m.ripple_first * math.sin(angle + m.ripple_first_phase)
        factor += m.ripple_second * math.sin(2.0 * angle + m.ripple_second_phase)
    if p.alien.kind == MAGNETIC_SATURATION:
        ratio = current / p.alien.place
        factor /= 1.0 + p.alien.size * ratio * ratio
    return m.force_constant * current * factor


@compiled
def positional(p: Machine, x: float) -> float:
    """Torque over position alone, and gravity; positive drives, N m."""
    f = p.forces
    torque = p.body.bias
    if f.cogging != 0.0:
        torque += f.cogging * math.sin(f.cogging_order * x + f.cogging_phase)
        torque += f.cogging_second * math.sin(2.0 * f.cogging_order * x + f.cogging_second_phase)
    if f.cable != 0.0:
        u = x - f.cable_centre
        torque -= f.cable * u + f.cable_cubic * u * u * u
    return torque


@compiled
def spring(p: Machine, m: Motion) -> float:
    """Torque that the motor hands on to the load; none inside the gap, N m."""
    c = p.coupling
    twist, rate = m.x - m.load, m.v - m.load_speed
    half = 0.5 * c.gap
    if abs(twist) <= half and c.gap > 0.0:
        return 0.0
    depth = twist - half if twist > 0.0 else twist + half
    torque = c.stiffness * (1.0 + c.slope * m.x / p.place.half_stroke) * depth + c.damping * rate
    if c.gap > 0.0 and torque * depth < 0.0:
        return 0.0  # a contact can push and not pull
    return torque


@compiled
def swing(p: Machine, x: float) -> tuple[float, float]:
    """Inertia at a position and its slope."""
    inertia = p.body.inertia * (1.0 - p.coupling.share - p.coupling.second_share)
    if p.alien.kind != INERTIA_SWING:
        return inertia, 0.0
    angle = x / p.alien.width + p.alien.place
    return inertia * (1.0 + p.alien.size * math.sin(angle)), inertia * p.alien.size / p.alien.width * math.cos(angle)


@compiled
def derivative(p: Machine, m: Motion, current: float, friction: tuple[float, float]) -> Motion:
    """Rate of change of the motion, under the opposing torques `friction` on motor and load.

    Motor and load move relative to the base, which takes the reaction: a_base = -mu T/J - 2 zeta w q' - w^2 q.
    """
    inertia, slope = swing(p, m.x)
    outer = generated(p, m.x, current) + positional(p, m.x) - friction[0]
    motor = outer - 0.5 * slope * m.v * m.v
    load = second = 0.0
    c = p.coupling
    if c.share > 0.0:
        handed = spring(p, m)
        motor -= handed
        load = handed - friction[1]
        if c.second_share > 0.0:
            further = c.second_stiffness * (m.load - m.second) + c.second_damping * (m.load_speed - m.second_speed)
            load -= further
            second = further / (p.body.inertia * c.second_share)
        load /= p.body.inertia * c.share
    first = other = 0.0
    b = p.base
    if b.ratio > 0.0:
        reaction = (outer - friction[1]) / p.body.inertia
        first = -b.ratio * reaction - b.frequency * (2.0 * b.damping * m.base_speed + b.frequency * m.base)
        w = b.second_frequency
        other = -b.second_ratio * reaction - w * (2.0 * b.second_damping * m.base_second_speed + w * m.base_second)
    ground = first + other
    return Motion(
        m.v, motor / inertia - ground, m.load_speed, load - ground if c.share > 0.0 else 0.0,
        m.second_speed, second - ground if c.second_share > 0.0 else 0.0,
        m.base_speed, first, m.base_second_speed, other,
    )  # fmt: skip


@compiled
def shifted(m: Motion, d: Motion, h: float) -> Motion:
    """Motion after `h` seconds at the rate `d`."""
    return Motion(
        m.x + h * d.x, m.v + h * d.v, m.load + h * d.load, m.load_speed + h * d.load_speed,
        m.second + h * d.second, m.second_speed + h * d.second_speed,
        m.base + h * d.base, m.base_speed + h * d.base_speed,
        m.base_second + h * d.base_second, m.base_second_speed + h * d.base_second_speed,
    )  # fmt: skip


@compiled
def midpoint(
    p: Machine, m: Motion, memory: tuple[Floats, Floats], friction: tuple[float, float],
    currents: tuple[float, float, float], clock: tuple[float, float],
) -> tuple[Motion, tuple[float, float]]:  # fmt: skip
    """One explicit midpoint step (Runge 1895), second order; `friction` at its start, returned at its end.

    `memory` is (state, scratch), `currents` at start, middle and end, `clock` (session time, step).
    """
    (mem, scratch), (t, h) = memory, clock
    half = shifted(m, derivative(p, m, currents[0], friction), 0.5 * h)
    effort = p.motor.force_constant * currents[1]
    inner = contact(p, mem, scratch, (m, half, 0.5 * h), effort, t + 0.5 * h)
    end = shifted(m, derivative(p, half, currents[1], inner), h)
    effort = p.motor.force_constant * currents[2]
    return end, contact(p, mem, mem, (m, end, h), effort, t + h)
