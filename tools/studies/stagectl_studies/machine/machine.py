"""What the machine is made of; the defaults are neutral, each effect vanishes bit for bit with them.

SI units, motor side.  Positive current drives in the positive direction; friction is positive at positive speed.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MAXWELL, DAHL, BRISTLE = 0, 1, 2
NO_ALIEN, BUMP, CUBIC_HYSTERESIS, INERTIA_SWING, ACTIVITY_FRICTION, STICKY_ZONE, MAGNETIC_SATURATION = range(7)


class Law(NamedTuple):
    """Memory of the rolling contact, normalised to 1 when it slips.

    Maxwell: sum_j w_j z_j, each z_j a spring of slip length 1/inverse_slip that slides at 1.  Dahl (1968):
    dz/dx = (1 - z sgn dx)^n / length.  Bristle (Dupont et al. 2002, elasto-plastic):
    dz/dx = (1 - a(z) z sgn dx)/length, a = 0 below `breakaway`; breakaway 0 is LuGre.
    """

    kind: int = MAXWELL
    weights: Floats = np.ones(1)  # (j,), sum 1
    inverse_slip: Floats = np.ones(1)  # (j,) 1/rad, falling: the longest element is the last
    length: float = 1.0  # rad
    exponent: float = 1.0
    breakaway: float = 0.0
    bristle_damping: float = 0.0  # N m s/rad, fades with speed
    bristle_speed: float = 1.0  # rad/s


class Body(NamedTuple):
    """Rigid motion: J a = torque - D v - friction."""

    inertia: float = 0.010  # kg m^2
    viscous: float = 0.14  # N m s/rad
    coulomb: float = 1.0  # N m
    bias: float = 0.0  # N m, gravity; positive drives in the positive direction


class Speed(NamedTuple):
    """Friction over speed, load and direction."""

    limits: bool = False  # True: the level bounds each element; False: it scales the whole contact
    asymmetry: float = 0.0
    viscous_asymmetry: float = 0.0
    viscous_blend: float = 1.0  # rad/s over which the two viscosities join
    curvature: float = 0.0  # share of the viscous torque at top_speed
    curvature_exponent: float = 2.0
    top_speed: float = 42.0  # rad/s
    stribeck: float = 0.0  # share of Coulomb
    stribeck_speed: float = 1.0  # rad/s
    stribeck_exponent: float = 1.0
    stribeck_rational: bool = False
    lag: float = 0.0  # s
    load: float = 0.0  # N m of friction per N m of motor torque
    load_exponent: float = 1.0


class Place(NamedTuple):
    """Friction over position, as shares of Coulomb."""

    tilt: float = 0.0
    bow: float = 0.0
    cubic: float = 0.0
    half_stroke: float = 31.4  # rad
    lead: float = 0.0
    lead_phase: float = 0.0
    lead_second: float = 0.0
    lead_second_phase: float = 0.0
    ball: float = 0.0
    ball_order: float = 1.0
    ball_phase: float = 0.0
    ball_drift: float = 0.0  # rad of phase
    ball_drift_length: float = 1.0  # rad of travel


class Ageing(NamedTuple):
    """Contact that grows while it rests and is wiped by slip: (1 + age/time)^power - 1 over power, or its logarithm."""

    gain: float = 0.0
    time: float = 0.1  # s
    power: float = 0.0
    wipe: float = 1e-3  # rad of slip
    play: float = 2e-4  # rad that move without slip


class Warmth(NamedTuple):
    """Drift over the session's clock, and one step in it."""

    coulomb_fast: float = 0.0
    coulomb_slow: float = 0.0
    viscous_fast: float = 0.0
    viscous_slow: float = 0.0
    fast: float = 60.0  # s
    slow: float = 600.0  # s
    step_coulomb: float = 0.0
    step_viscous: float = 0.0
    step_time: float = 1e9  # s
    step_rise: float = 0.0  # s


class Forces(NamedTuple):
    """Torques over position alone, and the cable's own memory."""

    cogging: float = 0.0  # N m
    cogging_order: float = 1.0
    cogging_phase: float = 0.0
    cogging_second: float = 0.0
    cogging_second_phase: float = 0.0
    cable: float = 0.0  # N m/rad
    cable_cubic: float = 0.0  # N m/rad^3
    cable_centre: float = 0.0  # rad
    loop: float = 0.0  # N m
    loop_length: float = 1.0  # rad
    loop_exponent: float = 1.0
    loop_second: float = 0.0  # N m
    loop_second_length: float = 1.0  # rad


class Motor(NamedTuple):
    """Torque of a current: Kt i (1 + ripple)."""

    force_constant: float = 0.72
    pole_pairs: float = 4.0
    ripple: float = 0.0  # sixth electrical harmonic
    ripple_phase: float = 0.0
    ripple_first: float = 0.0
    ripple_first_phase: float = 0.0
    ripple_second: float = 0.0
    ripple_second_phase: float = 0.0


class Coupling(NamedTuple):
    """A load behind a spring, a gap, or both; a second one behind the first."""

    share: float = 0.0  # of the inertia
    stiffness: float = 0.0  # N m/rad
    slope: float = 0.0  # share of the stiffness over half a stroke
    damping: float = 0.0  # N m s/rad
    gap: float = 0.0  # rad in all
    friction: float = 0.0  # share of friction at the load
    second_share: float = 0.0
    second_stiffness: float = 0.0
    second_damping: float = 0.0


class Base(NamedTuple):
    """Two modes of the machine's base that the reaction torque excites."""

    ratio: float = 0.0
    frequency: float = 100.0  # rad/s
    damping: float = 0.02
    second_ratio: float = 0.0
    second_frequency: float = 200.0
    second_damping: float = 0.02


class Drive(NamedTuple):
    """Bus, current loop and what the drive reports."""

    delay: float = 0.0005  # s from the sample to the instant the command acts
    jitter: float = 0.0  # s, mean of what comes on top
    lag: float = 0.000159  # s
    loop_damping: float = 0.0  # 0: first order
    loop_frequency: float = 6283.0  # rad/s, of the second order
    quantum: float = 0.0  # A
    limit: float = 1e9  # A
    fold_limit: float = 1e9  # A, after the fold-back
    fold_heat: float = 1.0  # A^2 s
    voltage: float = 1e9  # V
    resistance: float = 1.1  # ohm
    back_emf: float = 0.48  # V s/rad
    offset: float = 0.0  # A that flow besides the command
    reported_offset: float = 0.0  # A
    reported_gain: float = 1.0
    reported_quantum: float = 0.0  # A
    reported_shift: float = 0.0  # s, positive: the record holds a later current
    noise: float = 0.01  # A rms that flow
    sensor_noise: float = 0.045  # A rms in the record only


class Encoder(NamedTuple):
    """What is measured of the motor's position."""

    step: float = 5.99211e-06  # rad
    noise: float = 2e-6  # rad rms
    eccentricity: float = 0.0  # rad
    eccentricity_phase: float = 0.0
    eccentricity_second: float = 0.0
    eccentricity_second_phase: float = 0.0
    interpolation: float = 0.0  # rad
    interpolation_phase: float = 0.0
    interpolation_second: float = 0.0
    interpolation_second_phase: float = 0.0
    periods: float = 2048.0


class Alien(NamedTuple):
    """An effect that stands on no list."""

    kind: int = NO_ALIEN
    size: float = 0.0
    place: float = 0.0
    width: float = 1.0


class Machine(NamedTuple):
    """All of it."""

    law: Law
    body: Body = Body()
    speed: Speed = Speed()
    place: Place = Place()
    ageing: Ageing = Ageing()
    warmth: Warmth = Warmth()
    forces: Forces = Forces()
    motor: Motor = Motor()
    coupling: Coupling = Coupling()
    base: Base = Base()
    drive: Drive = Drive()
    encoder: Encoder = Encoder()
    alien: Alien = Alien()


class Motion(NamedTuple):
    """Positions and speeds: motor, load, second load, two modes of the base."""

    x: float
    v: float
    load: float
    load_speed: float
    second: float
    second_speed: float
    base: float
    base_speed: float
    base_second: float
    base_second_speed: float
