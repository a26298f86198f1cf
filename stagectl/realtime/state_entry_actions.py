"""What is done when a state of the axis begins: one function a state that has something to do.

Each returns the event that follows at once, if there is one.
"""

import contextlib
import math
from collections.abc import Callable

from stagectl.drives.canopen.power_states import Standstill
from stagectl.drives.drive import Fault, Power
from stagectl.drives.limits import SEARCH_TIME
from stagectl.realtime import bumpless_transfer, safety
from stagectl.realtime.axis_data import AxisData
from stagectl.realtime.homing import DriveSearch, Search
from stagectl.realtime.setpoint_sources import Hold, Ramp, held, stopped
from stagectl.realtime.states import POWERED, Event, State
from stagectl.units import StageError

_CONNECT_TIME = 15.0  # s that a connection may take before the process counts as hung


def enter(axis: AxisData, old: State) -> Event | None:
    """Begin the axis' state, which was `old` before; the event that follows at once."""
    axis.governed = axis.state in POWERED
    entry = _ENTRIES.get(axis.state)
    return None if entry is None else entry(axis, old)


def _connecting(axis: AxisData, _: State) -> Event:
    """The drive is found and configured; this takes its time, and no period passes meanwhile."""
    axis.show(_CONNECT_TIME)
    axis.hang_up()
    axis.offset = 0.0
    axis.asked = held(math.nan, 0.0)  # the first position is no jump: it is compared with the last connection's
    try:
        axis.drive = axis.connect(axis.p)
    except (StageError, OSError) as error:
        axis.board.say(str(error))
        return Event.FAILED
    if axis.resetting:
        with contextlib.suppress(StageError):  # then it is pending still
            axis.drive.reset_fault()
    return Event.FAULTED if axis.drive.pending_fault() else Event.DONE


def _without_power(axis: AxisData, _: State) -> None:
    axis.search, axis.since = None, axis.cycles
    _ask(axis, Power.OFF)


def _enabling(axis: AxisData, _: State) -> None:
    axis.since, axis.fault, axis.judged = axis.cycles, Fault.NONE, ""
    axis.start, axis.holding = math.nan, 0.0  # known in the next period: see `AxisData.adrift`
    axis.asked = held(axis.seen.position, 0.0)  # a jump counts from here, not from before a new connection
    _ask(axis, Power.ON)


def _standing(axis: AxisData, old: State) -> None:
    """Hold what was asked last, with the friction that is loaded; where another law held the axis, where it stands."""
    axis.settled, axis.search = 0.0, None
    if old in (State.ENABLING, State.DRIVE_HOMING):
        axis.holding = axis.carrying() if old is State.DRIVE_HOMING else axis.holding  # it stands elsewhere now
        axis.watch = safety.FRESH._replace(heat=axis.watch.heat)
        axis.asked, axis.current = held(axis.seen.position, 0.0), axis.holding
        axis.x = bumpless_transfer.loaded(axis.law, axis.asked, axis.seen.position, axis.holding)
    axis.choose_limits(fresh=old in (State.ENABLING, State.HOMING, State.DRIVE_HOMING))
    axis.speed = 0.0
    axis.source = Hold(stopped(axis.asked))


def _homing(axis: AxisData, _: State) -> Event | None:
    p = axis.p.homing
    if p.method in ("none", "here"):  # none: a person says that the position is right
        axis.count_from(axis.asked.reference - p.position if p.method == "here" else 0.0)
        return Event.DONE
    axis.homed = False
    if p.by_drive:
        return Event.DELEGATED
    axis.search = Search(p, axis.asked.reference, axis.dt)
    axis.choose_limits()
    gentle = min(axis.p.ramp.acceleration, abs(p.speed) / SEARCH_TIME)  # its current must not look like an end stop
    axis.source = Ramp(axis.p.ramp._replace(acceleration=gentle), axis.asked, 0.0, p.speed)
    return None


def _drive_homing(axis: AxisData, _: State) -> None:
    axis.choose_limits()
    axis.delegated = DriveSearch(axis.p.homing, axis.seen.position)
    axis.since = axis.cycles
    _ask(axis, Power.HOME)


def _braking(axis: AxisData, _: State) -> None:
    axis.search = None
    axis.choose_limits(fresh=False)
    axis.brake()


def _engaging(axis: AxisData, old: State) -> Event | None:
    """Hold under power until the brake holds; without a brake there is nothing to wait for."""
    axis.since = axis.cycles
    if not axis.p.brake.present:
        return Event.DONE
    if old is State.ENABLING:  # its brake may be released already
        axis.x = bumpless_transfer.loaded(axis.law, axis.asked, axis.seen.position, axis.holding)
    _ask(axis, Power.ENGAGE)
    return None


def _begin_stop(axis: AxisData, power: Power) -> None:
    axis.search = None
    axis.since, axis.start, axis.lost = axis.cycles, axis.seen.position, math.nan
    axis.still = Standstill.of_ramp(axis.p.own_ramp, axis.p.stage.encoder.step, axis.dt)
    _ask(axis, power)


def _ask(axis: AxisData, power: Power) -> None:
    if axis.drive is not None:
        axis.drive.ask(power)


_ENTRIES: dict[State, Callable[[AxisData, State], Event | None]] = {
    State.CONNECTING: _connecting,
    State.DISABLED: _without_power,
    State.ENABLING: _enabling,
    State.STANDING: _standing,
    State.HOMING: _homing,
    State.DRIVE_HOMING: _drive_homing,
    State.STOPPING: _braking,
    State.QUICK_STOPPING: lambda axis, _: _begin_stop(axis, Power.QUICK_STOP),
    State.COASTING: lambda axis, _: _begin_stop(axis, Power.OFF),
    State.FAULT: _without_power,
    State.ENGAGING: _engaging,
}
