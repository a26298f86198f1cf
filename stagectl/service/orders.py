"""What each order means for the machine: one axis after the other, or several at once; it ends when it has happened."""

import asyncio
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from stagectl.evaluation import DWELL
from stagectl.realtime.shared_memory import CUT, HOLD, INTERFACE, Board, Order
from stagectl.realtime.states import Event, State, why_not
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.service.limits import MOTIONS_WAITING, SETTLE
from stagectl.service.planning import Task, Upload, check_pace
from stagectl.service.service import Service
from stagectl.units import StageError, UnitError, parse

_ENABLED, _STANDS, _CONNECTED = 6.0, 25.0, 16.0  # s that enabling, without a brake, a stop and a connection may take
_NO_HOME = "the stage file has no homing: this position is taken as right, nothing was searched"
Layout = Callable[[], Task | None]  # None: the axis is there already


class _Wanted(NamedTuple):
    """A motion that was asked for, with the stops that there had been by then: another one ends it."""

    axis: AxisController
    layout: Layout
    board: Board
    stops: int


_UNPOWERED = (State.DISABLED, State.FAULT, State.OFFLINE)


class OrderHandler:
    """Gives orders to a service's axes."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self._begin = asyncio.Lock()  # one at a time lays its motion out from where the axes stand, and begins it
        self._waiting = 0  # motions that wait for their turn

    async def enable(self, axes: list[AxisController]) -> None:
        """Switch power on; the axes then hold where they stand."""
        stops = [axis.board.stops for axis in axes]  # one that comes while a drive is configured ends it, too
        for axis in axes:
            if axis.state is State.OFFLINE:
                await self._connect(axis, Event.CONNECT)
        for axis, before in zip(axes, stops, strict=True):
            await self.service.order(axis, Order(Event.ENABLE, stops=before))
        for axis in axes:
            await self.service.until(
                partial(_no_longer, axis, State.ENABLING), _ENABLED + axis.setup.file.brake.release
            )
            if axis.state is not State.STANDING:
                raise ServiceError(f"{axis.name}: {axis.board.words or 'it did not get power'}")
            axis.powered()

    async def disable(self, axes: list[AxisController]) -> None:
        """Stop what moves, and switch power off."""
        for axis in axes:
            axis.board.stop(INTERFACE, HOLD)
            axis.board.order(Order(Event.DISABLE))
        await self._stopped(axes, _UNPOWERED)

    async def stop(self, axes: list[AxisController]) -> None:
        """Stop category 2: brake under control, then hold."""
        for axis in axes:
            axis.board.stop(INTERFACE, HOLD)
        await self._stopped(axes, (State.STANDING, *_UNPOWERED))

    async def quick_stop(self, axes: list[AxisController]) -> None:
        """Stop category 1: the drives brake on their own ramps, then power is cut."""
        for axis in axes:
            axis.board.stop(INTERFACE, CUT)
        await self._stopped(axes, _UNPOWERED)

    async def reset(self, axes: list[AxisController]) -> None:
        """Leave the fault: the drives are configured anew, and have no power yet."""
        for axis in axes:
            if axis.state is not State.DISABLED:
                await self._connect(axis, Event.RESET)

    async def home(self, axes: list[AxisController]) -> dict[str, str]:
        """Find the home, one axis after the other; of an axis without a method, what was done in its place."""
        stops = [axis.board.stops for axis in axes]
        for axis, before in zip(axes, stops, strict=True):
            async with self._begin:  # a motion that is being laid out counts from the present origin
                await self.service.order(axis, Order(Event.HOME, stops=before))
            if not await self._settled(axis, before) or not axis.status.homed:
                raise ServiceError(f"{axis.name}: not homed: {axis.board.words or 'it was stopped'}")
            axis.finished(False)  # it stands where no plan has left it: nothing is known of its friction
        return {axis.name: _NO_HOME for axis in axes if axis.setup.file.homing.method == "none"}

    async def move(
        self, to: dict[str, str], by: dict[str, str], pace: tuple[str | None, str | None], wait: bool
    ) -> None:
        """Begin moves in one period; with `wait`, until all stand in position.

        Raises ServiceError where one cannot begin: then none does.
        """
        if (not to and not by) or to.keys() & by.keys():
            raise ServiceError("a move needs `to` (a position) or `by` (a distance), and not both for one axis")
        planned: list[tuple[AxisController, Layout]] = []
        for name, text in (*to.items(), *by.items()):
            axis = self.service.axis(name)
            if any(axis is other for other, _ in planned):  # once without its name
                raise ServiceError(f"{axis.name}: the move gives two positions for one axis; nothing has moved")
            planned.append((axis, partial(self._planned, axis, (text, name in to), pace)))
        await self._run(planned, wait)

    async def trajectory(self, name: str, called: str, upload: Upload, wait: bool) -> None:
        """Run an uploaded trajectory, which is `called` so, on the axis of this name."""
        axis = self.service.axis(name)
        axis.known(upload.unanswered)
        await self._run([(axis, partial(axis.task, called, upload))], wait)

    async def begin(self, axis: AxisController, layout: Layout) -> None:
        """Begin what `layout` lays out from where the axis stands.  Raises ServiceError or StageError."""
        await self._run([(axis, layout)], wait=False)

    async def change(self, name: str, values: dict[str, str]) -> dict[str, str]:
        """Other gains for an axis, or for all; of an axis with less margin than its stage file asks for, a note."""
        axes = self.service.chosen(name)
        for axis in axes:
            gains = await asyncio.to_thread(axis.changed, values)
            await self.service.order(axis, gains.order)
            axis.adopt(gains)
        return {axis.name: words for axis in axes if (words := axis.lenient())}

    def leave(self, name: str, places: Sequence[str]) -> None:
        """Leave effects of an axis to the feedback, as their compensation makes the error grow."""
        axis = self.service.axis(name)
        axis.leave(places)
        self.service.say(
            f"{axis.name}: from the next motion on the feedback alone answers {', '.join(places)}; "
            f"`control.unanswered` in {axis.setup.path} keeps it so after a restart"
        )

    async def _connect(self, axis: AxisController, event: Event) -> None:
        await self.service.order(axis, Order(event))
        await self.service.until(partial(_no_longer, axis, State.CONNECTING), _CONNECTED)
        if axis.state is not State.DISABLED:
            raise ServiceError(f"{axis.name}: {axis.board.words}")

    async def _stopped(self, axes: list[AxisController], ends: tuple[State, ...]) -> None:
        """Wait until the loop has heeded it, and each axis is in one of these states."""

        def over(axis: AxisController) -> bool:
            return axis.board.heeded(INTERFACE) and axis.state in ends

        for axis in axes:
            if not await self.service.until(partial(over, axis), _STANDS):
                raise ServiceError(f"{axis.name}: did not stop; state {axis.state.name.lower()}: see `stagectl status`")

    async def _settled(self, axis: AxisController, stops: int) -> bool:
        """Wait for the end of the motion; whether the axis then stays in position for the dwell time.

        A motion that an order has stopped, one more than the `stops` before it, has not come to its end.
        """
        motion, board = axis.motion, axis.board
        while axis.state in (State.MOVING, State.HOMING, State.DRIVE_HOMING):
            await asyncio.sleep(0.005)
        end = time.monotonic() + SETTLE
        while axis.state is State.STANDING and time.monotonic() <= end:
            if axis.board is not board or board.stops != stops:
                return False
            status = axis.status
            if status.settled >= DWELL:
                if axis.motion is motion:
                    axis.finished(not status.fault)
                return not status.fault
            await asyncio.sleep(0.005)
        return False

    def _planned(
        self, axis: AxisController, where: tuple[str, bool], pace: tuple[str | None, str | None]
    ) -> Task | None:
        """The move to a position, or by a distance; None where the axis is there already."""
        unit, scale = axis.setup.file.axis.travel_unit, axis.setup.file.axis.travel_per_unit
        text, absolute = where
        distance = value_of(text, unit)
        speed = value_of(pace[0], f"{unit}/s") if pace[0] else None
        acceleration = value_of(pace[1], f"{unit}/s^2") if pace[1] else None
        check_pace(axis.name, axis.setup, speed, acceleration)
        if absolute:
            distance -= axis.status.reference * scale
        if abs(distance) < 1e-12:
            if not axis.status.homed:  # its 0 is another
                raise ServiceError(f"{axis.name}: the axis has no home yet: `stagectl home`")
            return None
        return axis.move(distance, speed, acceleration)

    async def _run(self, planned: Sequence[tuple[AxisController, Layout]], wait: bool) -> None:
        if self._waiting >= MOTIONS_WAITING:
            raise ServiceError(f"{MOTIONS_WAITING} motions wait for their turn already: wait for their end")
        wanted = [_Wanted(axis, layout, axis.board, axis.board.stops) for axis, layout in planned]
        self._waiting += 1
        try:
            async with self._begin:
                motions = await self._begun(wanted)
        finally:
            self._waiting -= 1
        if wait:
            good = await asyncio.gather(*(self._settled(motion.axis, motion.stops) for motion in motions))
            for motion, well in zip(motions, good, strict=True):
                if not well:
                    raise ServiceError(f"{motion.axis.name}: not in position: {_why_not_there(motion)}")

    async def _begun(self, wanted: Sequence[_Wanted]) -> list[_Wanted]:
        """Lay all of them out, then begin them; the loop refuses those that a stop has ended since they were wanted."""
        for motion in wanted:
            if motion.axis.state is not State.STANDING:
                raise ServiceError(f"{motion.axis.name}: {why_not(Event.MOVE, motion.axis.state)}")
        tasks = [(motion, task) for motion in wanted if (task := motion.layout()) is not None]
        planned = [(motion, await self.service.planner.plan(task)) for motion, task in tasks]
        if any((motion.board, motion.stops) != (motion.axis.board, motion.axis.board.stops) for motion in wanted):
            raise ServiceError("stopped before it began: the motion was still being laid out")
        for motion, laid_out in planned:
            if laid_out.limited:
                self.service.say(f"{motion.axis.name}: {laid_out.limited}")
        orders = [
            (motion.axis, motion.axis.start(laid_out, len(tasks))._replace(stops=motion.stops))
            for motion, laid_out in planned
        ]
        await self._together(orders)
        return [motion for motion, _ in planned]

    async def _together(self, orders: Sequence[tuple[AxisController, Order]]) -> None:
        """Give all of them; where one is refused, those that wait for it must not wait for a later one."""
        try:
            await asyncio.gather(*(self.service.order(axis, order) for axis, order in orders))
        except StageError:
            if len(orders) > 1:
                for axis, _ in orders:
                    axis.board.stop(INTERFACE, HOLD)
            raise


def _why_not_there(motion: _Wanted) -> str:
    axis = motion.axis
    if axis.status.fault:
        return axis.board.words
    if (motion.board, motion.stops) != (axis.board, axis.board.stops):
        return "an order stopped it before its end; it can move on"
    return f"it did not settle within {SETTLE:g} s: see `stagectl scope error`"


def _no_longer(axis: AxisController, state: State) -> bool:
    return axis.state is not state


def value_of(text: str, unit: str) -> float:
    """A number with its unit (SI).  Raises ServiceError."""
    try:
        return parse(text, unit)
    except UnitError as error:
        example = f"5 {unit.replace('rad', 'deg') if 'rad' in unit else f'm{unit}'}"
        raise ServiceError(f"{text}: {error}; it must be a number with its unit, such as {example}") from error
