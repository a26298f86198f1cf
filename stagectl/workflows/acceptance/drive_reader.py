"""The drive without its loop: what it reports over SDO, and within which distance it must stand."""

import contextlib
import math
import time
from typing import NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.config.time_outs import axis_limits
from stagectl.drives.bus.frames import Bus, frame
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.object_access import PlainSdo
from stagectl.drives.canopen.pdo import EVENT_TIMER
from stagectl.drives.drive import Canopen, DriveError
from stagectl.kernels.equilibrium import weight
from stagectl.workflows.acceptance import limits

_OFF = cia402.DeviceCommand.DISABLE_VOLTAGE.controlword.to_bytes(2, "little")


class Stop(NamedTuple):
    """How an axis came to rest by itself."""

    stands: bool
    without_power: bool  # not in Operation enabled any more
    distance: float  # rad | m, the farthest from where it was left
    time: float  # s until it stood
    state: DriveState
    path: list[tuple[float, float]]  # s from the begin of the watch, and position (rad | m)


class DriveReader(PlainSdo):
    """Objects of one drive; `step` (rad | m) is one count of its position."""

    def __init__(self, wire: Canopen, bus: Bus, step: float) -> None:
        super().__init__(wire, bus)
        self._bus, self._step = bus, step

    def position(self) -> float:
        """Position (rad | m), as the drive counts.  Raises DriveError."""
        counts = self.number(cia402.POSITION, signed=True)
        if counts is None:
            raise DriveError(
                f"node {self.node}: object 0x6064 (position) cannot be read: the stop could not be measured",
                node=self.node,
                object_key=cia402.POSITION << 8,
            )
        return counts * self._step

    def state(self) -> DriveState:
        """State of the power drive system."""
        return cia402.state(self.number(cia402.STATUSWORD) or 0)

    def watch_stop(self, start: float, timeout: float, farthest: float) -> Stop:
        """Watch the axis, left at `start` (rad | m), come to rest within `timeout` (s) and `PATIENCE`.

        One that does not, or goes `farthest` (rad | m) from there, loses its power.
        """
        begun = time.monotonic()
        still, since, distance = self.position(), begun, 0.0
        path: list[tuple[float, float]] = []
        while True:
            here, state, now = self.position(), self.state(), time.monotonic()
            distance = max(distance, abs(here - start))
            path.append((now - begun, here))
            if abs(here - still) > limits.STILL_COUNTS * self._step:
                still, since = here, now
            stands, without = now - since > limits.STILL_TIME, state is not DriveState.OPERATION_ENABLED
            if stands and without:
                return Stop(True, True, distance, max(since - begun, 0.0), state, path)
            if now - begun > timeout + limits.PATIENCE or distance > farthest:
                self.cut_power()
                return Stop(stands, without, distance, now - begun, state, path)
            time.sleep(limits.LOOK)

    def cut_power(self) -> None:
        """Disable voltage, by SDO and NMT; never raises."""
        with contextlib.suppress(DriveError, OSError):
            self._bus.send(frame(0, bytes([cia402.NMT_PRE_OPERATIONAL, self.node])))
            self.write(_OFF, cia402.CONTROLWORD)


_QUICK_STOP, _FAULT = 3, 1  # options of 0x6007
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
        by_fault = self.reaction == _FAULT and self.fault_reaction in cia402.BRAKING
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
    time = limits.LATENESS * protection.timeout + limits.STOP_PERIODS * setup.dt
    return _bound(setup, (speed, current, time), protection.brakes)


def quick_stop_bound(setup: Setup, speed: float, current: float) -> float:
    """Distance (rad | m) of a stop that the loop asks for at `speed` under `current` (A)."""
    return _bound(setup, (speed, current, limits.STOP_PERIODS * setup.dt), True)


def _bound(setup: Setup, left: tuple[float, float, float], brakes: bool) -> float:
    """Run-on from a speed under a current for a time, see `drives.run_on`; and what the axis settles by."""
    speed, current, time = abs(left[0]), abs(left[1]), left[2]
    allowed, mechanics = axis_limits(setup.file), setup.stage.mechanics
    effort = current * setup.stage.motor.force_constant + weight(mechanics)
    worst = allowed.braking if brakes else allowed.coasting
    run_on = worst._replace(speed=speed, acceleration=effort / mechanics.inertia)
    return run_on.distance(time) + limits.SETTLING_SHARE * setup.file.limits.following_error
