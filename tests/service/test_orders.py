"""Orders of several clients at once: one motion at a time is laid out and begun, and a stop ends what is not begun."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import pytest

from stagectl.config.stage_blocks import InProcess
from stagectl.config.stage_file import Setup
from stagectl.drives.bus.virtual_time import Timeline
from stagectl.drives.homing import Homing
from stagectl.realtime.axes import Loop
from stagectl.realtime.shared_memory import HOLD, INTERFACE, STOP_PATH, Order
from stagectl.realtime.states import Event, State
from stagectl.service import job_from_stage
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.service.orders import OrderHandler
from stagectl.service.planning import Upload
from stagectl.service.service import Service, ServicePaths
from tests.conftest import varied

CALM = (None, None)
LONG = Upload("{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 40}", {})  # longer than the board


class Bench:
    """A service and its loop in one thread: a period whenever the service waits."""

    def __init__(self, setup: Setup, folder: Path, *more: str) -> None:
        setup = varied(setup, substeps=1)
        setup = setup.having(drive=setup.file.drive._replace(wire=InProcess()))
        self.axes = {name: AxisController(name, setup) for name in ("axis", *more)}
        self.axis = self.axes["axis"]
        self.said: list[str] = []
        self.orderly = OrderHandler(Service(self.axes, ServicePaths(folder / "s", folder), False, self.said.append))
        post = job_from_stage.post(setup, [axis.orders() for axis in self.axes.values()])
        self.loop = Loop(post, Timeline())
        for axis in self.loop.axes:
            axis.happen(Event.CONNECT)
        self.travel = setup.file.axis.travel_per_unit

    def serve(self, *asked: Coroutine[Any, Any, None]) -> list[BaseException | None]:
        """What became of the orders, given at once, after the axes were enabled."""

        async def go_on() -> None:
            while True:
                self.loop.period()
                for axis in self.axes.values():
                    axis.fill()
                await asyncio.sleep(0)

        async def all_of_it() -> list[BaseException | None]:
            going = asyncio.create_task(go_on())
            await asyncio.sleep(0)
            await self.orderly.enable(list(self.axes.values()))
            ends = await asyncio.gather(*asked, return_exceptions=True)
            going.cancel()
            self.orderly.service.planner.close()
            return ends

        return asyncio.run(all_of_it())

    def move(self, to: str) -> Coroutine[Any, Any, None]:
        return self.orderly.move({"": to}, {}, CALM, True)

    @property
    def position(self) -> float:
        return self.loop.axes[0].seen.position * self.travel


@pytest.fixture
def bench(ball_screw: Setup, tmp_path: Path) -> Bench:
    return Bench(ball_screw, tmp_path)


def test_of_two_moves_at_once_the_first_is_made_and_the_other_refused(bench: Bench) -> None:
    well, refused = bench.serve(bench.move("1 mm"), bench.move("2 mm"))
    assert well is None
    assert isinstance(refused, ServiceError)
    assert "moves" in str(refused)
    assert bench.position == pytest.approx(1e-3, abs=1e-6)


def test_one_axis_has_one_position(bench: Bench) -> None:
    """It is named once, and not the second time."""
    (refused,) = bench.serve(bench.orderly.move({"": "1 mm", "axis": "2 mm"}, {}, CALM, True))
    assert isinstance(refused, ServiceError)
    assert (bench.axis.status.motions, bench.position) == (0, pytest.approx(0.0, abs=1e-6))


def test_a_move_to_where_an_axis_without_a_home_seems_to_stand_is_refused(bench: Bench) -> None:
    bench.loop.axes[0].lose_origin("the encoder jumped")
    (error,) = bench.serve(bench.orderly.move({"axis": "0 mm"}, {}, CALM, True))
    assert isinstance(error, ServiceError) and "no home" in str(error)


def test_gains_are_written_with_their_units_and_taken_as_they_are_written(bench: Bench) -> None:
    written = bench.axis.written_parameters()
    assert (written["bandwidth"], written["margin"]) == ("40 Hz", "20 deg")
    assert bench.axis.changed(written).control == bench.axis.control


def test_a_motion_longer_than_the_board_goes_on_when_another_is_refused(bench: Bench) -> None:
    async def meanwhile() -> None:
        while bench.axis.state is not State.MOVING:
            await asyncio.sleep(0)
        await bench.move("2 mm")

    well, refused = bench.serve(bench.orderly.trajectory("", "long", LONG, True), meanwhile())
    assert well is None
    assert isinstance(refused, ServiceError)
    assert bench.axis.status.faults == 0


def test_a_stop_ends_a_motion_that_is_still_being_laid_out(bench: Bench) -> None:
    async def later() -> None:
        await asyncio.sleep(0)
        await bench.orderly.stop([bench.axis])

    refused, waited, stopped = bench.serve(bench.move("1 mm"), bench.move("2 mm"), later())
    assert stopped is None
    for answer in (refused, waited):  # the second one waits for the first
        assert isinstance(answer, ServiceError)
        assert "stopped before it began" in str(answer)
    assert bench.axis.status.motions == 0


def test_a_stop_ends_an_enabling_whose_drive_is_still_being_configured(bench: Bench) -> None:
    async def enabled() -> None:
        await bench.orderly.disable([bench.axis])
        axis = bench.loop.axes[0]
        axis.state, axis.drive = State.OFFLINE, None
        bench.loop._look_round()
        axis.show()
        connected = axis.connect

        def connect(orders: Any) -> Any:
            bench.axis.board.stop(INTERFACE, HOLD)  # a person presses Stop meanwhile
            return connected(orders)

        axis.connect = connect
        await bench.orderly.enable([bench.axis])

    (refused,) = bench.serve(enabled())
    assert isinstance(refused, ServiceError) and "stopped before it began" in str(refused)
    assert bench.axis.state is State.DISABLED


def test_of_moves_that_begin_together_none_waits_for_a_later_one(ball_screw: Setup, tmp_path: Path) -> None:
    """A stop of y alone ends both; x must not begin its old move when y begins the next."""
    bench = Bench(ball_screw, tmp_path, "y")
    service: Any = bench.orderly.service
    order = service.order

    async def both(x: str, y: str) -> None:
        await bench.orderly.move({"axis": x, "y": y}, {}, CALM, True)

    async def stopped_in_between(axis: AxisController, given: Order) -> None:
        if axis.name == "y":
            axis.board.stop(STOP_PATH, HOLD)
        await order(axis, given)

    async def twice() -> None:
        service.order = stopped_in_between
        with pytest.raises(ServiceError, match="stopped before it began"):
            await both("2 mm", "1 mm")
        service.order = order
        await both("-1 mm", "-2 mm")

    assert bench.serve(twice()) == [None]
    assert [axis.status.motions for axis in bench.axes.values()] == [1, 1]
    assert bench.position == pytest.approx(-1e-3, abs=1e-6)


def test_a_home_waits_for_a_motion_that_is_laid_out_from_the_present_origin(ball_screw: Setup, tmp_path: Path) -> None:
    bench = Bench(ball_screw.having(homing=Homing("here", position=0.5)), tmp_path)

    async def homed() -> None:
        await bench.orderly.home([bench.axis])

    async def later() -> None:
        while not bench.orderly._begin.locked():
            await asyncio.sleep(0)
        await homed()

    assert bench.serve(homed()) == [None]
    begins = bench.axis.status.reference * bench.travel
    moved, refused = bench.serve(bench.move(f"{begins + 1e-3} m"), later())
    assert moved is None and isinstance(refused, ServiceError)
    assert bench.position == pytest.approx(begins + 1e-3, abs=1e-6)


def test_the_service_says_that_the_current_against_an_effect_is_limited(ball_screw: Setup, tmp_path: Path) -> None:
    p = ball_screw.stage
    cogging = p.motor.cogging._replace(amplitude=0.7 * p.drive.current_limit * p.motor.force_constant, order=4.0)
    bench = Bench(ball_screw._replace(stage=p._replace(motor=p.motor._replace(cogging=cogging))), tmp_path)
    outcome = bench.serve(bench.move("3 mm"))
    assert any(line.startswith("axis: move: ") and "motor.cogging would take" in line for line in bench.said), outcome


def test_homing_without_a_method_says_what_was_done(bench: Bench) -> None:
    async def homed() -> None:
        assert list(await bench.orderly.home([bench.axis])) == ["axis"]

    assert bench.serve(homed()) == [None]
