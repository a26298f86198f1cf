"""Orders that no real-time process will ever take: they are refused, not waited for."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

import pytest

from stagectl.realtime.shared_memory import Order, Status
from stagectl.realtime.states import Event, State
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.service.machine import machine
from stagectl.service.orders import OrderHandler
from stagectl.service.service import Service, ServicePaths
from tests.conftest import CONFIG


@pytest.fixture
def axis() -> AxisController:
    return machine([str(CONFIG / "ball-screw.yaml")], None)["axis"]


@pytest.fixture
def service(axis: AxisController, tmp_path: Path) -> Service:
    return Service({"axis": axis}, ServicePaths(tmp_path / "socket", tmp_path), False, lambda _: None)


def test_before_the_process_is_there(service: Service, axis: AxisController) -> None:
    with pytest.raises(ServiceError, match="is starting"):
        asyncio.run(service.order(axis, Order(Event.ENABLE)))
    assert axis.board.ordered == 0  # nor does the new process find it when it comes up


def test_the_process_dies_over_it(service: Service, axis: AxisController) -> None:
    axis.board.show(Status(state=State.DISABLED, tick=time.monotonic(), patience=1e6))

    async def died() -> None:
        order = asyncio.create_task(service.order(axis, Order(Event.ENABLE)))
        await asyncio.sleep(0.05)
        axis.begin()
        await asyncio.wait_for(order, 10.0)

    with pytest.raises(ServiceError, match="does not answer"):
        asyncio.run(died())


def test_gains_that_were_not_taken_are_not_kept(service: Service, axis: AxisController) -> None:
    before = axis.control, axis.controller
    with pytest.raises(ServiceError, match="is starting"):
        asyncio.run(OrderHandler(service).change("axis", {"bandwidth": "25 Hz"}))
    assert (axis.control, axis.controller) == before


def test_the_process_sets_up_the_drive_of_another_axis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It serves both: an axis without its drive shows nothing meanwhile, and its order waits."""
    monkeypatch.setattr("stagectl.service.service._ANSWER", 0.0)
    axes = {name: machine([str(CONFIG / "ball-screw.yaml")], None)["axis"] for name in "xy"}
    service = Service(axes, ServicePaths(tmp_path / "socket", tmp_path), False, lambda _: None)
    now = time.monotonic()
    axes["x"].board.show(Status(state=State.CONNECTING, tick=now, patience=1e6))
    axes["y"].board.show(Status(state=State.OFFLINE, tick=now - 10.0, patience=1.0))

    async def ordered() -> None:
        order = asyncio.create_task(service.order(axes["y"], Order(Event.CONNECT)))
        await asyncio.sleep(0.05)
        assert axes["y"].board.next_order() is not None
        axes["y"].board.answer(True)
        await asyncio.wait_for(order, 10.0)

    asyncio.run(ordered())
