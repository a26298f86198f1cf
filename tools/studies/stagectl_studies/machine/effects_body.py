"""Effects of mass, motor, structure, cable and guide."""

import math

from stagectl_studies.machine.effects import Draw, Rig, effect, factor
from stagectl_studies.machine.effects_friction import with_body
from stagectl_studies.machine.machine import Base, Coupling, Forces

MICROMETRE = 2.0 * math.pi / 12000.0  # rad, with 12 mm a revolution


def with_forces(rig: Rig, **changes: float) -> Rig:
    """Rig with other torques over position."""
    forces: Forces = rig.machine.forces._replace(**changes)
    return rig._replace(machine=rig.machine._replace(forces=forces))


@effect("inertia", "torque")
def inertia(rig: Rig, draw: Draw) -> Rig:
    """Inertia off by 10 %."""
    return with_body(rig, inertia=rig.machine.body.inertia * factor(draw, 0.1))


@effect("force_constant", "torque")
def force_constant(rig: Rig, draw: Draw) -> Rig:
    """Torque constant off by 5 %."""
    motor = rig.machine.motor
    motor = motor._replace(force_constant=motor.force_constant * factor(draw, 0.05))
    return rig._replace(machine=rig.machine._replace(motor=motor))


@effect("bias", "torque")
def bias(rig: Rig, draw: Draw) -> Rig:
    """A constant torque of 0.08 N m."""
    return with_body(rig, bias=draw.sign * 0.08 * draw.scale)


@effect("cogging", "torque")
def cogging(rig: Rig, draw: Draw) -> Rig:
    """Cogging of 15 mN m at 2 to 12 periods a revolution, with a second harmonic."""
    size = 0.015 * draw.scale
    return with_forces(
        rig,
        cogging=size,
        cogging_order=float(draw.random.choice([2, 4, 6, 8, 10, 12])),
        cogging_phase=draw.phase(),
        cogging_second=size * draw.uniform(0.0, 0.5),
        cogging_second_phase=draw.phase(),
    )


@effect("current_ripple", "torque")
def current_ripple(rig: Rig, draw: Draw) -> Rig:
    """The torque constant ripples by 1.2 % at the sixth electrical harmonic, and at the first and second."""
    size = 0.012 * draw.scale
    motor = rig.machine.motor._replace(
        pole_pairs=float(draw.random.integers(3, 6)),
        ripple=size,
        ripple_phase=draw.phase(),
        ripple_first=size * draw.uniform(0.0, 0.6),
        ripple_first_phase=draw.phase(),
        ripple_second=size * draw.uniform(0.0, 0.6),
        ripple_second_phase=draw.phase(),
    )
    return rig._replace(machine=rig.machine._replace(motor=motor))


@effect("cable_spring", "torque")
def cable_spring(rig: Rig, draw: Draw) -> Rig:
    """A cable that pulls back with 5 mN m/rad, stiffer towards the ends."""
    size, half = 0.005 * draw.scale, draw.around.half_stroke
    cubic = size * draw.uniform(0.0, 0.5) / (half * half)
    return with_forces(rig, cable=size, cable_cubic=cubic, cable_centre=half * draw.uniform(-0.5, 0.5))


@effect("cable_hysteresis", "torque")
def cable_hysteresis(rig: Rig, draw: Draw) -> Rig:
    """Dragged cables: 0.06 N m with memory over millimetres, two parts."""
    size, share = 0.06 * draw.scale, draw.uniform(0.3, 1.0)
    length = draw.decades(1000.0, 8000.0) * MICROMETRE
    return with_forces(
        rig,
        loop=size * share,
        loop_length=length / 2.0,
        loop_exponent=draw.uniform(0.6, 1.6),
        loop_second=size * (1.0 - share),
        loop_second_length=length * draw.uniform(0.8, 2.0),
    )


def spring_of(rig: Rig, share: float, frequency: float) -> float:
    """Stiffness that gives a resonance between motor and load, N m/rad."""
    w = 2.0 * math.pi * frequency
    return rig.machine.body.inertia * share * (1.0 - share) * w * w


@effect("backlash", "torque")
def backlash(rig: Rig, draw: Draw) -> Rig:
    """4 micrometres between motor and load; the contact has its own stiffness and damping, the load its friction."""
    old = rig.machine.coupling
    share = old.share or draw.uniform(0.15, 0.4)
    stiffness = old.stiffness or spring_of(rig, share, draw.uniform(400.0, 1000.0))
    damping = draw.uniform(0.03, 0.15) * 2.0 * math.sqrt(stiffness * rig.machine.body.inertia * share * (1.0 - share))
    coupling = old._replace(
        share=share,
        stiffness=stiffness,
        damping=damping,
        gap=4.0 * MICROMETRE * draw.scale,
        friction=draw.uniform(0.25, 0.6),
    )
    return rig._replace(machine=rig.machine._replace(coupling=coupling))


@effect("compliance", "torque")
def compliance(rig: Rig, draw: Draw) -> Rig:
    """A load behind a spring, 250 Hz; the spring may change over the stroke, a second mode may follow."""
    old = rig.machine.coupling
    share = old.share or draw.uniform(0.15, 0.45)
    frequency = draw.uniform(220.0, 320.0) / math.sqrt(draw.scale)
    stiffness = spring_of(rig, share, frequency)
    inertia = rig.machine.body.inertia
    zeta = draw.uniform(0.01, 0.05)
    second = draw.uniform(0.03, 0.1) if draw.random.random() < 0.3 else 0.0
    above = (2.0 * math.pi * frequency * draw.uniform(2.0, 3.0)) ** 2
    coupling = Coupling(
        share,
        stiffness,
        draw.uniform(-0.3, 0.3) if draw.random.random() < 0.5 else 0.0,
        2.0 * zeta * math.sqrt(stiffness * inertia * share * (1.0 - share)),
        old.gap,
        old.friction or (draw.uniform(0.05, 0.5) if draw.random.random() < 0.6 else 0.0),
        second,
        second * inertia * above,
        second * inertia * 2.0 * zeta * math.sqrt(above),
    )
    return rig._replace(machine=rig.machine._replace(coupling=coupling))


@effect("base_vibration", "torque")
def base_vibration(rig: Rig, draw: Draw) -> Rig:
    """The base rings at 8 to 60 Hz with a mass ratio of 0.04, in one mode or two."""
    first = draw.decades(8.0, 60.0)
    ratio = 0.04 * draw.scale
    other = ratio * draw.uniform(0.1, 0.6) if draw.random.random() < 0.5 else 0.0
    base = Base(
        ratio,
        2.0 * math.pi * first,
        draw.uniform(0.01, 0.05),
        other,
        2.0 * math.pi * first * draw.uniform(1.4, 3.0),
        draw.uniform(0.01, 0.05),
    )
    return rig._replace(machine=rig.machine._replace(base=base))
