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
from stagectl.realtime.axes import Loop
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

    def __init__(self, setup: Setup, folder: Path) -> None:
        setup = varied(setup, substeps=1)
        setup = setup.having(drive=setup.file.drive._replace(wire=InProcess()))
        self.axis = AxisController("axis", setup)
        self.said: list[str] = []
        self.orderly = OrderHandler(
            Service({"axis": self.axis}, ServicePaths(folder / "s", folder), False, self.said.append)
        )
        self.loop = Loop(job_from_stage.post(self.axis.setup, [self.axis.orders()]), Timeline())
        self.loop.axes[0].happen(Event.CONNECT)
        self.travel = setup.file.axis.travel_per_unit

    def serve(self, *asked: Coroutine[Any, Any, None]) -> list[BaseException | None]:
        """What became of the orders, given at once, after the axis was enabled."""

        async def go_on() -> None:
            while True:
                self.loop.period()
                self.axis.fill()
                await asyncio.sleep(0)

        async def all_of_it() -> list[BaseException | None]:
            going = asyncio.create_task(go_on())
            await asyncio.sleep(0)
            await self.orderly.enable([self.axis])
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
