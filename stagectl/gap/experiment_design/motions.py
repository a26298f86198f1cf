"""The motions that experiments are made of, scaled to a stage: each starts and ends at the initial position."""

import math
from collections.abc import Sequence as Many
from typing import NamedTuple

from stagectl.gap.experiment_design import thresholds
from stagectl.gap.experiment_design.stage_scale import (
    StageScale,
    largest_acceleration,
    largest_amplitude,
    largest_speed,
    rounded,
)
from stagectl.gap.experiment_design.thresholds import GENTLE
from stagectl.trajectories import CurrentMultisine, Dwell, Excited, Sequence, Sine, Sum, Trajectory, Trapezoid


def preconditioned(p: StageScale, *parts: Trajectory) -> Sequence:
    """One reversal beyond presliding before `parts`: friction then begins in a state that is known."""
    acceleration = min(
        4.0 * p.short / (thresholds.PRECONDITIONING_TIME * thresholds.PRECONDITIONING_TIME),
        largest_acceleration(p, thresholds.FIRM),
    )
    return Sequence((move(p.short, largest_speed(p, GENTLE), acceleration), *parts))


def move(
    distance: float, velocity: float, acceleration: float, dwell: float = thresholds.REST, one_way: bool = False
) -> Trapezoid:
    """There and back, or one way, in figures that a person reads."""
    return Trapezoid(rounded(distance), rounded(velocity), rounded(acceleration), dwell, 1, one_way)


def sine(p: StageScale, amplitude: float, frequency: float, periods: float = 3.0) -> Sine:
    """A sine of `amplitude` (m), or of what firm use of the machine allows."""
    largest = largest_amplitude(p, thresholds.FIRM, frequency)
    return Sine(rounded(min(amplitude, largest)), rounded(frequency), periods, 1.0)


def at_speed(p: StageScale, speed: float, frequency: float, periods: float = 3.0) -> Sine:
    """A sine of this peak speed (m/s), where reach and current allow it."""
    return sine(p, min(speed / (2.0 * math.pi * frequency), GENTLE * p.reach), frequency, periods)


def strong(p: StageScale, share: float, frequency: float, periods: float = 4.0) -> Sine:
    """A sine that needs this share of the largest current, or of the first limit that it meets."""
    return Sine(rounded(largest_amplitude(p, share, frequency)), rounded(frequency), periods, 2.0)


def ramp(p: StageScale, speed: float) -> float:
    """Acceleration (m/s^2) to `speed` (m/s): in a tenth of a second, or as the current beyond friction allows."""
    return min(speed / 0.1, GENTLE * p.acceleration, largest_acceleration(heavier(p), 0.95, speed))


def heavier(p: StageScale) -> StageScale:
    """The same stage with a quarter more of all that resists: a battery must not fault on the gap that it looks for."""
    return p._replace(
        inertia=thresholds.RESERVE * p.inertia,
        viscous=thresholds.RESERVE * p.viscous,
        resisting=thresholds.RESERVE * p.resisting,
    )


def top_speed(p: StageScale) -> float:
    """Largest of the stairs (m/s): 4/15 of the limit, 65 % of the current, and a quarter of a second at it."""
    fastest = min(4.0 / 15.0 * p.speed, largest_speed(p, 0.65))
    a, way = ramp(p, fastest), thresholds.LONGEST_MOVE * p.span
    by_way = 0.5 * a * (math.sqrt(0.0625 + 4.0 * way / a) - 0.25)
    return rounded(min(fastest, by_way))


def logarithmic(low: float, high: float, count: int) -> list[float]:
    """`count` values at equal ratios, both ends among them."""
    return [rounded(low * (high / low) ** (k / (count - 1))) for k in range(count)]


def transit(p: StageScale) -> tuple[float, float]:
    """Speed (m/s) and acceleration (m/s^2) of getting somewhere."""
    fast = largest_speed(p, 0.5)
    return fast, largest_acceleration(p, 0.62, fast)


def stairs(p: StageScale, speeds: Many[float], hold: float) -> tuple[Trapezoid, ...]:
    """There and back at each of `speeds` (m/s), held for `hold` (s) where the travel is long enough."""
    start = move(0.9 * p.low, *transit(p), one_way=True)
    steps = tuple(there_and_back(p, speed, hold, thresholds.LONGEST_MOVE * p.span) for speed in speeds)
    return start, *steps, start._replace(distance=-start.distance)


def there_and_back(p: StageScale, speed: float, hold: float, longest: float) -> Trapezoid:
    """At `speed` (m/s) for `hold` (s), within `longest` (m): over whole pitches where it comes to at least one."""
    acceleration = ramp(p, speed)
    way = min(speed * hold + speed * speed / acceleration, longest)
    pitches = math.floor(way / p.pitch)
    return move(pitches * p.pitch if pitches else way, speed, acceleration)


def scan(p: StageScale, time: float, ends: float = 0.05) -> tuple[Trapezoid, ...]:
    """The stroke up and down in `time` (s) each way, but for a share of it at both `ends`."""
    low, high = rounded(p.low * (1.0 - ends)), rounded(p.high * (1.0 - ends))
    slow = min((high - low) / time, largest_speed(p, thresholds.FIRM))
    fast, a = transit(p)
    way = rounded(high - low)
    return (
        move(low, fast, a, one_way=True),
        move(way, slow, a),
        move(-low, fast, a, one_way=True),
    )


def micro(p: StageScale, ratio: float, steps: float, frequency: float = 2.0, periods: float = 3.0) -> Sine:
    """A sine of `ratio` times the presliding length, and of at least `steps` encoder counts."""
    return sine(p, max(ratio * p.presliding, steps * p.encoder_step), frequency, periods)


def steps(p: StageScale, distance: float, dwells: Many[float], share: float = 0.4) -> tuple[Trapezoid, ...]:
    """There and back by `distance` (m), as sharply as this share of the current allows, after each of `dwells` (s)."""
    shortest = max(thresholds.SHORTEST_STEP, thresholds.FEWEST_PERIODS * p.dt)
    a = min(largest_acceleration(p, share), 4.0 * distance / (shortest * shortest))
    return tuple(move(distance, largest_speed(p, GENTLE), a, dwell) for dwell in dwells)


class CarriedMultisine(NamedTuple):
    """Where in the stroke, and with which lines and phases, a multisine of current is injected."""

    place: float  # of the stroke, 0 at its low end and 1 at its high one: where the carrier starts
    seed: int  # of the phases
    current: float = 0.1  # of the largest
    low: float = 3.0  # Hz
    high: float = 500.0  # Hz, or a quarter of the sampling frequency
    periods: float = 2.0


def carried(p: StageScale, injection: CarriedMultisine) -> Excited:
    """An odd random-phase multisine of current, on a carrier of constant speed that keeps friction slipping."""
    current = CurrentMultisine(
        rounded(injection.current * p.current_limit),
        injection.low,
        rounded(min(injection.high, 0.25 / p.dt)),
        1.0,
        injection.periods,
        0.25,
        injection.seed,
    )
    way = rounded(thresholds.CARRIER_WAY * p.span)
    start = rounded(p.low + injection.place * p.span)
    fast, a = transit(p)
    speed = way / (current.duration + 2.0 * thresholds.CARRIER_SETTLE)
    before = preconditioned(p, *([move(start, fast, a, one_way=True)] if start else [Dwell(thresholds.REST)]))
    carrier = move(way, speed, a, one_way=True)
    back = carrier._replace(distance=-rounded(start + way, 6), velocity=rounded(fast), acceleration=rounded(a))
    begin = before.duration + carrier.velocity / carrier.acceleration + thresholds.CARRIER_SETTLE
    return Excited(Sequence((*before.parts, carrier, back)), current, rounded(begin, 4))


def wavering(p: StageScale, speed: float, share: float, frequency: float, periods: float) -> tuple[Trajectory, ...]:
    """One way at ``speed + share speed cos(2 pi f t)``, never turning round, and back."""
    swing = Sine(rounded(share * speed / (2.0 * math.pi * frequency)), rounded(frequency), periods, 1.0)
    a = ramp(p, speed)
    start = rounded(speed / a + 0.1)
    way = min(speed * (swing.duration + 2.0 * start), 0.8 * p.high)
    carrier = move(way, speed, a, one_way=True)
    return Sum((carrier, Sequence((Dwell(start), swing)))), move(-way, speed, a, one_way=True)


def equal_speed_sines(p: StageScale) -> tuple[Trajectory, ...]:
    """The same peak speed at frequencies a decade apart, as the current allows it at the higher one."""
    fast = at_speed(p, p.speed / 6.0, 5.0, 10.0)
    speed = 5.0 * fast.amplitude
    return Sine(rounded(min(speed / 0.5, 0.8 * p.reach)), 0.5, 2.0), fast


def speeds(p: StageScale, low: float, high: float, count: int, hold: float) -> tuple[Trajectory, ...]:
    """Speeds from `low` to `high` of the top one, both ways."""
    top = top_speed(p)
    return stairs(p, logarithmic(low * top, high * top, count), hold)


def creep(p: StageScale) -> tuple[Trajectory, ...]:
    """Slow enough that each count is seen, far enough to leave presliding."""
    way = 8.0 * p.presliding
    return (move(way, way / 4.0, ramp(p, way / 4.0)),)


def constant(p: StageScale, *shares: float) -> tuple[Trajectory, ...]:
    """Most of the stroke at constant speed, there and back at each of these `shares` of the top speed."""
    start = move(0.9 * p.low, *transit(p), one_way=True)
    speeds = [share * top_speed(p) for share in shares]
    passes = tuple(move(0.9 * p.span, speed, ramp(p, speed)) for speed in speeds)
    return start, *passes, start._replace(distance=-start.distance)


def two_loads(p: StageScale) -> tuple[Trajectory, ...]:
    """A few pitches at little current, then the same ones while accelerating hard."""
    way = min(3.0 * p.pitch, 0.6 * p.high)
    gentle = move(way, min(way / 4.0, largest_speed(p, GENTLE)), largest_acceleration(p, 0.1))
    hard = move(way, largest_speed(p, 0.6), largest_acceleration(p, 0.7, largest_speed(p, 0.4)))
    return gentle, hard, hard, hard


def accelerations(p: StageScale) -> tuple[Trajectory, ...]:
    """One speed, reached at accelerations of a decade."""
    speed, top = 0.5 * top_speed(p), largest_acceleration(p, 0.7, 0.5 * top_speed(p))
    way = min(0.4 * p.high, 2.0 * speed * speed / (0.1 * top))
    return tuple(move(way, speed, share * top) for share in (1.0, 0.3, 0.1, 1.0, 0.3, 0.1))


def strokes(p: StageScale) -> tuple[Trajectory, ...]:
    """Three strokes of the millimetre range at one speed."""
    speed = 0.1 * top_speed(p)
    a = ramp(p, speed)
    strokes = (0.3 * p.short, p.short, 5.0 * p.short)
    return tuple(move(min(way, 0.8 * p.high), speed, a) for way in strokes for _ in range(2))


def swings(p: StageScale, speed: float, *frequencies: float) -> tuple[Trajectory, ...]:
    """One way at a speed that swings, and back, at each frequency in turn."""
    way = speed * top_speed(p)
    return tuple(part for f in frequencies for part in wavering(p, way, 0.6, f, 4.0))


def sizes(p: StageScale, *ratios: float) -> tuple[Trajectory, ...]:
    """Micro-sines, the largest first: each starts from the friction that the one before has left."""
    return Dwell(0.1), *(micro(p, ratio, 20.0) for ratio in ratios)


def places(p: StageScale) -> tuple[Trajectory, ...]:
    """Rest at seven places along the stroke, reached from below and from above."""
    speed, a = transit(p)
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
    stroke = there_and_back(p, 0.6 * top_speed(p), 0.8, 0.8 * p.high)
    return (stroke._replace(cycles=max(1, round(seconds / stroke.duration))),)


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
