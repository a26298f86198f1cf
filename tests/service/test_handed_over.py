"""A TCP port that systemd opens and hands to the service, by systemd's own tool for it."""

from __future__ import annotations

import http.client
import shutil
from pathlib import Path

import pytest

from tests.service.serving import Served, free_port

ACTIVATE = "systemd-socket-activate"


class Activated(Served):
    """A service that is started by the first connection to its port."""

    @property
    def command(self) -> list[str]:
        return [ACTIVATE, "--listen", self.arguments[-1], *super().command]


def _asked(port: int) -> int:
    link = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    link.request("GET", "/v1/status")
    status = link.getresponse().status
    link.close()
    return status


@pytest.mark.skipif(shutil.which(ACTIVATE) is None, reason=f"{ACTIVATE} is not installed")
def test_the_port_that_systemd_opened_is_served(tmp_path: Path) -> None:
    port = free_port()
    machine = Activated(tmp_path, "--tcp", f"127.0.0.1:{port}")
    try:
        machine.start_drive()
        machine.start(lambda: _asked(port))
        assert _asked(port) == 401  # no token; a port of its own could not have been opened beside systemd's
        assert machine.axis()["state"] == "disabled"
    finally:
        machine.end()
