"""What the tests on vcan0 share; each says why it is left out where there is none."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.vm.bench import CHANNEL, GUEST, Traced, stage_file, traced
from tests.vm.installed import PORT, Installed


def _no_can() -> str:
    """Why there is no vcan0 here; made where root may, empty where there is one."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return f"this kernel has no CAN ({error.strerror}): `python tools/vm` brings one that has"
    if not Path(f"/sys/class/net/{CHANNEL}").exists():
        make = f"ip link add {CHANNEL} type vcan && ip link set {CHANNEL} up"
        if os.geteuid() != 0 or subprocess.run(make, shell=True, check=False, capture_output=True).returncode != 0:
            return f"no {CHANNEL}: sudo sh -c '{make}'"
    return ""


@pytest.fixture(scope="session")
def vcan() -> str:
    """Name of a virtual CAN interface that is up."""
    reason = _no_can()
    if reason:
        pytest.skip(reason)
    return CHANNEL


@pytest.fixture(scope="session")
def guest(vcan: str) -> None:
    """For what changes the machine that it runs on, or asserts its times."""
    if not GUEST:
        pytest.skip("changes the system it runs on: `python tools/vm` runs it in a machine of its own")


@pytest.fixture(scope="session")
def drive(guest: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Traced]:
    folder = tmp_path_factory.mktemp("drive")
    with traced(stage_file(folder), folder) as virtual:
        yield virtual


@pytest.fixture(scope="session")
def machine(drive: Traced) -> Iterator[Installed]:
    """The service as `stagectl service install` leaves it, on the drive of `drive`."""
    place = Path("/etc/stagectl")
    place.mkdir(exist_ok=True)
    service = Installed(stage_file(place))
    service.verb("service", "install", str(service.stage), "--tcp", PORT)
    service.until(lambda axis: axis["state"] == "disabled")
    yield service
    with contextlib.suppress(Exception):
        drive.clear()
