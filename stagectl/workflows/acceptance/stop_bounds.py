"""Within which distance an axis must stand: the worst that the stage file allows, for the speed of the test."""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.config.time_outs import axis_limits
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.pdo import EVENT_TIMER
from stagectl.workflows.acceptance.drive_reader import DriveReader
from stagectl.workflows.acceptance.limits import LATENESS, SETTLING_SHARE, STOP_PERIODS

_QUICK_STOP, _FAULT, _COASTS = 3, 1, 0  # options of 0x6007; option of 0x605E
_MILLISECONDS = 1e-3


class Protection(NamedTuple):
    """What the drive itself holds against the loss of its controller, as it was read."""

    supervisors: dict[str, float]  # s, by name; only those that are on
    reaction: int | None  # 0x6007
    fault_reaction: int | None  # 0x605E

    @property
    def timeout(self) -> float:
        """Silence (s) after which the first supervisor acts; inf: none does."""
        return min(self.supervisors.values(), default=math.inf)

    @property
    def brakes(self) -> bool:
        """By its ramp; False: it cuts the power and the axis coasts."""
        by_fault = self.reaction == _FAULT and self.fault_reaction not in (None, _COASTS)
        return self.reaction == _QUICK_STOP or by_fault


UNREAD = Protection({}, None, None)


def read_protection(drive: DriveReader, controller: int) -> Protection:
    """Supervisors that watch the node `controller`, and the reaction.  Raises DriveError."""
    consumed = drive.number(cia402.CONSUMER_HEARTBEAT, 1) or 0
    guarded = (drive.number(cia402.GUARD_TIME) or 0) * (drive.number(cia402.LIFE_TIME_FACTOR) or 0)
    times = {
        "RPDO time-out (0x1400:05)": drive.number(cia402.RPDO_PARAMETER, EVENT_TIMER) or 0,
        "heartbeat of the controller (0x1016:01)": consumed & 0xFFFF if consumed >> 16 & 0x7F == controller else 0,
        "life guarding (0x100C, 0x100D)": guarded,
    }
    return Protection(
        {name: value * _MILLISECONDS for name, value in times.items() if value},
        drive.number(cia402.ABORT_CONNECTION, signed=True),
        drive.number(cia402.FAULT_REACTION, signed=True),
    )


def lost_controller_bound(setup: Setup, protection: Protection, speed: float, current: float) -> float:
    """Distance (rad | m) after the controller's death at `speed`, the drive holding `current` (A) until it notices."""
    time = LATENESS * protection.timeout + STOP_PERIODS * setup.dt
    return _bound(setup, (speed, current, time), protection.brakes)


def quick_stop_bound(setup: Setup, speed: float, current: float) -> float:
    """Distance (rad | m) of a stop that the loop asks for at `speed` under `current` (A)."""
    return _bound(setup, (speed, current, STOP_PERIODS * setup.dt), True)


def _bound(setup: Setup, left: tuple[float, float, float], brakes: bool) -> float:
    """Run-on from a speed under a current for a time, see `drives.run_on`; and what the axis settles by."""
    speed, current, time = abs(left[0]), abs(left[1]), left[2]
    limits, mechanics = axis_limits(setup.file), setup.stage.mechanics
    effort = current * setup.stage.motor.force_constant + abs(mechanics.bias)
    worst = limits.braking if brakes else limits.coasting
    run_on = worst._replace(speed=speed, acceleration=effort / mechanics.inertia)
    return run_on.distance(time) + SETTLING_SHARE * setup.file.limits.following_error
