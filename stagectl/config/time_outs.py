"""Time-outs between controller and drive: where the stage file states none, they follow from a free distance.

The free distance is how far the axis may go beyond either end of its travel.  Within the travel the loop's own braking
limit leaves room for a stop at once; what a time-out costs on top of it must fit beside the travel.
"""

import math
from collections.abc import Iterator

from stagectl.config.friction_laws import friction_of
from stagectl.config.stage_blocks import StageFile
from stagectl.drives import limits
from stagectl.drives.drive import Canopen
from stagectl.drives.run_on import AxisLimits, RunOn
from stagectl.kernels.equilibrium import weight
from stagectl.kernels.stage import sliding
from stagectl.problem import Problem, ProblemKind

_ROUNDING = 1e-9


def axis_limits(file: StageFile, waits_for_sync: bool = False) -> AxisLimits:
    """What a drive's own limits must agree with; friction helps no stop but that of a coasting axis."""
    inertia = file.mechanics.inertia
    effort, pull = file.drive.current_limit * file.motor.force_constant, weight(file.mechanics)
    acceleration = (effort + pull) / inertia
    brakes = min(file.own_ramp, max(effort - pull, 0.0) / inertia)
    coasts = max(sliding(friction_of(file.friction)) - pull, 0.0) / inertia
    speed = file.limits.speed
    stops = RunOn(speed, acceleration, brakes), RunOn(speed, acceleration, coasts)
    return AxisLimits(file.drive.current_limit, speed, file.axis.travel, *stops, waits_for_sync)


def free_distance(file: StageFile) -> float:
    """As stated; else the smaller of a share of the travel and the axis' own braking distance (rad | m)."""
    if file.limits.free_distance is not None:
        return file.limits.free_distance
    low, high = file.limits.travel
    return min(limits.FREE_SHARE * (high - low), axis_limits(file).braking.distance(0.0))


def with_time_outs(file: StageFile) -> StageFile:
    """The file with each time-out of its CANopen wire that it does not state."""
    wire = file.drive.wire
    if not isinstance(wire, Canopen):
        return file
    if math.isnan(wire.rpdo_timeout):
        file = file.with_wire(rpdo_timeout=_derived(file))
    if math.isnan(wire.feedback_timeout):
        file = file.with_wire(feedback_timeout=limits.ANSWER_PERIODS * file.control.period)
    return file


def too_far(file: StageFile) -> Iterator[Problem]:
    """Time-outs that cost more than a free distance which the file states."""
    wire, free = file.drive.wire, file.limits.free_distance
    if free is None or not isinstance(wire, Canopen):
        return
    axis, timeout = axis_limits(file), noticed_after(wire)
    cost = axis.braking.cost(timeout)
    if cost > free * (1.0 + _ROUNDING):
        way, room = map(axis.travel.length, (cost, free))
        reason = f"a time-out of {timeout * 1e3:g} ms costs {way} at the largest current"
        remedy = "state a shorter drive.wire.rpdo_timeout, less drive.current_limit or limits.speed, or make more room"
        yield Problem(reason, ProblemKind.CONFLICT, "limits.free_distance", room, axis.travel.unit, remedy=remedy)


def noticed_after(wire: Canopen) -> float:
    """Silence (s) after which a drive that takes all time-outs of `wire` notices the loss of its controller."""
    return min(wire.rpdo_timeout or math.inf, wire.heartbeat_timeout)


def _derived(file: StageFile) -> float:
    """In whole milliseconds, as the drive counts; never shorter than what bus and computer keep."""
    wanted = min(axis_limits(file).braking.longest(free_distance(file)), limits.LONGEST_TIMEOUT)
    shortest = max(limits.TIMEOUT_PERIODS * file.control.period, limits.SHORTEST_TIMEOUT)
    return max(math.floor(wanted * 1e3), math.ceil(shortest * 1e3)) * 1e-3
