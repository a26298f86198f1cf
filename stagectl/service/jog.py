"""Jog: an axis moves as long as somebody holds a key, and brakes as soon as nothing says so any more.

::

    client   -- press 17, speed -->  begins a move towards the end of the travel
             -- press 17 --------->  it is still held: again and again, in less than `HELD`
             -- stop ------------->  it was released
                                     nothing for `HELD`: the same, whatever has happened to key, page or network
    service  -- rows ----------->    for `DEAD_MAN` from each sign: where it stands still itself, the loop brakes

The move is an ordinary one: planned, within all limits, watched by the loop.  It lasts `FURTHEST` at most.  A press
that has ended never begins again, so a message that was held up on its way moves nothing.
"""

import asyncio
import math
import time
from functools import partial

from stagectl.realtime.shared_memory import HOLD, INTERFACE, Board
from stagectl.realtime.states import State
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.service.limits import DEAD_MAN, FURTHEST, HELD, JOG_LOOK, PRESSES
from stagectl.service.orders import OrderHandler, value_of
from stagectl.service.planning import Task


class _Press:
    """A key that is held."""

    def __init__(self, number: float, board: Board) -> None:
        self.number, self.begun = number, False
        self._board, self._stops = board, board.stops
        self.renew()

    @property
    def motion(self) -> str:
        """The name of its motion, which no other has."""
        return f"jog {self.number}"

    def renew(self) -> None:
        """It is still held."""
        self.until = time.monotonic() + HELD

    @property
    def held(self) -> bool:
        """Whether a sign has come in time."""
        return time.monotonic() <= self.until

    def stopped(self, board: Board) -> bool:
        """Whether somebody has stopped the axis since it began, or its real-time process is another one."""
        return board is not self._board or board.stops != self._stops


class Jogs:
    """The keys that are held, one an axis."""

    def __init__(self, orders: OrderHandler) -> None:
        self._orders = orders
        self._held: dict[str, _Press] = {}
        self._ended: dict[float, bool] = {}  # the last ones, by number: whether they had begun
        self._watches: set[asyncio.Task[None]] = set()

    async def hold(self, name: str, number: float, speed: str) -> None:
        """Begin the press of this number, or say that it is still held; the sign of `speed` is the direction.

        Raises ServiceError where it cannot begin, or has ended.
        """
        axis = self._orders.service.axis(name)
        velocity = _velocity(axis, speed)
        held = self._held.get(axis.name)
        if held is not None and held.number == number:
            held.renew()
            axis.fill(renewed=True)
        elif number in self._ended:
            was = "has ended" if self._ended[number] else "was refused"
            raise ServiceError(f"{axis.name}: this jog {was}; release the key and press it again")
        elif held is not None:
            raise ServiceError(f"{axis.name}: another key is held already")
        else:
            await self._begin(axis, _Press(number, axis.board), velocity)

    async def _begin(self, axis: AxisController, press: _Press, velocity: float) -> None:
        self._held[axis.name] = press
        watch = asyncio.create_task(self._watch(axis, press))  # from before the planning, which takes its time
        self._watches.add(watch)
        watch.add_done_callback(self._watches.discard)
        try:
            await self._orders.begin(axis, partial(_towards_the_end, axis, press.motion, velocity))
            press.begun = True
        except BaseException:
            press.until = -math.inf  # it has begun nothing
            raise

    async def _watch(self, axis: AxisController, press: _Press) -> None:
        """Brake when the press is over; where its motion has ended by itself that changes nothing."""
        while press.held and not press.stopped(axis.board):
            await asyncio.sleep(JOG_LOOK)
        del self._held[axis.name]
        self._ended[press.number] = press.begun
        while len(self._ended) > PRESSES:
            del self._ended[next(iter(self._ended))]
        waits = not press.begun and axis.state is State.STANDING
        moves = axis.motion is not None and axis.motion.name == press.motion
        if not press.stopped(axis.board) and (waits or moves):
            axis.board.stop(INTERFACE, HOLD)  # ends also what is still being laid out


def _velocity(axis: AxisController, speed: str) -> float:
    """A speed with its unit (m/s | rad/s of travel).  Raises ServiceError for one of 0."""
    velocity = value_of(speed, f"{axis.setup.file.axis.travel_unit}/s")
    if not velocity:
        raise ServiceError(f"{axis.name}: jog at {speed}; the speed must not be 0")
    return velocity


def _towards_the_end(axis: AxisController, name: str, velocity: float) -> Task:
    """A move at `velocity` (m/s | rad/s of travel) up to the end of the travel, less the following error."""
    scale, limits = axis.setup.file.axis.travel_per_unit, axis.setup.file.limits
    here, margin = axis.status.reference, limits.following_error
    room = (limits.travel[1] - here if velocity > 0.0 else here - limits.travel[0]) - margin
    if not room > axis.setup.stage.encoder.step:  # rounding leaves a little
        raise ServiceError(f"{axis.name}: it stands at the end of limits.travel: jog the other way")
    distance = min(room * scale, abs(velocity) * FURTHEST)
    return axis.move(math.copysign(distance, velocity), abs(velocity), None)._replace(name=name, dead_man=DEAD_MAN)
