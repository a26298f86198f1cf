"""The zoo itself: another hand, a row for each kind, and drives that a stock master can set up, move and lose."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import canopen
import pytest

from tests.conftest import ROOT
from tests.zoo.bench import drive, until
from tests.zoo.diary import Diary
from tests.zoo.stage import NODE, write
from tests.zoo.table import EVERY, ROWS
from tests.zoo.variants import VARIANTS, named

MASTER = 100
PROGRAM = """
import sys, tests.zoo.node, tests.zoo.stage
print([name for name in sys.modules if name.startswith(("stagectl.drives.canopen", "stagectl.drives.virtual"))])
"""


def test_another_hand_wrote_it() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "[]", done.stderr


def test_each_kind_has_a_row() -> None:
    assert {row.variant for row in ROWS} == set(VARIANTS)
    assert len(VARIANTS) >= 25
    assert len(EVERY) > len(ROWS)  # and those that lack one object


class StockMaster:
    """The other end, of the stock library alone."""

    def __init__(self, channel: Path, eds: Path) -> None:
        self.network = canopen.Network()
        self.network.connect(interface="stagectl", channel=str(channel))
        self.node = self.network.add_node(NODE, str(eds))
        self.node.sdo.RESPONSE_TIMEOUT = 20.0  # the machine is shared

    def supervise(self) -> None:
        """By our heartbeat."""
        self.node.sdo[0x1016][1].raw = MASTER << 16 | 500
        self._beat = self.network.send_periodic(0x700 + MASTER, b"\x05", 0.05)

    def order(self, controlword: int, statusword: int) -> None:
        """Write the controlword, and wait for the state."""
        self.node.sdo[0x6040].raw = controlword
        until(lambda: self.node.sdo[0x6041].raw & 0x6F == statusword, lambda: hex(self.node.sdo[0x6041].raw))

    def enable(self) -> None:
        """In torque mode, without torque."""
        self.node.sdo[0x6060].raw = 10
        for controlword, statusword in ((6, 0x21), (7, 0x23), (15, 0x27)):
            self.order(controlword, statusword)

    def die(self) -> None:
        """Fall silent."""
        self._beat.stop()


@pytest.fixture
def bus(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[tuple[StockMaster, Diary]]:
    """A drive of the kind in the test's parameter, and its master."""
    kind = request.param
    files = write(tmp_path, named(kind))
    with drive(kind, files) as diary:
        until(lambda: bool(diary.lines("boot")))
        master = StockMaster(files.bus, tmp_path / "zoo.eds")
        yield master, diary
        master.network.disconnect()


@pytest.mark.parametrize("bus", ["plain", "mode-display-enabled", "fixed-map"], indirect=True)
def test_a_stock_master_moves_it_and_its_death_stops_it(bus: tuple[StockMaster, Diary]) -> None:
    master, diary = bus
    master.supervise()
    master.enable()
    assert master.node.sdo[0x6061].raw == 10
    master.node.sdo[0x6071].raw = 150  # per mille of 5 A: a little more than friction
    until(lambda: diary.moved() > 1e-3, lambda: diary.last)
    assert diary.last["monitors"] == [f"heartbeat {MASTER}"]
    master.die()
    until(diary.stands, lambda: diary.last)
    (lost,) = diary.lines("lost")
    assert (lost["monitor"], lost["option"]) == (f"heartbeat {MASTER}", 1)
    assert diary.lines("state")[-1]["state"] == "fault"
    assert [line["code"] for line in diary.lines("emergency")] == ["0x8130"]


@pytest.mark.parametrize("bus", ["abort-connection-0-fixed", "unsupervised"], indirect=True)
def test_a_drive_without_protection_goes_on(bus: tuple[StockMaster, Diary]) -> None:
    """The danger of issue 19, row 1: here it is real."""
    master, diary = bus
    master.enable()
    master.node.sdo[0x6071].raw = 200
    until(lambda: diary.moved() > 5e-3, lambda: diary.last)
    assert diary.unsupervised() > 0.0
    master.order(0, 0x40)
    until(diary.stands, lambda: diary.last)


@pytest.mark.parametrize("bus", ["fault-reset-hold"], indirect=True)
def test_a_short_reset_pulse_is_not_enough(bus: tuple[StockMaster, Diary]) -> None:
    master, diary = bus
    for controlword in (0x80, 0x00):
        master.network.send_message(0x600 + NODE, bytes([0x2B, 0x40, 0x60, 0, controlword, 0, 0, 0]))
    until(lambda: master.node.sdo.responses.qsize() == 2, "the writes are not confirmed")  # not taken for the next
    assert master.node.sdo[0x6041].raw & 0x4F == 0x08
    master.order(0x80, 0x40)
    assert diary.lines("state")[-1]["why"] == "fault reset"


@pytest.mark.parametrize("bus", ["plain"], indirect=True)
def test_the_map_follows_the_standard(bus: tuple[StockMaster, Diary]) -> None:
    """CiA 301: not while the PDO exists, not while it counts entries, not with an object that cannot be mapped."""
    master, _ = bus
    sdo = master.node.sdo
    with pytest.raises(canopen.SdoAbortedError, match="0x08000022"):
        sdo[0x1600][0].raw = 0
    sdo[0x1400][1].raw = 0x8000_0200 + NODE
    with pytest.raises(canopen.SdoAbortedError, match="0x08000022"):
        sdo[0x1600][1].raw = 0x6040_0010
    sdo[0x1600][0].raw = 0
    with pytest.raises(canopen.SdoAbortedError, match="0x06040041"):
        sdo[0x1600][1].raw = 0x6085_0020
    sdo[0x1600][1].raw = 0x6071_0010
    sdo[0x1600][0].raw = 1
    assert sdo[0x1600][0].raw == 1
