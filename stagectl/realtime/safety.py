"""When the loop stops by itself.  Nothing raises inside the cycle: a cycle returns a status, and this decides.

::

    what the drive says ----> its own fault first
    position ---------------> encoder: older than it may be, jumped, frozen
    error over the speed ---> following error, ramping with the reference's speed, for a time
    position and speed -----> travel, speed, room to brake before the end of the travel
    current ----------------> peak, and I2t:  tau dT/dt = i^2 - T  <=  continuous_current^2
    current and command ----> another current than commanded; an answer that repeats while the command changes

This is not a safety function: the emergency stop is wired to the drive's STO.  What follows from each fault stands in
`stops`; the limits come from the stage file by `envelope.envelope`.
"""

import math
from typing import NamedTuple

from stagectl.drives.canopen.cia402 import LIMITED
from stagectl.drives.drive import Fault, Feedback
from stagectl.realtime.stops import STOPS

INF = math.inf
_NONE = Fault.NONE


class Envelope(NamedTuple):
    """What the loop accepts, in axis units; what stands behind the first five is off by default."""

    low: float  # rad | m
    high: float
    speed: float  # rad/s | m/s
    following_error: float  # rad | m, at standstill
    late_limit: int  # late cycles in a row
    error_ramp: float = 0.0  # s, following error that is added for each unit of speed
    error_time: float = 0.0  # s that it may be beyond; twice the limit is never waited for
    deceleration: float = INF  # rad/s^2 | m/s^2, with which the axis can be braked
    jump: float = INF  # rad | m beyond what the speed explains
    acceleration: float = INF  # rad/s^2 | m/s^2, the most that any force can give
    freeze: float = INF  # rad | m, way of the reference in which the position must change
    breakaway: float = INF  # A, under which the axis must move
    freeze_time: float = INF  # s that it may stand under it
    current: float = INF  # A, peak
    current_time: float = 0.0  # s that it may be beyond
    continuous_current: float = INF  # A
    thermal_time: float = 1.0  # s
    current_floor: float = INF  # A, by which the measured current may differ from the command, and
    current_share: float = 0.0  # of the command beside it
    current_settling: float = 1.0  # s in which the drive follows its command
    unfollowed_time: float = INF  # s that it may give another current
    frozen: float = INF  # A of the command that the measured current must show
    frozen_time: float = INF  # s that position and current may repeat meanwhile


class Watch(NamedTuple):
    """Memory of the judge; NaN is what has not been seen yet."""

    position: float = math.nan  # rad | m
    speed: float = 0.0  # rad/s | m/s
    reference: float = math.nan  # rad | m
    beyond: float = 0.0  # s that the following error has been too large
    idle: float = 0.0  # rad | m, way of the reference since the position last changed
    stuck: float = 0.0  # s under breakaway current without a change of position
    excess: float = 0.0  # s that the current has been too large
    heat: float = 0.0  # A^2, of the thermal model
    current: float = math.nan  # A, as measured
    highest: float = 0.0  # A, bounds of what the drive may give after the commands so far
    lowest: float = 0.0
    unfollowed: float = 0.0  # s that it has given another current, less those in which it did not
    frozen: float = 0.0  # s that position and current repeat while the command is another
    anchor: float = 0.0  # A, command when they began to repeat


class Observation(NamedTuple):
    """One period, as the judge needs it."""

    feedback: Feedback
    reference: float  # rad | m
    error: float  # rad | m
    command: float  # A, that acts
    time: float  # s since the last one


FRESH = Watch()


def words(fault: Fault) -> str:
    """The reason as a person says it."""
    return STOPS[fault].words if fault in STOPS else ""


def judge(p: Envelope, x: Watch, now: Observation) -> tuple[Fault, Watch]:
    """The drive's own fault first, then encoder, tracking, place and load."""
    feedback, reference, _, _, dt = now
    speed = abs(reference - x.reference) / dt  # NaN where it is not known yet: then the limit at standstill counts
    limit = p.following_error + p.error_ramp * speed if speed == speed else p.following_error
    new = watched(p, x, now, limit)
    fault = feedback.fault
    if fault is _NONE:
        fault = _sensed(p, x, new, now, limit) or _placed(p, new)
    return fault, new


def watched(p: Envelope, x: Watch, now: Observation, limit: float) -> Watch:
    """The memory after this period, whose following error may be `limit` (rad | m)."""
    feedback, reference, error, command, dt = now
    position, current, *_ = feedback
    before, _, from_, beyond, idle, stuck, excess, heat, last, highest, lowest, unfollowed, frozen, anchor = x
    same, share, release = position == before, dt / p.thermal_time, dt / p.current_settling
    # What is measured now flowed under the commands before this one, which begins to act: however long that took.
    margin = p.current_floor + p.current_share * max(highest, -lowest)
    if current > highest + margin or current < lowest - margin:
        unfollowed += dt
    elif unfollowed:
        unfollowed = max(unfollowed - dt, 0.0)
    # Bounds that jump out with the command and come back with the settling time: a loop that follows stays within.
    highest = command if command >= highest or release >= 1.0 else highest + (command - highest) * release
    lowest = command if command <= lowest or release >= 1.0 else lowest + (command - lowest) * release
    if not (same and current == last and current):
        frozen, anchor = 0.0, command
    else:
        frozen = frozen + dt if abs(command - anchor) > p.frozen else 0.0
    last = current
    if current != current:  # the drive reports none: the command takes its place
        current = command
    return Watch(
        position,
        0.0 if before != before else (position - before) / dt,
        reference,
        0.0 if abs(error) <= limit else beyond + dt,  # NaN is beyond
        idle + abs(reference - from_) if same else 0.0,
        stuck + dt if same and abs(command) > p.breakaway else 0.0,
        excess + dt if abs(current) > p.current else 0.0,
        heat + (current * current - heat) * (share if share < 1.0 else 1.0),
        last,
        highest,
        lowest,
        unfollowed,
        frozen,
        anchor,
    )


def cooled(p: Envelope, x: Watch, current: float, dt: float) -> Watch:
    """The memory after a period in which our law did not act: the motor warms up and cools down all the same."""
    heating = current * current if current == current else 0.0
    return x._replace(heat=x.heat + (heating - x.heat) * min(dt / p.thermal_time, 1.0))


def overloaded(p: Envelope, heat: float) -> Fault:
    """I2t, with the `heat` (A^2) of the motor."""
    return Fault.OVERLOAD if heat > p.continuous_current * p.continuous_current else _NONE


def jumped(p: Envelope, x: Watch, position: float, dt: float) -> bool:
    """Whether the position is farther away than speed, force and a cycle's uncertainty of time explain."""
    before, speed = x.position, x.speed
    explained = p.jump + abs(speed) * dt + p.acceleration * dt * dt
    return before == before and not abs(position - before - speed * dt) <= explained


def _sensed(p: Envelope, before: Watch, x: Watch, now: Observation, limit: float) -> Fault:
    """Encoder, and tracking with a following error of `limit` (rad | m)."""
    if jumped(p, before, x.position, now.time):
        return Fault.JUMP
    if x.idle > p.freeze or x.stuck > p.freeze_time or x.frozen > p.frozen_time:
        return Fault.FREEZE
    if x.unfollowed > p.unfollowed_time:
        return Fault.CLAMPED
    if x.beyond != 0.0 and (x.beyond > p.error_time or not abs(now.error) <= 2.0 * limit):
        return Fault.FOLLOWING_ERROR
    return _NONE


def _placed(p: Envelope, x: Watch) -> Fault:
    """Place, speed, room to brake; then load."""
    position, speed = x.position, x.speed
    if not p.low <= position <= p.high:
        return Fault.TRAVEL
    if not -p.speed <= speed <= p.speed:
        return Fault.SPEED
    room = (p.high - position if speed > 0.0 else position - p.low) + p.following_error
    if speed * speed > 2.0 * p.deceleration * room:
        return Fault.BRAKING
    if x.excess > p.current_time:
        return Fault.CURRENT
    return overloaded(p, x.heat)


def searching(p: Envelope) -> Envelope:
    """A search is made without a home, and may be held by an end stop."""
    return unhomed(p)._replace(freeze=INF, breakaway=INF)


def unhomed(p: Envelope) -> Envelope:
    """An axis without a home does not know where its travel ends; until it has one it only stands, or searches."""
    return p._replace(low=-INF, high=INF, deceleration=INF)


def containing(p: Envelope, position: float) -> Envelope:
    """The travel with a `position` (rad | m) beside it, from where the axis may come back, and not go further."""
    return p._replace(low=min(p.low, position - p.following_error), high=max(p.high, position + p.following_error))


def detail(fault: Fault, x: Watch, now: Observation) -> str:
    """What the judge saw, in numbers, of a fault whose words name none; empty for the others."""
    seen, command, words = now.feedback, now.command, ""
    if fault is Fault.CLAMPED or (fault is Fault.FREEZE and x.unfollowed > 0.0):
        limited = "; it reports an internal limit (statusword bit 11)" if seen.statusword & LIMITED else ""
        words = f"The drive delivers {seen.current:.3g} A where {command:.3g} A was commanded{limited}. "
    if fault is Fault.FREEZE and x.frozen > 0.0:
        words += (
            f"Position and current repeat to the last bit for {x.frozen * 1e3:.0f} ms while the command went from"
            f" {x.anchor:.3g} A to {command:.3g} A: the answer is frozen, or the axis stands under a fixed current. "
        )
    if fault is Fault.FOLLOWING_ERROR and _runs_away(x, now):
        words += (
            f"The axis moves away from its reference, against the {command:.3g} A that are commanded: the sign of motor"
            " or encoder is reversed (two phases exchanged, 0x607E), or a load is stronger than the motor. "
        )
    return words


def _runs_away(x: Watch, now: Observation) -> bool:
    """Whether the axis goes against its command and away from the reference, for more than a period."""
    lasts = abs(now.error) > 2.0 * abs(x.speed) * now.time  # a jump makes all of the error in one
    return lasts and x.speed * now.command < 0.0 and x.speed * now.error < 0.0


def leap(p: Envelope, moved: float, time: float) -> Fault:
    """Whether an axis that no law holds yet was `moved` (rad | m) further in `time` (s) than any motion goes."""
    return Fault.JUMP if abs(moved) > p.jump + p.speed * time else Fault.NONE
