"""What clients of a running service mistake, and what it answers; orders that go to the wrong place."""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, unix_connect

from stagectl.problem import ProblemKind
from stagectl.web.client import ControlError, RefusedError
from tests.conftest import CONFIG, Command
from tests.problems import refused
from tests.service.serving import Served, served

HANDSHAKE = (
    b"GET /v1/live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("mistakes")) as service:
        yield service


@contextlib.contextmanager
def live(machine: Served) -> Iterator[ClientConnection]:
    with unix_connect(str(machine.socket), uri="ws://localhost/v1/live", compression=None, max_size=None) as link:
        assert "machine" in json.loads(link.recv(timeout=60))  # before anything was said: no key is needed here
        yield link


def error(link: ClientConnection) -> str:
    """The next error that the service says."""
    while True:
        message = link.recv(timeout=60)
        if isinstance(message, str) and "error" in (answer := json.loads(message)):
            return str(answer["error"])


def refusal(machine: Served, method: str, what: str, **body: Any) -> str:
    with refused(RefusedError) as caught:
        machine.ask(method, what, **body)
    return str(caught.value)


def test_a_message_of_bytes_is_answered_as_any_other_that_is_none(machine: Served) -> None:
    with live(machine) as link:
        link.send(b"\x00\x01")
        assert "JSON" in error(link)
        link.send('{"strip": {"channels": ["banana"]}}')  # the connection goes on
        assert "banana" in error(link)
    assert "Traceback" not in machine.log


def test_a_live_connection_at_another_path_is_told_where_it_belongs(machine: Served) -> None:
    with pytest.raises(InvalidStatus) as caught:
        unix_connect(str(machine.socket), uri="ws://localhost/live")
    answer = caught.value.response
    assert answer.status_code == 404 and b"/v1/live" in answer.body


@pytest.mark.parametrize("size", [100_000, 5_000_000])
def test_a_message_that_is_too_large_is_read_to_its_end_and_answered_with_a_close_frame(
    machine: Served, size: int
) -> None:
    with socket.socket(socket.AF_UNIX) as link:
        link.settimeout(60.0)
        link.connect(str(machine.socket))
        link.sendall(HANDSHAKE)
        assert b" 101 " in link.recv(1 << 16)
        link.sendall(b"\x81\xff" + size.to_bytes(8, "big") + bytes(4) + bytes(size))  # all of it, before it reads
        heard = b""
        while (1009).to_bytes(2, "big") not in heard:
            heard += (more := link.recv(1 << 16))
            assert more


@pytest.mark.parametrize("first", ["hello", '{"banana": 1}', '{"scope": {"channels": ["banana"]}}'])
def test_the_first_message_on_the_unix_socket_is_answered(machine: Served, first: str) -> None:
    with live(machine) as link:
        link.send(first)
        words = error(link)
    assert "key is missing" not in words and ("JSON" in words or "banana" in words or "strip" in words)


def test_a_key_that_nobody_asks_for_is_no_mistake(machine: Served) -> None:
    with live(machine) as link:
        for message in ('{"key": "any"}', "{}", '{"hold": {"banana": 1}}'):
            link.send(message)
        assert "banana" in error(link)


def test_the_live_connection_is_there_and_no_request(machine: Served) -> None:
    assert "ws://" in refusal(machine, "GET", "live")


def test_a_body_that_is_missing_says_what_it_holds(machine: Served) -> None:
    assert "to, by, speed" in refusal(machine, "POST", "move")


def test_a_jog_that_was_refused_has_not_ended(machine: Served) -> None:
    machine.ask("POST", "disable")
    assert "measure" in refusal(machine, "POST", "jog", press=1001, speed="1 mm")
    assert "disabled" in refusal(machine, "POST", "jog", press=1001, speed="1 mm/s")
    machine.until(lambda _: "was refused" in refusal(machine, "POST", "jog", press=1001, speed="1 mm/s"))


def test_who_waits_for_a_motion_hears_that_an_order_stopped_it(machine: Served) -> None:
    machine.ask("POST", "enable")
    with ThreadPoolExecutor() as other:
        waiting = other.submit(refusal, machine, "POST", "move", by={"axis": "20 mm"}, speed="1 mm/s")
        machine.until(lambda axis: axis["state"] == "moving")
        machine.ask("POST", "stop")
        assert "an order stopped it" in waiting.result(timeout=60)


def test_a_motion_beyond_the_travel_is_told_in_places_of_the_stage_file(machine: Served) -> None:
    machine.ask("POST", "enable")
    machine.ask("POST", "move", to={"axis": "1 mm"})
    way = "type: sequence\nparts:\n- {type: trapezoid, distance: 60 mm, velocity: 10 mm/s, acceleration: 1 m/s^2}\n"
    words = refusal(machine, "POST", "trajectory", name="seq", yaml=way)
    assert "[-50, 50] mm" in words and "from 1 mm needs 61 mm" in words


def test_less_margin_than_the_stage_file_asks_for_is_noted(machine: Served, command: Command) -> None:
    code, _, err = command("parameters", "margin=5 deg", "--socket", machine.socket)
    assert code == 0 and "warning" in err and "5 deg" in err
    code, _, err = command("parameters", "margin=20 deg", "--socket", machine.socket)
    assert code == 0 and "warning" not in err


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
