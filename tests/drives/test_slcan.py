"""CANopen over a serial line: an adapter behind a pty, and what the configuration refuses."""

from __future__ import annotations

import os
import threading
import tty
from collections.abc import Iterator

import pytest

from stagectl.drives import cycle_time
from stagectl.drives.bus.frames import frame, parse
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.cia402 import state as state_of
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.drive import Fault
from tests.drives.workbench import DT, STEP, Workbench, enabled, stopped


class Adapter:
    """A stand-in for an slcan adapter: text on a pty, frames on a bus of the test."""

    def __init__(self, bench: Workbench) -> None:
        self._bus = bench.bus()
        self._line, child = os.openpty()
        tty.setraw(child)
        os.set_blocking(self._line, False)
        self.port, self._child = os.ttyname(child), child
        self._over, self._text = threading.Event(), b""
        self.reports: list[bytes] = []
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        os.close(self._line)
        os.close(self._child)

    def _run(self) -> None:
        while not self._over.is_set():
            raw = self._bus.receive(0.0005)
            if raw is not None:
                identifier, data = parse(raw)
                os.write(self._line, f"t{identifier:03X}{len(data)}{data.hex().upper()}\r".encode())
            try:
                self._text += os.read(self._line, 4096)
            except BlockingIOError:
                continue
            *lines, self._text = self._text.split(b"\r")
            for line in lines:
                self._obey(line)

    def _obey(self, line: bytes) -> None:
        self.reports.append(line)
        if line[:1] == b"t":
            self._bus.send(frame(int(line[1:4], 16), bytes.fromhex(line[5:].decode())))
            os.write(self._line, b"z\r")
        else:
            os.write(self._line, b"\r")


@pytest.fixture
def adapter(bench: Workbench) -> Iterator[Adapter]:
    made = Adapter(bench)
    yield made
    made.close()


def test_a_drive_moves_and_stops_over_the_line(bench: Workbench, adapter: Adapter) -> None:
    node = bench.running("sync")
    settings = bench.settings()._replace(interface="slcan", channel=f"{adapter.port}@3000000")
    bus = open_bus(settings.interface, settings.channel, settings.bitrate)
    drive = CanopenDrive(Wishes(settings, STEP, DT), bus)
    assert adapter.reports.index(b"S8") < adapter.reports.index(b"O")  # 1 Mbit/s, then open
    assert enabled(drive).fault is Fault.NONE
    for _ in range(40):
        drive.apply(1.0)
        assert drive.sample().fault is Fault.NONE
    assert node.axis.plant.state.velocity > 0.05
    assert state_of(stopped(drive).statusword) is DriveState.SWITCH_ON_DISABLED
    drive.close()
    assert abs(node.axis.plant.state.velocity) < 1e-3


def test_the_time_of_a_cycle_is_that_of_its_characters() -> None:
    # t0800<CR>, twice t18n8 and 16 digits, two acknowledgements z<CR>: 6 + 22 + 22 + 4 characters of ten bits
    frames = len(b"t0800\r") + 2 * len(b"t1858" + b"0" * 16 + b"\r")
    assert frames + 2 * len(b"z\r") == cycle_time.SLCAN_CHARACTERS == 54
    assert cycle_time.slcan_cycle(115200.0, 1e6) == pytest.approx(54 * 10 / 115200 + (55 + 135 + 135) * 1e-6)
    channels = ("/dev/ttyUSB0", "/dev/ttyACM0@3000000", "COM3@fast")
    assert [cycle_time.slcan_baud(channel) for channel in channels] == [115200.0, 3e6, 0.0]
