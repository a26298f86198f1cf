"""A service that is not started: its axes have rings, and nobody writes into them but the test."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from stagectl.service.axis_controller import COLUMNS, AxisController
from stagectl.service.machine import machine
from stagectl.service.service import Service, ServicePaths
from tests.conftest import CONFIG

Write = Callable[..., None]


@pytest.fixture
def service(tmp_path: Path) -> Service:
    axes = machine([str(CONFIG / "ball-screw.yaml")], None)
    return Service(axes, ServicePaths(tmp_path / "control.sock", tmp_path / "state"), True, lambda _: None)


@pytest.fixture
def axis(service: Service) -> AxisController:
    return service.axes["axis"]


@pytest.fixture
def write(axis: AxisController) -> Write:
    """``write(count, error=...)``: rows whose numbers tell which they are; one column may be said."""

    def rows(count: int, **columns: Callable[[int], float]) -> None:
        for _ in range(count):
            number = axis.ring.written
            values = dict.fromkeys(COLUMNS, math.sin(number / 50.0))
            values |= {"time": (number + 1) * axis.setup.dt, "lateness": 15e-6}
            values |= {name: value(number) for name, value in columns.items()}
            axis.ring.write(tuple(values[name] for name in COLUMNS))

    return rows
