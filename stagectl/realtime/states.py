"""The axis' state machine, as one table: what each event leads to in each state.

::

    OFFLINE --connect--> CONNECTING --done--> DISABLED --enable--> ENABLING --done--> STANDING <--> MOVING, HOMING
                             ^                    ^                                      ^ done       | stop
                             | reset              | done (it was an order)               `- STOPPING -'
                           FAULT <--failed-- QUICK_STOPPING, COASTING <--- a fault, by its stop category

HOMING --delegated--> DRIVE_HOMING --done--> STANDING: the drive finds its home itself; a stop is then its quick stop.
STANDING --disable--> ENGAGING --done--> DISABLED: where there is a brake, it holds before power goes (ENABLING, too).
A drive that is found in Fault leads from CONNECTING to FAULT: faults are reset by a person.

An event that is not in a state's row is an order that cannot be given there; faults are in every row.
"""

import enum

from stagectl.drives.drive import Fault
from stagectl.realtime.stops import STOPS


class State(enum.IntEnum):
    """The state of one axis."""

    OFFLINE = 0
    CONNECTING = 1
    DISABLED = 2
    ENABLING = 3
    STANDING = 4
    MOVING = 5
    HOMING = 6
    STOPPING = 7
    QUICK_STOPPING = 8
    COASTING = 9
    FAULT = 10
    ENGAGING = 11
    DRIVE_HOMING = 12

    @property
    def words(self) -> str:
        """The state as a phrase."""
        return _WORDS[self]


class Event(enum.IntEnum):
    """Orders first, then events that happen by themselves."""

    CONNECT = 1
    ENABLE = 2
    DISABLE = 3
    MOVE = 4
    HOME = 5
    STOP = 6
    QUICK_STOP = 7
    RESET = 8
    DONE = 20  # what was going on has succeeded
    FAILED = 21  # it has not, or a stop that a fault asked for is over
    FAULTED = 22  # the drive was found in a fault, which a person resets
    DELEGATED = 23  # the drive is to find the home
    COAST = 30  # a fault of stop category 0
    RAMP = 31  # of category 1
    HOLD = 32  # of category 2


_WORDS = {
    State.OFFLINE: "is not connected to its drive",
    State.CONNECTING: "the drive is being configured",
    State.DISABLED: "without power",
    State.ENABLING: "power is being switched on",
    State.STANDING: "holds its position under power",
    State.MOVING: "moves",
    State.HOMING: "looks for its home",
    State.STOPPING: "brakes under control",
    State.QUICK_STOPPING: "the drive brakes on its own ramp",
    State.COASTING: "power is off, the axis coasts",
    State.FAULT: "stopped by a fault, without power",
    State.DRIVE_HOMING: "its drive looks for its home",
    State.ENGAGING: "is held until its brake holds it, then power is cut",
}

POWERED = (State.STANDING, State.MOVING, State.HOMING, State.STOPPING)  # our law acts
STOPS_GOING_ON = (State.QUICK_STOPPING, State.COASTING)


def _table() -> dict[tuple[State, Event], State]:
    s, e = State, Event
    table = {
        (s.OFFLINE, e.CONNECT): s.CONNECTING,
        (s.OFFLINE, e.RESET): s.CONNECTING,
        (s.CONNECTING, e.DONE): s.DISABLED,
        (s.CONNECTING, e.FAILED): s.OFFLINE,
        (s.CONNECTING, e.FAULTED): s.FAULT,
        (s.DISABLED, e.ENABLE): s.ENABLING,
        (s.DISABLED, e.RESET): s.DISABLED,
        (s.ENABLING, e.DONE): s.STANDING,
        (s.ENABLING, e.FAILED): s.FAULT,
        (s.STANDING, e.ENABLE): s.STANDING,
        (s.STANDING, e.MOVE): s.MOVING,
        (s.STANDING, e.HOME): s.HOMING,
        (s.STANDING, e.STOP): s.STANDING,
        (s.STANDING, e.HOLD): s.STANDING,
        (s.MOVING, e.DONE): s.STANDING,
        (s.HOMING, e.DONE): s.STANDING,
        (s.HOMING, e.FAILED): s.QUICK_STOPPING,
        (s.HOMING, e.DELEGATED): s.DRIVE_HOMING,
        (s.DRIVE_HOMING, e.DONE): s.STANDING,
        (s.DRIVE_HOMING, e.COAST): s.COASTING,
        (s.STOPPING, e.DONE): s.STANDING,
        (s.FAULT, e.RESET): s.CONNECTING,
    }
    for state in (s.MOVING, s.HOMING, s.STOPPING):
        table |= {(state, e.STOP): s.STOPPING, (state, e.HOLD): s.STOPPING, (state, e.DISABLE): s.QUICK_STOPPING}
    table |= {(state, order): s.QUICK_STOPPING for state in POWERED for order in (e.QUICK_STOP, e.RAMP)}
    table |= {(state, e.COAST): s.COASTING for state in POWERED}
    by_drive = (e.STOP, e.DISABLE, e.QUICK_STOP, e.RAMP, e.HOLD)  # whatever stops it: our law does not act
    table |= {(s.DRIVE_HOMING, event): s.QUICK_STOPPING for event in by_drive}
    table |= {(s.STANDING, e.DISABLE): s.ENGAGING, (s.ENGAGING, e.DONE): s.DISABLED}
    for stop in STOPS_GOING_ON:
        table |= {(stop, e.DONE): s.DISABLED, (stop, e.FAILED): s.FAULT, (stop, e.HOLD): stop, (stop, e.RAMP): stop}
        table |= {(stop, order): stop for order in (e.STOP, e.QUICK_STOP, e.DISABLE)}
        table[stop, e.COAST] = s.COASTING
    # no power, none yet, or a brake that engages: nothing to stop
    for still in (s.OFFLINE, s.CONNECTING, s.DISABLED, s.FAULT, s.ENABLING, s.ENGAGING):
        gone = s.OFFLINE if still in (s.OFFLINE, s.CONNECTING) else s.FAULT
        table |= {(still, fault): gone for fault in (e.COAST, e.RAMP, e.HOLD)}
        table |= {(still, order): still for order in (e.STOP, e.QUICK_STOP, e.DISABLE) if still is not s.ENABLING}
    table |= {(s.ENABLING, order): s.ENGAGING for order in (e.STOP, e.QUICK_STOP, e.DISABLE)}
    return table


TABLE = _table()


def event_of(fault: Fault) -> Event:
    """The event that a fault is, by its stop category."""
    return Event[STOPS[fault].category.name]


def following(state: State, event: Event) -> State | None:
    """The next state; None where the order cannot be given in this one."""
    return TABLE.get((state, event))


def why_not(event: Event, state: State) -> str:
    """Why an order cannot be given in this state, and what can."""
    why = f"{event.name.lower()} is not possible in state {state.name.lower()} ({state.words})"
    return f"{why}; {_before(event, state)}"


def _before(event: Event, state: State) -> str:
    """What to do so that an order can be given."""
    if state in (State.MOVING, State.HOMING, State.STOPPING, State.DRIVE_HOMING):
        return "wait for its end, or run `stagectl stop`"
    if event is Event.ENABLE:
        return "first run `stagectl fault reset`"
    if event in (Event.MOVE, Event.HOME):
        reset = "`stagectl fault reset`, then " if state is State.FAULT else ""
        return f"first run {reset}`stagectl enable`"
    return "see `stagectl status`"
