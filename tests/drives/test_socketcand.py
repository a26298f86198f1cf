"""CANopen through a small socketcand server: text over TCP, frames on a bus of the test."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator

import pytest

from stagectl.drives.bus.frames import frame, parse
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.drive import Fault
from tests.drives.workbench import DT, STEP, Workbench, enabled, stopped


class Server:
    """One client: a handshake, then frames both ways."""

    def __init__(self, bench: Workbench) -> None:
        self._bus = bench.bus()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.channel = f"can0@127.0.0.1:{self._listening.getsockname()[1]}"
        self.greeting: list[bytes] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self._listening.close()

    def _run(self) -> None:
        line, _ = self._listening.accept()
        with line:
            line.sendall(b"< hi >")
            for _ in range(2):
                self.greeting.append(line.recv(100))
                line.sendall(b"< ok >")
            time.sleep(0.1)  # python-can takes what comes with the answer for a part of it
            line.setblocking(False)
            with contextlib.suppress(ConnectionError):
                self._carry(line)

    def _carry(self, line: socket.socket) -> None:
        text = b""
        while not self._over.is_set():
            raw = self._bus.receive(0.0005)
            if raw is not None:
                identifier, data = parse(raw)
                line.sendall(f"< frame {identifier:X} 1.000000 {data.hex()} >".encode())
            with contextlib.suppress(BlockingIOError):
                text += line.recv(4096)
            *orders, text = text.split(b">")
            for order in orders:
                _, _, node, length, *sent = order.decode().split()
                assert int(length, 16) == len(sent)
                self._bus.send(frame(int(node, 16), bytes(int(byte, 16) for byte in sent)))


@pytest.fixture
def server(bench: Workbench) -> Iterator[Server]:
    made = Server(bench)
    yield made
    made.close()


def test_a_drive_moves_and_stops_over_the_network(bench: Workbench, server: Server) -> None:
    node = bench.running("sync")
    settings = bench.settings()._replace(interface="socketcand", channel=server.channel)
    drive = CanopenDrive(Wishes(settings, STEP, DT), open_bus(settings.interface, settings.channel, settings.bitrate))
    assert server.greeting == [b"< open can0 >", b"< rawmode >"]
    assert enabled(drive).fault is Fault.NONE
    for _ in range(40):
        drive.apply(1.0)
        assert drive.sample().fault is Fault.NONE
    assert node.axis.plant.state.velocity > 0.05
    stopped(drive)
    drive.close()
