"""A stage in virtual time: the daemon's own cycle and drive on one end of a bus, the virtual drive on the other."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.drives.bus.virtual_time import Timeline, Wire
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.clock import Clock
from stagectl.drives.drive import Canopen
from stagectl.kernels import law
from stagectl.plan import plan
from stagectl.realtime import loop
from stagectl.realtime.envelope import envelope
from stagectl.realtime.scheduling import Metronome
from stagectl.recording.metadata import portable
from stagectl.selftest.limits import LONGEST
from stagectl.service.virtual_drive import virtual_node
from stagectl.trajectories import Dwell, Trapezoid

_LOOK = 0.001  # s between two looks of the drive at its clocks, and of the test at the axis
_SHARE = 0.1  # of limits.speed, and of the travel to one side


class Seen(NamedTuple):
    """The axis as it truly is."""

    time: float  # s
    position: float  # rad | m
    velocity: float
    powered: bool


class Motions(NamedTuple):
    """What is laid out once for all cases."""

    law: law.Law
    holding: bytes  # setpoints
    moving: bytes
    speed: float  # rad/s | m/s


class Sleepy(Metronome):
    """A metronome whose process can be made to oversleep."""

    extra = 0.0  # s, at each wait

    def wait(self) -> float:
        """As the metronome does, and then so much more."""
        late = super().wait()
        self._sleep(self.extra)
        return late + self.extra


class Nowhere:
    """A recording that nobody reads."""

    def write(self, row: Any) -> None:
        """Forget it."""


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


def motions(setup: Setup, pace: Pace | None = None) -> Motions:
    """Standing still, and moving there and back."""
    pace, per_unit = pace or usual(setup), setup.file.axis.travel_per_unit
    controller = setup.controller
    way = Trapezoid(pace.distance * per_unit, pace.speed * per_unit, pace.acceleration * per_unit)
    rows = [
        np.ascontiguousarray(plan(setup, motion, controller.feedforward).setpoints) for motion in (Dwell(LONGEST), way)
    ]
    return Motions(portable(controller.law), rows[0].tobytes(), rows[1].tobytes(), pace.speed)


class Known:
    """What both rigs are: a stage, its motions, a time, and what was seen of the axis."""

    def __init__(self, setup: Setup, laid_out: Motions, time: Clock) -> None:
        wire = setup.file.drive.wire
        assert isinstance(wire, Canopen)
        self.setup, self.laid_out, self.settings, self.time = setup, laid_out, wire, time
        self.trace: list[Seen] = []

    def cycle(self, drive: CanopenDrive, setpoints: bytes, origin: float) -> loop.Cycle:
        """The daemon's cycle, to be called period by period."""
        limits = self.setup.file.limits
        job = loop.Job(
            law=self.laid_out.law,
            setpoints=setpoints,
            span=(-math.inf, math.inf),
            dt=self.setup.dt,
            by_clock=True,
            wire=None,
            stage=self.setup.stage,
            simulation=self.setup.file.simulation,
            envelope=envelope(self.setup)._replace(low=limits.travel[0], high=limits.travel[1]),
            priority=0,
            cpu=None,
            ring=-1,
            width=0,
            capacity=0,
        )
        cycle = loop.Cycle(job, drive, Nowhere(), origin)  # type: ignore[arg-type]
        cycle.metronome = Sleepy(self.setup.dt, self.time)
        return cycle

    def connect(self) -> CanopenDrive:
        """The daemon's side.  Raises DriveError."""
        raise NotImplementedError

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

    def let_go(self, drive: CanopenDrive) -> None:
        """The end of a motion that went on."""

    def settle(self) -> None:
        """What must be done to see how it ended."""

    @property
    def seen(self) -> Seen:
        """The axis now."""
        raise NotImplementedError


class Rig(Known):
    """One virtual stage, powered off."""

    def __init__(self, setup: Setup, laid_out: Motions) -> None:
        time = Timeline()
        super().__init__(setup, laid_out, time)
        self._timeline = time
        self.ours, theirs = Wire(time, self.settings.bitrate).ends
        self.said: list[str] = []
        self.node = virtual_node(setup, self.settings, theirs, self.said.append, time)
        theirs.woken_by(self.node.turn)
        self.node.boot()
        time.every(_LOOK, self._look)

    def connect(self) -> CanopenDrive:
        """The daemon's side.  Raises DriveError."""
        return CanopenDrive(self.settings, self.ours, self.setup.stage.encoder.step, self.setup.dt, clock=self.time)

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
    def seen(self) -> Seen:
        """The axis now."""
        axis = self.node.axis
        return Seen(self.time.now(), axis.plant.state.position, axis.plant.state.velocity, axis.enabled)

    def _look(self) -> None:
        self.node.turn()
        self.trace.append(self.seen)
