"""What the servers of a service owe to whoever waits for them."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from stagectl.service.axis_controller import ServiceError
from stagectl.service.machine import machine
from stagectl.service.service import Service, ServicePaths
from stagectl.web import server
from tests.conftest import CONFIG


class Ending:
    """A server that ends by itself."""

    def __init__(self, why: Exception | None) -> None:
        self.why, self.should_exit, self.force_exit = why, False, False

    async def serve(self, sockets: Any) -> None:
        if self.why is not None:
            raise self.why


def test_an_address_of_another_computer_is_no_port_that_is_taken(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match=r"203.0.113.7 is no address of this computer: see `ip -brief address`"):
        server._port(server.Tcp("203.0.113.7", 8402, tmp_path / "token", False))


@pytest.mark.parametrize(("why", "token"), [(OSError("no more files"), "no more files"), (None, "ended by itself")])
def test_a_server_that_ends_does_not_end_the_service_in_silence(
    tmp_path: Path, why: Exception | None, token: str
) -> None:
    axes = machine([str(CONFIG / "ball-screw.yaml")], None)
    service = Service(axes, ServicePaths(tmp_path / "control.sock", tmp_path / "state"), True, lambda _: None)

    async def served() -> None:
        service.watch = asyncio.Event().wait  # type: ignore[method-assign, assignment]
        await server._until_stopped(service, [(Ending(why), [])], asyncio.Event())  # type: ignore[list-item]

    with pytest.raises((OSError, ServiceError), match=token):
        asyncio.run(served())
