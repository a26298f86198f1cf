"""A stage in virtual time: the real-time process' own loop on one end of a bus, the virtual drive on the other."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.config.time_outs import axis_limits
from stagectl.drives.bus.frames import Bus
from stagectl.drives.bus.virtual_time import Timeline, Wire
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.clock import Clock
from stagectl.drives.homing import NO_HOMING, Homing
from stagectl.realtime import axes
from stagectl.realtime.axis_data import Orders
from stagectl.realtime.envelope import envelope
from stagectl.realtime.scheduling import Metronome
from stagectl.selftest.limits import LONGEST
from stagectl.service import job_from_stage, planning
from stagectl.service.axis_controller import AxisController
from stagectl.service.virtual_drive import virtual_node

_LOOK = 0.001  # s between two looks of the drive at its clocks, and of the test at the axis
_SHARE = 0.1  # of limits.speed, and of the travel to one side


class AxisSample(NamedTuple):
    """The axis as it truly is."""

    time: float  # s
    position: float  # rad | m
    velocity: float
    powered: bool


class OversleepingMetronome(Metronome):
    """A metronome whose process can be made to oversleep."""

    extra = 0.0  # s, at each wait

    def wait(self) -> float:
        """As the metronome does, and then so much more."""
        late = super().wait()
        self._sleep(self.extra)
        return late + self.extra


class Pace(NamedTuple):
    """Of the motion (rad | m): how far, how fast, how soon."""

    distance: float
    speed: float
    acceleration: float


def usual(setup: Setup) -> Pace:
    """A tenth of the largest speed, from the middle of the travel outwards."""
    limits = setup.file.limits
    speed = _SHARE * limits.speed
    return Pace(min(speed * LONGEST, 0.4 * (limits.travel[1] - limits.travel[0])), speed, limits.acceleration)


class Service(NamedTuple):
    """The service's side of the axis, laid out once for all cases."""

    controller: AxisController
    motion: planning.Motion
    speed: float  # rad/s | m/s, of the motion
    orders: Orders
    searching: Orders  # for a home that does not come
    delegating: Orders  # whose drive finds the home


def laid_out(setup: Setup, pace: Pace) -> Service:
    """The axis of `setup` and its motion at this `pace`: nothing but the fault holds anything up, no home is needed."""
    controller, scale = AxisController("axis", setup), setup.file.axis.travel_per_unit
    motion = planning.laid_out(controller.move(*(value * scale for value in pace)))
    # time-outs and limits as the stage file says
    job = controller.orders()._replace(by_clock=True, homing=NO_HOMING, wire=setup.canopen, envelope=envelope(setup))
    search = Homing("limit", pace.speed, math.inf)
    by_drive = search._replace(method="drive", number=34)  # upwards, to a mark that is behind it
    return Service(controller, motion, pace.speed, job, job._replace(homing=search), job._replace(homing=by_drive))


class RigLoop(axes.Loop):
    """The loop of the real-time process, on the bus of a rig and in its time."""

    def __init__(self, rig: BaseRig, job: Orders, single: bool = False) -> None:
        self._rig = rig
        super().__init__(job_from_stage.post(rig.setup, [job], single=single), rig.time)
        self._metronome = self.metronome = OversleepingMetronome(rig.setup.dt, rig.time)

    def _connect(self, p: Orders) -> CanopenDrive:
        return self._rig.connect(p.homing)


class BaseRig:
    """What both rigs are: a stage, a time, and what was seen of the axis."""

    bus: Bus  # the controller's end

    def __init__(self, setup: Setup, time: Clock) -> None:
        self.setup, self.settings, self.time = setup, setup.canopen, time
        self.trace: list[AxisSample] = []

    def connect(self, homing: Homing = NO_HOMING) -> CanopenDrive:
        """The daemon's side.  Raises DriveError."""
        step, dt, file = self.setup.stage.encoder.step, self.setup.dt, self.setup.file
        return CanopenDrive(Wishes(self.settings, step, dt, axis_limits(file), homing), self.bus, file.brake, self.time)

    def begin(self, block: Any) -> None:
        """The fault of this block of `drives.faults`, now."""
        raise NotImplementedError

    def trip(self, code: int) -> None:
        """A fault that the drive itself finds, by its emergency `code`."""
        raise NotImplementedError

    def cut_off(self) -> None:
        """The controller's own interface fails."""
        raise NotImplementedError

    def left_alone(self) -> None:
        """The controller is dead."""

    def later(self, seconds: float, event: Callable[[], None]) -> None:
        """Have something happen while the controller waits for the drive; at once where time is not ours."""
        event()

    def let_go(self, loop: RigLoop) -> None:
        """The end of a case, of whose motion something may go on."""

    def settle(self) -> None:
        """What must be done to see how it ended."""

    @property
    def seen(self) -> AxisSample:
        """The axis now."""
        raise NotImplementedError


class Rig(BaseRig):
    """One virtual stage, powered off."""

    def __init__(self, setup: Setup) -> None:
        time = Timeline()
        super().__init__(setup, time)
        self._timeline = time
        self.ours, theirs = Wire(time, self.settings.bitrate).ends
        self.bus, self.said = self.ours, list[str]()
        self.node = virtual_node(setup, self.settings, theirs, self.said.append, time)
        theirs.wakes = self.node.turn
        self.node.boot()
        time.every(_LOOK, self._look)

    def begin(self, block: Any) -> None:
        """The fault of this block of `drives.faults`, now."""
        self.node.faults.begin(block, self.node.now())

    def later(self, seconds: float, event: Callable[[], None]) -> None:
        """Have something happen while the controller waits for the drive."""
        self._timeline.at(self.time.now() + seconds, event)

    def trip(self, code: int) -> None:
        """A fault that the drive itself finds, by its emergency `code`."""
        self.node.trip(code)

    def cut_off(self) -> None:
        """The controller's own interface fails."""
        self.ours.down = True

    @property
    def seen(self) -> AxisSample:
        """The axis now."""
        axis = self.node.axis
        return AxisSample(self.time.now(), axis.plant.state.position, axis.plant.state.velocity, axis.enabled)

    def _look(self) -> None:
        self.node.turn()
        self.trace.append(self.seen)
