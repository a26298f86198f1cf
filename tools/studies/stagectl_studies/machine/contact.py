"""Friction with memory: the contact's law, its level, and the torque that opposes the motion.

Memory is one array of floats.  The contact is a function of displacement, so each law is advanced exactly by the
displacement of a step; the step's own error is then that of the motion alone.
"""

import math

from stagectl_studies.machine.jit import compiled
from stagectl_studies.machine.machine import (
    ACTIVITY_FRICTION,
    BUMP,
    CUBIC_HYSTERESIS,
    DAHL,
    MAXWELL,
    STICKY_ZONE,
    Alien,
    Floats,
    Forces,
    Law,
    Machine,
    Motion,
)

ELEMENTS = 40
LOAD = ELEMENTS
AGE, ANCHOR, LAGGED, LOOP, LOOP_SECOND, ACTIVITY, CUBIC = range(2 * ELEMENTS, 2 * ELEMENTS + 7)
MEMORY = 2 * ELEMENTS + 8
SMALLEST_LEVEL = 0.05


@compiled
def dahl(z: float, travel: float, exponent: float, limit: float) -> float:
    """Force after `travel` (signed, in slip lengths): u = 1 - z sgn/limit falls as du/ds = -u^n/limit, exactly."""
    sign = 1.0 if travel > 0.0 else -1.0
    u = 1.0 - sign * z / limit
    if u <= 1e-12:
        return sign * limit
    path = abs(travel) / limit
    if exponent == 1.0:
        u *= math.exp(-path)
    else:
        q = u ** (1.0 - exponent) - (1.0 - exponent) * path
        u = q ** (1.0 / (1.0 - exponent)) if q > 0.0 else 0.0
    return sign * limit * (1.0 - u)


@compiled
def yielding(z: float, sign: float, breakaway: float, limit: float) -> float:
    """Share of plastic motion, 0 below breakaway, 1 at the limit, smooth between (Dupont et al. 2002, eq. 11)."""
    if breakaway <= 0.0:
        return 1.0
    if z * sign <= 0.0:
        return 0.0
    share = (abs(z) / limit - breakaway) / (1.0 - breakaway)
    if share <= 0.0:
        return 0.0
    return 1.0 if share >= 1.0 else 0.5 - 0.5 * math.cos(math.pi * share)


@compiled
def bristle(law: Law, z: float, travel: float, limit: float) -> float:
    """Deflection after `travel`, the plastic share taken half-way."""
    sign = 1.0 if travel > 0.0 else -1.0
    half = z + 0.5 * travel * (1.0 - yielding(z, sign, law.breakaway, limit) * sign * z / limit)
    rate = yielding(half, sign, law.breakaway, limit) / limit
    if rate * abs(travel) < 1e-9:
        after = z + travel
    else:
        after = sign / rate + (z - sign / rate) * math.exp(-rate * abs(travel))
    return min(max(after, -limit), limit)


@compiled
def bristle_rate(law: Law, z: float, v: float, limit: float) -> float:
    """Speed of the deflection, 1/s."""
    sign = 1.0 if v > 0.0 else -1.0
    return v / law.length * (1.0 - yielding(z, sign, law.breakaway, limit) * sign * z / limit)


@compiled
def slip(law: Law, mem: Floats, out: Floats, part: int, span: tuple[float, float, float]) -> float:
    """Normalised force after a displacement; `span` is (displacement, lowest, highest)."""
    dx, low, high = span
    if law.kind == MAXWELL:
        last = mem[part + law.weights.size - 1]  # the longest element slips last: then all of them do
        if dx >= 0.0 and high == 1.0 and last == 1.0:
            return 1.0
        if dx <= 0.0 and low == -1.0 and last == -1.0:
            return -1.0
        total = 0.0
        for j in range(law.weights.size):
            stretch = min(max(mem[part + j] + dx * law.inverse_slip[j], low), high)
            out[part + j] = stretch
            total += law.weights[j] * stretch
        return total
    z: float = mem[part]
    if dx != 0.0:
        limit = high if dx > 0.0 else -low
        travel = dx / law.length
        z = dahl(z, travel, law.exponent, limit) if law.kind == DAHL else bristle(law, z, travel, limit)
    out[part] = z
    return z


@compiled
def warming(p: Machine, t: float, viscous: bool) -> float:
    """Change of friction at session time `t`, as a share."""
    w = p.warmth
    fast, slow, step = (
        (w.viscous_fast, w.viscous_slow, w.step_viscous)
        if viscous
        else (w.coulomb_fast, w.coulomb_slow, w.step_coulomb)
    )
    total = 0.0
    if fast != 0.0 or slow != 0.0:
        total += fast * math.exp(-t / w.fast) + slow * math.exp(-t / w.slow)
    if step != 0.0 and t > w.step_time:
        total += step * (min((t - w.step_time) / w.step_rise, 1.0) if w.step_rise > 0.0 else 1.0)
    return total


@compiled
def over_position(p: Machine, x: float) -> float:
    """Change of the Coulomb level at a position, as a share."""
    place = p.place
    total = 0.0
    if place.tilt != 0.0 or place.bow != 0.0 or place.cubic != 0.0:
        u = x / place.half_stroke
        total += place.tilt * u + place.bow * (u * u - 1.0 / 3.0) + place.cubic * u * u * u
    if place.lead != 0.0:
        total += place.lead * math.sin(x + place.lead_phase)
        total += place.lead_second * math.sin(2.0 * x + place.lead_second_phase)
    if place.ball != 0.0:
        drift = place.ball_drift * math.sin(x / place.ball_drift_length)
        total += place.ball * math.sin(place.ball_order * x + place.ball_phase + drift)
    return total


@compiled
def stribeck(p: Machine, v: float) -> float:
    """Rise of the level at low speed, as a share."""
    s = p.speed
    ratio = (abs(v) / s.stribeck_speed) ** s.stribeck_exponent
    return s.stribeck / (1.0 + ratio) if s.stribeck_rational else s.stribeck * math.exp(-ratio)


@compiled
def aged(p: Machine, age: float) -> float:
    """Rise of the level after a dwell of `age` seconds, as a share."""
    a = p.ageing
    if a.power > 0.0:
        grown: float = (1.0 + age / a.time) ** a.power
        return a.gain * (grown - 1.0) / a.power
    return a.gain * math.log(1.0 + age / a.time)


@compiled
def foreign_level(alien: Alien, x: float, activity: float) -> float:
    """Change of the level by an effect on no list."""
    if alien.kind == ACTIVITY_FRICTION:
        return alien.size * activity / alien.place
    if alien.kind == STICKY_ZONE:
        u = (x - alien.place) / alien.width
        return alien.size / (1.0 + u * u * u * u)
    return 0.0


@compiled
def level(p: Machine, mem: Floats, end: Motion, effort: float, t: float) -> float:
    """Coulomb level as a share of the nominal one: 1 for a plain contact."""
    total = 1.0 + over_position(p, end.x) + warming(p, t, False)
    if p.speed.stribeck != 0.0:
        total += stribeck(p, mem[LAGGED] if p.speed.lag > 0.0 else end.v)
    if p.ageing.gain != 0.0:
        total += aged(p, mem[AGE])
    if p.speed.load != 0.0:
        total += p.speed.load * abs(effort) ** p.speed.load_exponent / p.body.coulomb
    total += foreign_level(p.alien, end.x, mem[ACTIVITY])
    return max(total, SMALLEST_LEVEL)


@compiled
def viscous_torque(p: Machine, v: float, t: float) -> float:
    """Torque over speed, without the contact."""
    s, d = p.speed, p.body.viscous
    torque = d * v * (1.0 + warming(p, t, True))
    if s.viscous_asymmetry != 0.0:
        torque += d * v * s.viscous_asymmetry * math.tanh(v / s.viscous_blend)
    if s.curvature != 0.0:
        size = s.curvature * d * s.top_speed * (abs(v) / s.top_speed) ** s.curvature_exponent
        torque += size if v > 0.0 else -size
    return torque


@compiled
def remember(p: Machine, mem: Floats, out: Floats, start: Motion, end: Motion, dt: float) -> None:
    """Advance what is not the contact itself: age, lagged speed, activity."""
    if p.ageing.gain != 0.0:
        anchor = min(max(mem[ANCHOR], end.x - p.ageing.play), end.x + p.ageing.play)
        out[AGE] = mem[AGE] * math.exp(-abs(anchor - mem[ANCHOR]) / p.ageing.wipe) + dt
        out[ANCHOR] = anchor
    if p.speed.lag > 0.0:
        out[LAGGED] = mem[LAGGED] + (0.5 * (start.v + end.v) - mem[LAGGED]) * (1.0 - math.exp(-dt / p.speed.lag))
    if p.alien.kind == ACTIVITY_FRICTION:
        out[ACTIVITY] = mem[ACTIVITY] + (abs(end.v) - mem[ACTIVITY]) * (1.0 - math.exp(-dt / p.alien.width))


@compiled
def cable_loop(f: Forces, mem: Floats, out: Floats, dx: float) -> float:
    """Torque of the dragged cable's memory."""
    first: float = mem[LOOP]
    second: float = mem[LOOP_SECOND]
    if dx != 0.0:
        first = dahl(first, dx / f.loop_length, f.loop_exponent, 1.0)
        second = dahl(second, dx / f.loop_second_length, f.loop_exponent, 1.0)
    out[LOOP], out[LOOP_SECOND] = first, second
    return f.loop * first + f.loop_second * second


@compiled
def foreign_torque(alien: Alien, mem: Floats, out: Floats, end: Motion) -> float:
    """Opposing torque of an effect on no list."""
    if alien.kind == BUMP:
        u = (end.x - alien.place) / alien.width
        return alien.size * math.exp(-u * u)
    if alien.kind == CUBIC_HYSTERESIS:
        held: float = min(max(mem[CUBIC], end.v - alien.width), end.v + alien.width)
        out[CUBIC] = held
        u = held / alien.place
        return alien.size * u * u * u
    return 0.0


@compiled
def body_friction(
    p: Machine, mem: Floats, out: Floats, part: int, move: tuple[float, float], state: tuple[float, float]
) -> float:
    """Opposing torque of one body, all friction on it; `move` (displacement, speed), `state` (level, time)."""
    (dx, v), (height, t) = move, state
    e = p.speed.asymmetry
    low, high = (-height * (1.0 - e), height * (1.0 + e)) if p.speed.limits else (-1.0, 1.0)
    z = slip(p.law, mem, out, part, (dx, low, high))
    contact = z if p.speed.limits else height * (z + e * z * z)
    torque = p.body.coulomb * contact + viscous_torque(p, v, t)
    if p.law.bristle_damping != 0.0:
        limit = high if v > 0.0 else -low
        fade = v / p.law.bristle_speed
        torque += p.law.bristle_damping * p.law.length * bristle_rate(p.law, z, v, limit) * math.exp(-fade * fade)
    return torque


@compiled
def contact(
    p: Machine, mem: Floats, out: Floats, span: tuple[Motion, Motion, float], effort: float, t: float
) -> tuple[float, float]:
    """Opposing torques on motor and load after the step `span` = (start, end, duration); `out` may be `mem`."""
    start, end, dt = span
    remember(p, mem, out, start, end, dt)
    height = level(p, out, end, effort, t)
    motor = body_friction(p, mem, out, 0, (end.x - start.x, end.v), (height, t))
    load = 0.0
    share = p.coupling.friction
    if share > 0.0:
        load = share * body_friction(p, mem, out, LOAD, (end.load - start.load, end.load_speed), (height, t))
        motor *= 1.0 - share
    if p.forces.loop != 0.0:
        motor += cable_loop(p.forces, mem, out, end.x - start.x)
    return motor + foreign_torque(p.alien, mem, out, end), load
