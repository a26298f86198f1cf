"""Effects of friction."""

from typing import Any

from stagectl_studies.machine.effects import Draw, Rig, effect, factor
from stagectl_studies.machine.machine import Ageing, Place, Warmth


def with_body(rig: Rig, **changes: float) -> Rig:
    """Rig with other values of the rigid body."""
    return rig._replace(machine=rig.machine._replace(body=rig.machine.body._replace(**changes)))


def with_speed(rig: Rig, **changes: float | bool) -> Rig:
    """Rig with other friction over speed."""
    speed: Any = rig.machine.speed
    return rig._replace(machine=rig.machine._replace(speed=speed._replace(**changes)))


def with_place(rig: Rig, **changes: float) -> Rig:
    """Rig with other friction over position."""
    place: Place = rig.machine.place._replace(**changes)
    return rig._replace(machine=rig.machine._replace(place=place))


def with_warmth(rig: Rig, **changes: float) -> Rig:
    """Rig with another drift."""
    warmth: Warmth = rig.machine.warmth._replace(**changes)
    return rig._replace(machine=rig.machine._replace(warmth=warmth))


@effect("viscous", "torque")
def viscous(rig: Rig, draw: Draw) -> Rig:
    """Viscous friction off by 20 %."""
    return with_body(rig, viscous=rig.machine.body.viscous * factor(draw, 0.2))


@effect("coulomb", "torque")
def coulomb(rig: Rig, draw: Draw) -> Rig:
    """Coulomb friction off by 12 %."""
    return with_body(rig, coulomb=rig.machine.body.coulomb * factor(draw, 0.12))


@effect("viscous_nonlinear", "torque")
def viscous_nonlinear(rig: Rig, draw: Draw) -> Rig:
    """A power of speed, degressive or progressive; 20 % of the viscous torque at top speed."""
    exponent = draw.uniform(0.35, 0.65) if draw.random.random() < 0.5 else draw.uniform(1.6, 2.6)
    size = draw.sign * 0.2 * draw.scale
    return with_speed(rig, curvature=size, curvature_exponent=exponent, top_speed=draw.around.peak_speed)


@effect("coulomb_asymmetry", "torque")
def coulomb_asymmetry(rig: Rig, draw: Draw) -> Rig:
    """Direction changes Coulomb friction by 4 %."""
    return with_speed(rig, asymmetry=draw.sign * 0.04 * draw.scale)


@effect("viscous_asymmetry", "torque")
def viscous_asymmetry(rig: Rig, draw: Draw) -> Rig:
    """Direction changes viscous friction by 8 %, joined over a range of speed."""
    blend = draw.decades(0.05, 2.0)
    return with_speed(rig, viscous_asymmetry=draw.sign * 0.08 * draw.scale, viscous_blend=blend)


@effect("stribeck", "torque")
def stribeck(rig: Rig, draw: Draw) -> Rig:
    """Friction rises by 15 % towards zero speed, over any exponent or a rational law."""
    return with_speed(
        rig,
        stribeck=0.15 * draw.scale,
        stribeck_speed=draw.decades(0.3, 8.0),
        stribeck_exponent=draw.uniform(0.6, 2.2),
        stribeck_rational=bool(draw.random.random() < 0.3),
    )


@effect("friction_lag", "torque")
def friction_lag(rig: Rig, draw: Draw) -> Rig:
    """The Stribeck term follows speed with 5 ms; without such a term it does nothing."""
    return with_speed(rig, lag=0.005 * draw.scale)


@effect("load_friction", "torque")
def load_friction(rig: Rig, draw: Draw) -> Rig:
    """Friction grows with 3 % of the motor's torque, not quite in proportion."""
    return with_speed(rig, load=0.03 * draw.scale, load_exponent=draw.uniform(0.8, 1.25))


@effect("presliding", "torque")
def presliding(rig: Rig, draw: Draw) -> Rig:
    """The rolling zone is 40 % longer or shorter, its parts not all alike."""
    law = rig.machine.law
    ratio = factor(draw, 0.4)
    spread = draw.uniform(0.6, 1.4)
    rates = law.inverse_slip / law.inverse_slip.max()
    other = law.inverse_slip / ratio * rates ** (0.15 * draw.scale * (spread - 1.0))
    return rig._replace(machine=rig.machine._replace(law=law._replace(inverse_slip=other, length=law.length * ratio)))


@effect("dwell", "torque")
def dwell(rig: Rig, draw: Draw) -> Rig:
    """Friction grows with rest by 3 % per e-fold, logarithm or power of time, wiped by some micrometres of slip."""
    power = 0.0 if draw.random.random() < 0.5 else draw.uniform(0.05, 0.35)
    ageing = Ageing(
        0.03 * draw.scale, draw.decades(0.03, 0.3), power, draw.decades(1e-3, 6e-3), draw.decades(5e-5, 3e-4)
    )
    return rig._replace(machine=rig.machine._replace(ageing=ageing))


@effect("position_friction", "torque")
def position_friction(rig: Rig, draw: Draw) -> Rig:
    """Friction changes by 12 % over the stroke: slope, bow, third order, or a mixture."""
    mix = draw.random.dirichlet([0.6, 0.6, 0.2]) * draw.random.choice([-1.0, 1.0], 3)
    tilt, bow, cubic = (float(value) * 0.12 * draw.scale for value in mix)
    return with_place(rig, tilt=tilt, bow=1.5 * bow, cubic=cubic, half_stroke=draw.around.half_stroke)


@effect("lead_friction", "torque")
def lead_friction(rig: Rig, draw: Draw) -> Rig:
    """Friction changes by 5 % within a revolution, with a second harmonic."""
    size = 0.05 * draw.scale
    second = size * draw.uniform(0.0, 0.5)
    return with_place(
        rig, lead=size, lead_phase=draw.phase(), lead_second=second, lead_second_phase=draw.phase()
    )  # fmt: skip


@effect("ball_pass_ripple", "torque")
def ball_pass_ripple(rig: Rig, draw: Draw) -> Rig:
    """Balls make 2.5 % of ripple at a non-integer order whose phase drifts."""
    return with_place(
        rig,
        ball=0.025 * draw.scale,
        ball_order=draw.uniform(2.2, 9.8),
        ball_phase=draw.phase(),
        ball_drift=draw.uniform(0.2, 1.5),
        ball_drift_length=draw.uniform(4.0, 15.0),
    )


def two_rates(draw: Draw, size: float) -> tuple[float, float, float, float]:
    """Shares and time constants of a warm-up: (fast, slow, fast seconds, slow seconds)."""
    share, session = draw.uniform(0.2, 0.8), draw.around.session
    return size * share, size * (1.0 - share), session * draw.uniform(0.08, 0.25), session * draw.uniform(0.5, 2.0)


@effect("thermal_viscous", "torque")
def thermal_viscous(rig: Rig, draw: Draw) -> Rig:
    """Cold grease: viscous friction 30 % higher at first, two time constants."""
    quick, slow, fast, late = two_rates(draw, 0.3 * draw.scale)
    return with_warmth(rig, viscous_fast=quick, viscous_slow=slow, fast=fast, slow=late)


@effect("thermal_coulomb", "torque")
def thermal_coulomb(rig: Rig, draw: Draw) -> Rig:
    """Preload changes with temperature: Coulomb friction 10 % off at first, two time constants."""
    quick, slow, fast, late = two_rates(draw, draw.sign * min(0.1 * draw.scale, 0.6))
    return with_warmth(rig, coulomb_fast=quick, coulomb_slow=slow, fast=fast, slow=late)


@effect("friction_step", "torque")
def friction_step(rig: Rig, draw: Draw) -> Rig:
    """At one moment of the session friction steps by 12 %: Coulomb, viscous or both, at once or over seconds."""
    size, kind = draw.sign * min(0.12 * draw.scale, 0.6), draw.random.integers(3)
    rise = 0.0 if draw.random.random() < 0.5 else draw.uniform(0.5, 5.0)
    return with_warmth(
        rig,
        step_coulomb=size if kind != 1 else 0.0,
        step_viscous=size * (1.0 if kind == 2 else 2.0) if kind != 0 else 0.0,
        step_time=draw.around.session * draw.uniform(0.25, 0.75),
        step_rise=rise,
    )
