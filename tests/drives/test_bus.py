"""Frames over the embedded bus, over python-can, and the arithmetic of bus load."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest

from stagectl.drives.bus.can_plugin import EmbeddedBus
from stagectl.drives.bus.embedded import Embedded
from stagectl.drives.bus.frames import BusError, frame, parse
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.cycle_time import bus_load, frame_bits
from stagectl.runtime_folder import short_name


@pytest.fixture
def join(tmp_path: Path) -> Iterator[Callable[[], Embedded]]:
    """Participants of one embedded bus in `tmp_path`."""
    with contextlib.ExitStack() as stack:
        yield lambda: stack.enter_context(contextlib.closing(Embedded(str(tmp_path))))


def test_a_frame_is_the_kernels_can_frame() -> None:
    raw = frame(0x185, b"\x37\x02\x01")
    assert raw == b"\x85\x01\x00\x00\x03\x00\x00\x00\x37\x02\x01\x00\x00\x00\x00\x00"
    assert parse(raw) == (0x185, b"\x37\x02\x01")


@pytest.mark.parametrize(("length", "bits"), [(0, 55), (1, 65), (2, 75), (4, 95), (6, 115), (8, 135)])
def test_longest_frames_are_those_of_the_literature(length: int, bits: int) -> None:
    # Davis, Burns, Bril, Lukkien 2007: (55 + 10 s) bit times for a standard frame with s data bytes
    assert frame_bits(length) == bits


def test_bus_load_of_one_axis_at_2_khz() -> None:
    assert bus_load(2000.0, 1e6, (0, 8, 8)) == pytest.approx(0.65)  # 55 + 135 + 135 bits every 500 us


def test_everybody_hears_everybody_else_whoever_came_first(join: Callable[[], Embedded], tmp_path: Path) -> None:
    first, second, third = (join() for _ in range(3))
    second.send(frame(0x80))
    assert first.receive(1.0) == third.receive(1.0) == frame(0x80)
    assert second.receive(0.0) is None
    late = join()  # within the same tick of the file system's clock, or not
    first.send(frame(0x81))
    assert late.receive(1.0) == frame(0x81)
    for bus in (first, second, third, late):
        bus.close()
        bus.close()
    assert list(tmp_path.iterdir()) == []


def test_order_of_one_sender_is_kept_and_timeouts_are_kept(join: Callable[[], Embedded]) -> None:
    sender, reader = join(), join()
    for n in range(5):
        sender.send(frame(n))
    assert [parse(reader.receive(1.0) or b"")[0] for _ in range(5)] == [0, 1, 2, 3, 4]
    began = time.monotonic()
    assert reader.receive(0.02) is None
    assert 0.02 <= time.monotonic() - began < 1.0


def test_a_full_reader_loses_frames_and_blocks_nobody(join: Callable[[], Embedded]) -> None:
    sender, asleep, awake = (join() for _ in range(3))
    heard = 0
    for _ in range(2000):
        sender.send(frame(0x80))
        heard += awake.receive(1.0) is not None
    kept = 0
    while asleep.receive(0.0) is not None:
        kept += 1
    assert heard == 2000
    assert 0 < kept < 2000
    assert sender.lost == 2000 - kept


def test_a_killed_participant_is_cleared_away(join: Callable[[], Embedded], tmp_path: Path) -> None:
    program = f"from stagectl.drives.bus.embedded import Embedded; import os; Embedded({str(tmp_path)!r}); os._exit(0)"
    subprocess.run([sys.executable, "-c", program], check=True, env={**os.environ, "PYTHONPATH": os.getcwd()})
    assert len(list(tmp_path.iterdir())) == 1
    left = join()
    left.send(frame(0x80))
    assert [path.name for path in tmp_path.iterdir()] == [left._path.name]


def test_foreign_files_are_left_alone(join: Callable[[], Embedded], tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    join().send(frame(0x80))
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_what_is_no_frame_is_counted_and_dropped(join: Callable[[], Embedded]) -> None:
    bus = join()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as stranger, short_name(bus._path) as name:
        stranger.sendto(b"hello", name)
        stranger.sendto(b"x" * 40, name)
    assert bus.receive(0.1) is None
    assert bus.receive(0.1) is None
    assert bus.malformed == 2


def test_the_channel_belongs_to_this_user(runtime: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with contextlib.closing(Embedded("stage")) as bus:
        assert bus.folder == runtime / "stagectl" / "stage"
    assert bus.folder.stat().st_mode & 0o777 == 0o700
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    with pytest.raises(BusError, match="12345") as caught:
        Embedded("stage")
    assert caught.value.value not in (None, 12345)


@pytest.mark.parametrize("channel", ["", "../elsewhere", "a/b", ".hidden"])
def test_channel_names_stay_in_their_folder(channel: str) -> None:
    with pytest.raises(BusError, match="absolute") as caught:
        Embedded(channel)
    assert caught.value.place == channel


def test_a_channel_lies_as_deep_as_it_likes(tmp_path: Path) -> None:
    """Deeper than the 107 bytes of an AF_UNIX address."""
    deep = tmp_path / ("x" * 100)
    with contextlib.closing(Embedded(str(deep))) as first, contextlib.closing(Embedded(str(deep))) as second:
        first.send(frame(0x80))
        assert second.receive(1.0) == frame(0x80)
    assert list(deep.iterdir()) == []


def test_socketcan_names_the_fix_where_there_is_none() -> None:
    with pytest.raises(BusError, match=r"modprobe|nocan9"):
        open_bus("socketcan", "nocan9", 1e6)


def test_socketcan_binds_and_carries_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)  # stands in for the kernel's socket
    bound: list[object] = []

    class Raw:
        def bind(self, address: object) -> None:
            bound.append(address)

        def __getattr__(self, name: str) -> object:
            return getattr(ours, name)

    monkeypatch.setattr(socket, "socket", lambda *_: Raw())
    bus = open_bus("socketcan", "can0", 1e6)
    bus.send(frame(0x205, b"\x0f\x00"))
    assert (bound, theirs.recv(72)) == ([("can0",)], frame(0x205, b"\x0f\x00"))
    theirs.send(frame(0x185))
    assert bus.receive(1.0) == frame(0x185)
    bus.close()
    theirs.close()


def test_an_unknown_interface_is_an_error_that_names_it() -> None:
    with pytest.raises(BusError, match=r"can\.viewer") as caught:
        open_bus("no_such_thing", "x", 1e6)
    assert caught.value.place == "no_such_thing"


def test_an_interface_that_needs_more_than_we_know_is_an_error_that_names_it() -> None:
    with pytest.raises(BusError) as caught:
        open_bus("socketcand", "can0", 1e6)
    assert caught.value.place == "socketcand"


def test_any_interface_of_python_can_carries_our_frames() -> None:
    ours = open_bus("virtual", "bus-of-a-test", 1e6)
    with can.Bus(interface="virtual", channel="bus-of-a-test") as theirs:
        ours.send(frame(0x205, b"\x06\x00"))
        message = theirs.recv(1.0)
        assert message is not None
        assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (0x205, b"\x06\x00", False)
        theirs.send(can.Message(arbitration_id=0x185, data=b"\x21\x02", is_extended_id=False))
        assert ours.receive(1.0) == frame(0x185, b"\x21\x02")
        assert ours.receive(0.0) is None
    ours.close()


def test_python_can_joins_the_embedded_bus(join: Callable[[], Embedded], tmp_path: Path) -> None:
    ours = join()
    with EmbeddedBus(channel=str(tmp_path)) as theirs:
        ours.send(frame(0x123, b"abc"))
        message = theirs.recv(1.0)
        assert message is not None
        assert (message.arbitration_id, bytes(message.data)) == (0x123, b"abc")
        theirs.send(can.Message(arbitration_id=0x124, data=b"d", is_extended_id=False))
        assert ours.receive(1.0) == frame(0x124, b"d")
        theirs.set_filters([{"can_id": 0x200, "can_mask": 0x7FF}])
        ours.send(frame(0x201))
        ours.send(frame(0x200))
        filtered = theirs.recv(1.0)
        assert filtered is not None
        assert filtered.arbitration_id == 0x200
        with pytest.raises(can.CanOperationError, match="FD"):
            theirs.send(can.Message(is_fd=True))
    assert [path.name for path in tmp_path.iterdir()] == [ours._path.name]
    with pytest.raises(can.CanInitializationError, match="absolute"):
        EmbeddedBus(channel="a/b")


@pytest.mark.parametrize("error", [NameError("canOpen"), AttributeError("no library"), OSError("gone")])
def test_whatever_a_driver_of_python_can_raises_names_its_interface(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def absent(**_: object) -> None:
        raise error

    monkeypatch.setattr(can, "Bus", absent)
    with pytest.raises(BusError) as refused:
        open_bus("kvaser", "0", 1e6)
    assert refused.value.place == "kvaser"
