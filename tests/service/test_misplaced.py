"""Orders that go to the wrong place: another machine's drive, a socket that is gone, a file that is no socket."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.problem import ProblemKind
from stagectl.web.client import ControlError
from tests.conftest import CONFIG, Command
from tests.problems import refused
from tests.service.serving import Served, served


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("misplaced")) as service:
        yield service


def test_a_fault_is_for_the_drive_of_its_stage_alone(machine: Served, command: Command) -> None:
    bus = ["--channel", machine.folder / "bus"]
    code, out, err = command("inject", f"{CONFIG / 'xy.yaml'}#x", "encoder-stuck", "duration=1ms", *bus)
    assert (code, out) == (2, "")
    assert "ball-screw stage A" in err
    assert command("inject", machine.stage, "--clear", *bus)[0] == 0


def test_a_service_that_has_lost_its_control_socket_is_not_taken_for_none(machine: Served) -> None:
    aside = machine.socket.with_name("aside")
    machine.socket.rename(aside)
    try:
        with refused(ControlError, kind=ProblemKind.CONFLICT, file=machine.socket):
            machine.ask("GET", "status")
    finally:
        aside.rename(machine.socket)
    assert machine.axis()


def test_a_file_is_no_control_socket(machine: Served, tmp_path: Path) -> None:
    mine = tmp_path / "notes.yaml"
    mine.write_text("mine")
    machine.socket, whole = mine, machine.socket
    try:
        with refused(ControlError, kind=ProblemKind.FILE, file=mine):
            machine.ask("GET", "status")
    finally:
        machine.socket = whole
