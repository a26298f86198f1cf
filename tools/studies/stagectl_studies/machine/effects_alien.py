"""Effects that stand on no list: a diagnosis must answer "unknown"."""

from stagectl_studies.machine.effects import ALIENS, Draw, Rig, effect
from stagectl_studies.machine.machine import (
    ACTIVITY_FRICTION,
    BUMP,
    CUBIC_HYSTERESIS,
    INERTIA_SWING,
    MAGNETIC_SATURATION,
    STICKY_ZONE,
    Alien,
)


def with_alien(rig: Rig, alien: Alien) -> Rig:
    """Rig with an alien effect."""
    return rig._replace(machine=rig.machine._replace(alien=alien))


def somewhere(draw: Draw) -> float:
    """A position that the session passes, rad."""
    return draw.around.half_stroke * draw.uniform(-0.25, 0.25)


@effect("bump", "torque", ALIENS)
def bump(rig: Rig, draw: Draw) -> Rig:
    """A torque at one position, the same both ways: a dent under a seal."""
    return with_alien(rig, Alien(BUMP, draw.sign * 0.1 * draw.scale, somewhere(draw), draw.uniform(0.2, 1.5)))


@effect("cubic_hysteresis", "torque", ALIENS)
def cubic_hysteresis(rig: Rig, draw: Draw) -> Rig:
    """A torque of the third power of a speed that follows the true one with play."""
    peak = draw.around.peak_speed
    return with_alien(rig, Alien(CUBIC_HYSTERESIS, 0.4 * draw.scale, peak, peak * draw.uniform(0.05, 0.2)))


@effect("inertia_swing", "torque", ALIENS)
def inertia_swing(rig: Rig, draw: Draw) -> Rig:
    """Inertia that changes over position, as a linkage makes it."""
    size = min(0.08 * draw.scale, 0.5)
    return with_alien(rig, Alien(INERTIA_SWING, size, draw.phase(), draw.uniform(0.5, 4.0)))


@effect("activity_friction", "torque", ALIENS)
def activity_friction(rig: Rig, draw: Draw) -> Rig:
    """Friction that grows with the path of the last seconds."""
    size = draw.sign * min(0.1 * draw.scale, 0.6)
    return with_alien(rig, Alien(ACTIVITY_FRICTION, size, 0.3 * draw.around.peak_speed, draw.uniform(0.5, 4.0)))


@effect("sticky_zone", "torque", ALIENS)
def sticky_zone(rig: Rig, draw: Draw) -> Rig:
    """More friction in one short zone."""
    return with_alien(rig, Alien(STICKY_ZONE, 0.15 * draw.scale, somewhere(draw), draw.uniform(0.3, 1.5)))


@effect("magnetic_saturation", "torque", ALIENS)
def magnetic_saturation(rig: Rig, draw: Draw) -> Rig:
    """The torque constant falls with current."""
    return with_alien(rig, Alien(MAGNETIC_SATURATION, 0.08 * draw.scale, draw.around.peak_current))
