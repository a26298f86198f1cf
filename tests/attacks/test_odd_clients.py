"""Clients that send what no honest program sends: each is refused, and nothing of it stays."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import socket
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from stagectl.service.limits import CLOSE_TIME
from stagectl.service.stop_link import STATUS, StopLink, beside
from stagectl.web.client import ControlError, _UnixConnection
from stagectl.web.limits import KEY_TIME
from tests.service.serving import Served, free_port, served, within

PORT = free_port()
PATIENCE = 60.0  # s: the machine is shared
GROWTH = 16 << 20  # bytes that the service may grow by under a flood of 32 MB
FLOOD = 32 << 20  # bytes
FIGHT = 2.0  # s
SINE = "{type: sine, amplitude: %s, frequency: %s, periods: %s}"
HEADING = "time_s,reference_mm\n"
DEEP, LONG = "[" * 16000, "9" * 5000
ODD_BODIES = [
    ("recordings", '{"before": 1e400}'),
    ("recordings", '{"before": NaN}'),
    ("recordings", f'{{"seconds": {LONG}}}'),
    ("recordings", '{"name": "../../x"}'),
    ("recordings", '{"name": "a\\u0000b"}'),
    ("recordings", '{"name": "\\ud800"}'),
    ("recordings", DEEP),
    ("move", '{"to": {"axis": "1e308 mm"}}'),
    ("move", '{"to": {"axis": "nan mm"}}'),
    ("move", '{"by": {"axis": "1 mm"}, "speed": "1e-320 mm/s"}'),
    ("move", '{"by": {"axis": "1 mm"}, "acceleration": "1e-308 mm/s^2"}'),
    ("move", f'{{"by": {{"axis": "{LONG[:70]} mm"}}}}'),
    ("move", '{"by": {"\\ud800": "1 mm"}}'),
    *(
        ("trajectory", json.dumps({"yaml": yaml}))
        for yaml in (
            SINE % ("1e308 mm", "1 Hz", "2"), SINE % (".nan mm", "1 Hz", "2"), SINE % ("1 mm", "1e308 Hz", "2"),
            SINE % ("1 mm", "1e-308 Hz", "1"), SINE % ("1 mm", "1 Hz", "1e308"), SINE % ("1 mm", "1 Hz", LONG),
            "&a [*a]", DEEP[:5000], "? " * 5000, "{type: [1, 2]}", "{type: csv, file: /etc/passwd}",
        )
    ),
    *(
        ("trajectory", json.dumps({"yaml": "{type: csv, file: a.csv}", "tables": {"a.csv": HEADING + rows}}))
        for rows in (
            "0,0\n1,nan\n", "0,0\n1e308,1\n", "0,0\n1e-320,1\n", "nan,0\nnan,0\n", "0,0\n1,1e308\n", f"0,0\n1,{LONG}\n",
        )
    ),
]  # fmt: skip


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("odd"), "--tcp", f"127.0.0.1:{PORT}") as target:
        target.ask("POST", "enable")
        yield target


def answer(machine: Served, what: str, body: str) -> tuple[int, str]:
    link = _UnixConnection(machine.socket, PATIENCE)
    link.request("POST", f"/v1/{what}", body, {"Content-Type": "application/json"})
    with contextlib.closing(link), link.getresponse() as heard:
        return heard.status, heard.read().decode()


@pytest.mark.parametrize(("what", "body"), ODD_BODIES, ids=range(len(ODD_BODIES)))
def test_numbers_and_texts_beyond_reason_are_refused(machine: Served, what: str, body: str) -> None:
    before = machine.heard()["reference"]
    status, words = answer(machine, what, body)
    assert 400 <= status < 500, words
    assert "died" not in words and "/etc" not in words.replace("/etc/passwd", "")
    assert machine.heard()["reference"] == before
    assert "Traceback" not in machine.log


def test_the_next_honest_order_is_carried_out(machine: Served) -> None:
    """What cannot be planned does not cost the next one its turn."""
    answer(machine, "move", '{"by": {"axis": "1 mm"}, "speed": "1e-320 mm/s"}')
    machine.ask("POST", "move", by={"axis": "1 mm"}, speed="5 mm/s")
    assert machine.axis()["in_position"]


def frame(opcode: int, data: bytes, final: bool = True) -> bytes:
    """A masked WebSocket frame (RFC 6455)."""
    length = bytes([0x80 | len(data)]) if len(data) < 126 else b"\xfe" + struct.pack(">H", len(data))
    return bytes([final << 7 | opcode]) + length + bytes(4) + data


def live() -> socket.socket:
    """A live connection that has shown no key yet."""
    link = socket.create_connection(("127.0.0.1", PORT), timeout=PATIENCE)
    key = base64.b64encode(os.urandom(16)).decode()
    head = f"GET /v1/live HTTP/1.1\r\nHost: 127.0.0.1:{PORT}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    link.sendall(f"{head}Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
    assert b"101" in link.recv(1000)
    return link


def memory(machine: Served) -> int:
    """Bytes of the service's memory."""
    assert machine.process is not None
    return int(Path(f"/proc/{machine.process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_a_flood_of_pings_whose_answers_nobody_reads_takes_no_memory(machine: Served) -> None:
    token = (machine.folder / "state" / "token").read_text().strip()
    held, pings, sent = memory(machine), frame(9, b"x" * 125) * 500, 0
    with live() as link:
        link.sendall(frame(1, json.dumps({"key": token}).encode()))
        while sent < FLOOD:
            sent += link.send(pings)
        assert memory(machine) - held < GROWTH
    assert "Traceback" not in machine.log


HALF = frame(1, b"{" * 1000)[:6]  # announces a message of 1000 bytes that does not come


@pytest.mark.parametrize("first", [b"", frame(1, b"{", final=False), HALF], ids=["silent", "fragments", "half"])
def test_a_live_connection_without_a_key_ends_by_itself(machine: Served, first: bytes) -> None:
    """Whether the client agrees to the end or not."""
    with live() as link:
        began = time.monotonic()
        link.sendall(first)
        with contextlib.suppress(ConnectionError):
            while link.recv(1000):
                pass
        assert time.monotonic() - began < 2.0 * (KEY_TIME + CLOSE_TIME)


def test_links_and_pipes_are_no_recordings(machine: Served) -> None:
    """Whoever can write to the folder cannot let the service hand out, or wait for, another file."""
    folder = machine.folder / "state" / "recordings" / "axis"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "link.h5").symlink_to(machine.folder / "state" / "key")
    os.mkfifo(folder / "pipe.h5")
    listed = [entry["file"] for entry in machine.ask("GET", "recordings")]
    assert not {"link.h5", "pipe.h5"} & set(listed)
    for name in ("link.h5", "pipe.h5"):
        with pytest.raises(ControlError, match="no recording"):
            machine.ask("GET", f"recordings/recordings/axis/{name}")


def test_a_flood_of_headers_delays_no_stop(machine: Served) -> None:
    flood = b"GET /v1/status HTTP/1.1\r\nHost: x\r\n" + b"a:b\r\n" * 9000 + b"\r\n"
    end, slowest = time.monotonic() + FIGHT, 0.0

    def send() -> None:
        while time.monotonic() < end:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", PORT), timeout=5.0) as link:
                link.sendall(flood)
                link.recv(100)

    senders = [threading.Thread(target=send) for _ in range(8)]
    for sender in senders:
        sender.start()
    link = StopLink(beside(machine.socket))
    while time.monotonic() < end:
        began = time.monotonic()
        link.ask(STATUS, "", 5.0)
        slowest = max(slowest, time.monotonic() - began)
    link.close()
    for sender in senders:
        sender.join()
    assert slowest < 1.0  # the machine is shared; `tools/bench/stops.py` measures
    assert "Traceback" not in machine.log


def test_owners_that_fight_end_in_one_clear_state(machine: Served) -> None:
    """Each order is carried out or refused with words; a quick stop afterwards has the last word."""
    move: dict[str, Any] = {"speed": "5 mm/s", "wait": False}
    parties: list[list[tuple[str, dict[str, Any]]]] = [
        [("enable", {}), ("move", {"by": {"axis": "1 mm"}, **move}), ("stop", {})],
        [("enable", {}), ("move", {"by": {"axis": "-1 mm"}, **move}), ("disable", {})],
        [("quick-stop", {}), ("enable", {}), ("trajectory", {"yaml": SINE % ("1 mm", "1 Hz", "1"), "wait": False})],
        [("home", {}), ("faults/reset", {})],
    ]
    end = time.monotonic() + FIGHT

    def fight(orders: list[tuple[str, dict[str, Any]]]) -> None:
        while time.monotonic() < end:
            for what, body in orders:
                with contextlib.suppress(ControlError):
                    machine.ask("POST", what, **body)

    fighters = [threading.Thread(target=fight, args=(orders,)) for orders in parties]
    for fighter in fighters:
        fighter.start()
    for fighter in fighters:
        fighter.join()
    machine.ask("POST", "quick-stop")
    assert within(PATIENCE, lambda: machine.axis()["state"] == "disabled"), machine.axis()
    assert machine.axis()["faults"] == 0
    assert "Traceback" not in machine.log
