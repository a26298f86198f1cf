"""The job of the real-time process, from the stage file: for an axis that is served, and for a single motion."""

from collections.abc import Sequence

from stagectl.config.stage_blocks import InProcess
from stagectl.config.stage_file import Setup
from stagectl.config.time_outs import axis_limits
from stagectl.drives.homing import NO_HOMING
from stagectl.evaluation import WINDOW_COUNTS
from stagectl.kernels import law, stage
from stagectl.realtime.axes import Post
from stagectl.realtime.axis_data import Orders
from stagectl.realtime.envelope import braking, envelope
from stagectl.realtime.setpoint_sources import Model
from stagectl.realtime.shared_memory import Board
from stagectl.recording.metadata import portable
from stagectl.recording.ring import Ring
from stagectl.service.virtual_timeouts import patient, waits_for_sync

CALM = 0.7  # of what the axis can be braked with: the controller needs the rest


def orders(name: str, setup: Setup, running: law.Law, friction: bool, ring: Ring, board: Board) -> Orders:
    """All that the real-time process must know of an axis under the law `running`, with or without `friction` current.

    `ring` takes its rows; `board` its orders, setpoints and status.
    """
    lasting, p = patient(setup), setup.stage
    wire = lasting.file.drive.wire
    return Orders(
        name=name,
        law=portable(running),
        ramp=_ramp(setup, friction),
        envelope=envelope(lasting),
        homing=setup.file.homing,
        window=WINDOW_COUNTS * (p.encoder.step or 1e-9),
        own_ramp=setup.file.own_ramp,
        by_clock=not waits_for_sync(setup),
        wire=None if isinstance(wire, InProcess) else wire,
        stage=portable(p),
        simulation=setup.file.simulation,
        limits=axis_limits(setup.file, waits_for_sync(setup)),
        ring=ring.place,
        board=board.descriptor,
        brake=setup.file.brake,
    )


def relative(axis: Orders) -> Orders:
    """The job of a single motion, which needs no home: it counts from where the axis stands.

    The model knows that place only where the stage file says that positions are absolute.
    """
    return axis._replace(homing=NO_HOMING, placed=axis.homing.method == "none")


def post(setup: Setup, axes: Sequence[Orders], coupled: bool = False, single: bool = False) -> Post:
    """The order of the process for these `axes`; the period is that of `setup`."""
    realtime = setup.file.realtime
    # A plant in this process takes longer than its period: at real-time priority it would starve the machine.
    priority = realtime.priority if all(axis.wire for axis in axes) else 0
    return Post(tuple(axes), setup.dt, priority, realtime.cpu, coupled, realtime.spin, single)


def calm(setup: Setup) -> float:
    """Deceleration (rad/s^2 | m/s^2) of stops under control; friction helps them."""
    return min(setup.file.limits.acceleration, CALM * braking(setup))


def _ramp(setup: Setup, with_friction: bool) -> Model:
    p, gain = setup.stage, 1.0 / setup.stage.motor.force_constant
    friction = stage.sliding(p.friction) * gain if with_friction else 0.0
    late = p.encoder.delay_samples * setup.dt
    inertia, viscous = p.mechanics.inertia * gain, p.mechanics.viscous * gain
    return Model(setup.dt, calm(setup), inertia, viscous, float(friction), late)
