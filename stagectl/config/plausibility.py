"""What is admissible and yet a slip of the unit rather than a machine: warnings, by several entries together."""

from __future__ import annotations

import math

from stagectl.config.stage_blocks import StageFile
from stagectl.drives.drive import Canopen
from stagectl.number_format import length
from stagectl.units import ROTARY


def doubtful(file: StageFile) -> str:
    """What to say of a stage file whose entries are each admissible; empty where they fit together."""
    return stops_beyond(file) or never_reached(file)


def decelerations(file: StageFile) -> dict[str, float]:
    """What each of the entries that brake the axis allows (rad/s^2 | m/s^2); the least of them decides."""
    stated, bias = file.limits.deceleration, abs(file.mechanics.bias)
    effort = max(file.drive.current_limit * file.motor.force_constant - bias, 0.0)
    ramp = "drive.wire.quick_stop_deceleration" if isinstance(file.drive.wire, Canopen) else "limits.acceleration"
    return {
        **({} if stated is None else {"limits.deceleration": stated}),
        ramp: file.own_ramp,
        "mechanics.inertia, motor.force_constant, drive.current_limit": effort / file.mechanics.inertia,
    }


def stops_beyond(file: StageFile) -> str:
    """What to say of an axis that cannot be stopped within its travel; empty where it can.

    Such an entry is a slip of the unit rather than a machine; where each way to brake is too weak, it is the speed.
    """
    (low, high), half, every = file.limits.travel, 0.5 * file.limits.speed**2, decelerations(file)
    weak = {entry: most for entry, most in every.items() if most * (high - low) < half}
    if not weak:
        return ""
    scale, unit, least = file.axis.travel_per_unit, file.axis.travel_unit, min(weak.values())
    way = half / least if least > 0.0 else math.inf
    needed, room = (length(distance * scale, unit) for distance in (way, high - low))
    named = (
        entry if "," in entry else f"{entry} = {length(most * scale, f'{unit}/s^2')}" for entry, most in weak.items()
    )
    suspects = f"the unit of {', '.join(named)}" if len(weak) < len(every) else "limits.speed and limits.travel"
    return f"from limits.speed the axis stops within {needed}, and limits.travel is {room}: check {suspects}"


def never_reached(file: StageFile) -> str:
    """What to say of a travel too short for limits.speed: to accelerate and to brake needs more; empty elsewhere."""
    limits, axis = file.limits, file.axis
    needed, room = limits.speed**2 / limits.acceleration, limits.travel[1] - limits.travel[0]
    if needed <= room:
        return ""
    speed = length(limits.speed * axis.travel_per_unit, f"{axis.travel_unit}/s")
    way, travel = (length(each * axis.travel_per_unit, axis.travel_unit) for each in (needed, room))
    bare = "; a number without a unit is rad at the motor" if axis.kind == ROTARY and axis.lead else ""
    return (
        f"limits.speed = {speed} is never reached: to accelerate and to brake takes {way}, and limits.travel is "
        f"{travel}: check their units{bare}"
    )
