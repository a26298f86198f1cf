"""The plant at rest, who carries what; and the plant as it moves on.

Friction carries what acts on an axis at rest, less what a command does: that with which a brake was released.  What is
more than friction can carry, a current does: of a loop that has stood there.
"""

from __future__ import annotations

import math
from typing import Any

from stagectl.kernels import (
    drive_effects,
    effects,
    friction,
    friction_bristle,
    friction_effects,
    plant_with_effects,
    transmission,
)
from stagectl.kernels.constants import LOAD_STEPS, READING_STEPS
from stagectl.kernels.jit import kernel, states
from stagectl.kernels.plant import Contact, Friction, Line, Mechanics, Memory, Motor, Stage, State
from stagectl.kernels.transmission import Bodies

_NEVER: Line = (-math.inf,) * 8  # no command has begun


@kernel
def standing(p: Stage, stops: Any, at_load: Any, position: float, time: float, held: float) -> State:
    """The plant at rest at `position` (rad | m): see `stage.at_rest`.

    The operators of motor and load, `stops` and `at_load` (n,), change in place.
    """
    behind, current = position, drive_effects.limited(p.drive, held, p.drive.current_limit, 0.0)
    for _ in range(LOAD_STEPS):
        driving, pulling = efforts(p, position, (time, current), behind)
        load = driving + pulling
        friction.relax(stops)
        share, factor = _limits(p, position, time, driving, load)
        beyond = _beyond(p.friction, load, share, factor)
        bristle = friction_bristle.settled(p.friction.bristle, load - beyond, share)
        carried = p.friction.bristle.stiffness * bristle
        force = friction.settled(p.friction.operators, stops, load - beyond - carried, factor) + carried
        constant = plant_with_effects.motoring(p.motor, effects.TURN / p.mechanics.pitch * position).constant
        behind = _load_at(p, position, driving - beyond, force)
        if beyond != 0.0:
            current = min(max(current - beyond / constant, -p.drive.current_limit), p.drive.current_limit)
            held = drive_effects.called_for(p.drive, current - p.drive.offset)
    memory = Memory(
        time, _NEVER, -math.inf, current, 0.0, behind, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, position, position, 0.0, 0.0,
        Contact(force, bristle, 0.0, 0.0), at_load,
    )  # fmt: skip
    for j in range(len(stops)):
        at_load[j] = stops[j]
    seen = plant_with_effects.seen(p.encoder, p.mechanics.pitch, position)
    here: Line = (seen, seen, seen, seen, seen, seen, seen, seen)
    commands: Line = (held, held, held, held, held, held, held, held)
    return State(commands, here, current, position, 0.0, force, stops, bristle, memory)


def copied(x: State) -> State:
    """`x` with operators of its own, for kernels that change them in place."""
    stops, at_load = states(len(x.stops)), states(len(x.memory.stops))
    stops[:], at_load[:] = x.stops, x.memory.stops
    return x._replace(stops=stops, memory=x.memory._replace(stops=at_load))


@kernel
def carrying(p: Stage, position: float) -> float:
    """Command (A) that carries all that acts on an axis at rest at `position` (rad | m): friction has nothing to do."""
    behind, current = position, p.drive.offset
    for _ in range(LOAD_STEPS):
        driving, pulling = efforts(p, position, (0.0, current), behind)
        constant = plant_with_effects.motoring(p.motor, effects.TURN / p.mechanics.pitch * position).constant
        behind = _load_at(p, position, 0.0 - pulling, 0.0)
        current = min(max(current - (driving + pulling) / constant, -p.drive.current_limit), p.drive.current_limit)
    return drive_effects.called_for(p.drive, current - p.drive.offset)


def in_motion(p: Stage, x: State, velocity: float, current: float, dt: float) -> State:
    """`x` at rest, but moving on at `velocity` (rad/s | m/s) through the place that the encoder reads; `dt`: period, s.

    The motor has had its `current` (A) for a while, and all friction slips in that direction, as past its rolling zone.
    """
    side = math.copysign(1.0, velocity)
    slipping = side * friction.stribeck(p.friction.stribeck, velocity)
    position = x.position + velocity * p.encoder.delay_samples * dt
    for j in range(len(x.stops)):
        x.stops[j] = x.memory.stops[j] = slipping
    bristle = side * friction_bristle.slipping(p.friction.bristle, velocity)
    places = (position - age * velocity * dt for age in range(8))
    a, b, c, d, e, f, g, h = (plant_with_effects.seen(p.encoder, p.mechanics.pitch, place) for place in places)
    commands: Line = (current, current, current, current, current, current, current, current)
    force = slipping * sum(p.friction.operators.weight) + p.friction.bristle.stiffness * bristle
    memory = x.memory._replace(
        load=x.memory.load + position - x.position,
        load_velocity=velocity,
        before=current,
        lagged=velocity,
        behind=Contact(force, bristle, velocity, 0.0),
    )
    return State(commands, (a, b, c, d, e, f, g, h), current, position, velocity, force, x.stops, bristle, memory)


def weight(p: Mechanics) -> float:
    """The most that pulls an axis the same way over half a turn and more (N m | N): bias, and what turns with it."""
    return abs(p.bias) + abs(p.gravity.amplitude)


def load(p: Mechanics, motor: Motor, travel: tuple[float, float]) -> float:
    """The most that acts on an axis at rest within its `travel` (rad | m), without friction (N m | N)."""
    waves, cable = (motor.cogging, motor.cogging_second, motor.cogging_third, motor.cogging_fourth), p.cable
    stretched = max(abs(place - cable.centre) for place in travel)
    return weight(p) + sum(abs(wave.amplitude) for wave in waves) + cable.stiffness * stretched + cable.hysteresis


def read(p: Stage, measured: float) -> float:
    """Position (rad | m) that the encoder shows as `measured`; its errors are small compared with their periods."""
    position = measured
    for _ in range(READING_STEPS):
        off = measured - plant_with_effects.seen(p.encoder, p.mechanics.pitch, position)
        if off == 0.0:
            break
        position += off
    return position


@kernel
def efforts(p: Stage, position: float, now: tuple[float, float], behind: float) -> tuple[float, float]:
    """Efforts on motor and load (N m | N) of an axis at rest, its load `behind` (rad | m), before any friction.

    `now` is the session clock (s) and the motor current (A).
    """
    bodies = Bodies(position, 0.0, position, 0.0, 0.0, 0.0)
    motor = plant_with_effects.motoring(p.motor, effects.TURN / p.mechanics.pitch * position)
    path = plant_with_effects.Path(0.0, position, position, 0.0)
    against = transmission.pulled(p.mechanics, behind, 0.0)
    if p.residual.coordinate != effects.NONE:
        place = plant_with_effects.coordinate(p.residual.coordinate, p.mechanics.pitch, bodies, path, (now[1], now[0]))
        against += effects.looked_up(p.residual, place)
    return motor.constant * now[1] + motor.cogging, p.mechanics.bias - against


@kernel
def _limits(p: Stage, position: float, time: float, driving: float, load: float) -> tuple[float, float]:
    """What slips at rest, as factors on bristle (without its own Stribeck) and operators."""
    held = friction_effects.held(p.friction, 1.0)
    angle = effects.TURN / p.mechanics.pitch * position
    place = effects.drifting(p.friction.warming, p.friction.step, time) * friction_effects.place_factor(
        p.friction.along, p.friction.lead, p.friction.lead_second, p.friction.ball_pass, (position, angle)
    )
    pressed = p.friction.load * abs(driving) / held.coulomb if held.coulomb > 0.0 else 0.0
    side = 1.0 + math.copysign(p.friction.asymmetry, p.friction.asymmetry * load)
    rise = friction.stribeck(p.friction.stribeck, 0.0)
    return max(place + pressed, 0.0) * side, max(place * rise + pressed, 0.0) * side


@kernel
def _beyond(p: Friction, load: float, share: float, factor: float) -> float:
    """What friction does not carry of a `load` (N m | N): at rest a current does."""
    most = friction_bristle.holding(p.bristle, share)
    for j in range(len(p.operators.weight)):
        most += p.operators.weight[j] * factor
    return load - min(max(load, -most), most)


@kernel
def _load_at(p: Stage, position: float, driving: float, force: float) -> float:
    """Position of the load behind spring and gap, which carry the motor's effort less its friction."""
    c = transmission.coefficients(p.mechanics, 0.0, 1.0)
    through = driving - (1.0 - c.share) * force
    if c.load == 0.0 or through == 0.0:
        return position
    return position - through / c.spring - math.copysign(c.gap, through)
