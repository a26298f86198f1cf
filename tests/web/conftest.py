"""A service that is not started: its axes have rings, and nobody writes into them but the test."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from stagectl.service.axis_controller import COLUMNS, AxisController
from stagectl.service.machine import machine
from stagectl.service.service import Service, ServicePaths
from tests.conftest import CONFIG

Write = Callable[..., None]


class Answer(NamedTuple):
    """What the interface answers."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def error(self) -> str:
        return str(json.loads(self.body)["error"])


def answered(app: Any, method: str, address: str, body: bytes = b"", **headers: str) -> Answer:
    """The answer of the interface itself, without a server."""
    sent: list[dict[str, Any]] = []
    path, _, query = address.partition("?")
    named = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": "http", "method": method, "path": path, "query_string": query.encode(), "headers": named}

    async def receive() -> dict[str, Any]:
        if asked:
            return asked.pop()
        await asyncio.sleep(60.0)  # the client waits
        return {"type": "http.disconnect"}

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    asked = [{"type": "http.request", "body": body, "more_body": False}]
    asyncio.run(app({**scope, "server": ("localhost", 80)}, receive, send))
    about = {name.decode(): value.decode() for name, value in sent[0]["headers"]}
    return Answer(sent[0]["status"], about, b"".join(message["body"] for message in sent[1:]))


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
