"""Orders that wait for others, those that wait for nothing: the stops, and those that nobody has ordered."""

from stagectl.drives.drive import Fault
from stagectl.realtime.axis import Axis
from stagectl.realtime.shared_memory import CUT, HOLD, Order
from stagectl.realtime.states import Event, State

_STOP_EVENTS = {HOLD: Event.STOP, CUT: Event.QUICK_STOP}


def take_stops(axis: Axis) -> None:
    """Take the stops that were asked for; no queue, no other axis and no state is in their way."""
    kinds = axis.board.next_stops()
    for kind in kinds:
        axis.happen(_STOP_EVENTS[kind])
    if kinds:
        axis.show()  # before it is heeded: whoever asked sees the state that follows
        axis.board.heed()


def give_up(axis: Axis, fault: Fault) -> None:
    """Stop an axis for a `fault` that is not its own, by the drive's ramp; by its brake as its power comes or goes."""
    if axis.p.brake.present and axis.state in (State.ENABLING, State.ENGAGING):
        axis.happen(Event.DISABLE)
    elif axis.powered:
        axis.happen(Event.RAMP, fault)


def joint(order: Order) -> bool:
    """Whether it is a move that begins with those of other axes."""
    return order.kind == Event.MOVE and order.numbers[-1] > 1.0
