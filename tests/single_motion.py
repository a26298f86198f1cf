"""A single motion against the virtual drive in virtual time: `run`, without its processes."""

from __future__ import annotations

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Canopen
from stagectl.kernels import rollout
from stagectl.plan import plan
from stagectl.realtime.axis import Axis
from stagectl.realtime.envelope import envelope
from stagectl.realtime.shared_memory import Board, Order
from stagectl.realtime.states import Event
from stagectl.recording.ring import Ring
from stagectl.selftest.limits import LONGEST
from stagectl.selftest.rig import Pace, Rig, RigLoop, usual
from stagectl.service import job_from_stage
from stagectl.service.single_motion import laid_on
from stagectl.trajectories import Dwell, Trapezoid


class SingleMotion:
    """Connected, and told to get power and to move there and back, or to hold its place."""

    def __init__(self, setup: Setup, moving: bool, pace: Pace | None = None) -> None:
        self.pace = pace or usual(setup)
        wire, per_unit, controller = setup.file.drive.wire, setup.file.axis.travel_per_unit, setup.controller
        assert isinstance(wire, Canopen)
        distance, speed, acceleration = (value * per_unit for value in self.pace)
        motion = Trapezoid(distance, speed, acceleration) if moving else Dwell(LONGEST)
        rows = plan(setup, motion, controller.feedforward).setpoints
        board, ring = Board.create(len(rows)), Ring.create(rollout.WIDTH, 1 << 10)
        job = job_from_stage.orders(setup.file.name, setup, controller.law, False, ring, board)
        job = job_from_stage.relative(job)._replace(by_clock=True, wire=wire, envelope=envelope(setup))
        self.rig = Rig(setup)
        self.loop = RigLoop(self.rig, job, single=True)
        self.loop.connect()
        board.order(Order(Event.ENABLE))
        board.order(laid_on(board, rows))
        self.loop.begin()
        self.axis: Axis = self.loop.axes[0]
