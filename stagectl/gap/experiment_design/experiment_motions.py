"""The motions of the catalogue's experiments, beyond those of the battery."""

from __future__ import annotations

from collections.abc import Callable

from stagectl.gap.experiment_design import motions
from stagectl.gap.experiment_design.motions import logarithmic, micro, move
from stagectl.gap.experiment_design.stage_scale import StageScale, largest_acceleration, largest_speed, rounded
from stagectl.gap.experiment_design.thresholds import GENTLE
from stagectl.trajectories import Dwell, Sine, Trajectory


def equal_speed_sines(p: StageScale) -> tuple[Trajectory, ...]:
    """The same peak speed at frequencies a decade apart, as the current allows it at the higher one."""
    fast = motions.at_speed(p, p.speed / 6.0, 5.0, 10.0)
    speed = 5.0 * fast.amplitude
    return Sine(rounded(min(speed / 0.5, 0.8 * p.reach)), 0.5, 2.0), fast


def speeds(p: StageScale, low: float, high: float, count: int, hold: float) -> tuple[Trajectory, ...]:
    """Speeds from `low` to `high` of the top one, both ways."""
    top = motions.top_speed(p)
    return motions.stairs(p, logarithmic(low * top, high * top, count), hold)


def creep(p: StageScale) -> tuple[Trajectory, ...]:
    """Slow enough that each count is seen, far enough to leave presliding."""
    way = 8.0 * p.presliding
    return (move(way, way / 4.0, motions.ramp(p, way / 4.0)),)


def constant(p: StageScale, *shares: float) -> tuple[Trajectory, ...]:
    """Most of the stroke at constant speed, there and back at each of these `shares` of the top speed."""
    start = move(0.9 * p.low, *motions.transit(p), one_way=True)
    speeds = [share * motions.top_speed(p) for share in shares]
    passes = tuple(move(0.9 * p.span, speed, motions.ramp(p, speed)) for speed in speeds)
    return start, *passes, start._replace(distance=-start.distance)


def two_scans(p: StageScale) -> tuple[Trajectory, ...]:
    """The stroke both ways at two speeds."""
    return *motions.scan(p, 8.0), *motions.scan(p, 3.0)


def two_loads(p: StageScale) -> tuple[Trajectory, ...]:
    """A few pitches at little current, then the same ones while accelerating hard."""
    way = min(3.0 * p.pitch, 0.6 * p.high)
    gentle = move(way, min(way / 4.0, largest_speed(p, GENTLE)), largest_acceleration(p, 0.1))
    hard = move(way, largest_speed(p, 0.6), largest_acceleration(p, 0.7, largest_speed(p, 0.4)))
    return gentle, hard, hard, hard


def accelerations(p: StageScale) -> tuple[Trajectory, ...]:
    """One speed, reached at accelerations of a decade."""
    speed, top = 0.5 * motions.top_speed(p), largest_acceleration(p, 0.7, 0.5 * motions.top_speed(p))
    way = min(0.4 * p.high, 2.0 * speed * speed / (0.1 * top))
    return tuple(move(way, speed, share * top) for share in (1.0, 0.3, 0.1, 1.0, 0.3, 0.1))


def strokes(p: StageScale) -> tuple[Trajectory, ...]:
    """Three strokes of the millimetre range at one speed."""
    speed = 0.1 * motions.top_speed(p)
    a = motions.ramp(p, speed)
    strokes = (0.3 * p.short, p.short, 5.0 * p.short)
    return tuple(move(min(way, 0.8 * p.high), speed, a) for way in strokes for _ in range(2))


def swings(p: StageScale, speed: float, *frequencies: float) -> tuple[Trajectory, ...]:
    """One way at a speed that swings, and back, at each frequency in turn."""
    way = speed * motions.top_speed(p)
    return tuple(part for f in frequencies for part in motions.wavering(p, way, 0.6, f, 4.0))


def sizes(p: StageScale, *ratios: float) -> tuple[Trajectory, ...]:
    """Micro-sines, the largest first: each starts from the friction that the one before has left."""
    return Dwell(0.1), *(micro(p, ratio, 20.0) for ratio in ratios)


def places(p: StageScale) -> tuple[Trajectory, ...]:
    """Rest at seven places along the stroke, reached from below and from above."""
    speed, a = motions.transit(p)
    distance = rounded(0.15 * p.span)
    low = rounded(0.9 * p.low)
    climb = tuple(move(distance, speed, a, 0.5, one_way=True) for _ in range(6))
    descend = tuple(step._replace(distance=-step.distance) for step in climb)
    start = move(low, speed, a, 0.5, one_way=True)
    return start, *climb, *descend, start._replace(distance=-start.distance)


def settling(p: StageScale, share: float) -> tuple[Trajectory, ...]:
    """Stops from speed, sharper and sharper, and time to ring out."""
    way = min(10.0 * p.short, 0.5 * p.high)
    return tuple(move(way, largest_speed(p, GENTLE), largest_acceleration(p, share * k), 0.8) for k in (0.5, 0.75, 1.0))


def warm_up(p: StageScale, seconds: float) -> tuple[Trajectory, ...]:
    """Reversals at a brisk speed for `seconds`, as a machine at work makes them."""
    stroke = motions.there_and_back(p, 0.6 * motions.top_speed(p), 0.8, 0.8 * p.high)
    return (stroke._replace(cycles=max(1, round(seconds / stroke.duration))),)


def rest(seconds: float) -> Callable[[StageScale], tuple[Trajectory, ...]]:
    """Standing still for `seconds`, whatever the stage."""
    return lambda _: (Dwell(seconds),)


def fast_cruise(p: StageScale) -> tuple[Trajectory, ...]:
    """As fast as travel and current allow, twice there and back over most of the stroke."""
    start, _, back = constant(p, 1.0)
    speed = largest_speed(p, 0.8)
    hard = move(0.9 * p.span, speed, largest_acceleration(p, 0.9, speed))
    return start, hard, hard, back


def reversals(p: StageScale) -> tuple[Trajectory, ...]:
    """Turning round at rates a decade apart, beyond presliding each time."""
    top = largest_acceleration(p, 0.5)
    return tuple(move(p.short, largest_speed(p, GENTLE), share * top, 0.0) for share in (1.0, 0.1, 0.01) for _ in "12")
