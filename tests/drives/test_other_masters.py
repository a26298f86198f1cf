"""One master a channel: a lock on this computer, and listening before anything is sent."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.drives.bus.embedded import Embedded
from stagectl.drives.bus.frames import BusError, frame
from stagectl.drives.bus.other_masters import ChannelLock, OtherMasterError, holder, listen, lock_path
from stagectl.drives.drive import Canopen, DriveError, Odrive
from tests.drives.workbench import Workbench, canopen_settings

_HOLDS = """\
import sys, time
from stagectl.drives.bus.other_masters import ChannelLock
from tests.drives.workbench import canopen_settings
lock = ChannelLock(canopen_settings(sys.argv[1]), "bench")
print("held", flush=True)
time.sleep(600)
"""


@pytest.fixture
def wire(bench: Workbench) -> Canopen:
    return bench.settings()


@contextlib.contextmanager
def held(channel: str) -> Iterator[subprocess.Popen[str]]:
    """Another process that has the channel."""
    process = subprocess.Popen([sys.executable, "-c", _HOLDS, channel], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.communicate()


@contextlib.contextmanager
def sending(channel: str, raw: bytes, period: float) -> Iterator[None]:
    """Somebody who sends this frame all the time."""
    over, bus = threading.Event(), Embedded(channel)

    def send() -> None:
        while not over.wait(period):
            bus.send(raw)

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        bus.close()


def refused(wire: Canopen, bus: Embedded) -> OtherMasterError:
    with pytest.raises(OtherMasterError) as caught:
        listen(wire, bus)
    return caught.value


def test_the_refusal_names_the_process_that_has_the_channel(wire: Canopen) -> None:
    with held(wire.channel) as process:
        with pytest.raises(OtherMasterError) as caught:
            ChannelLock(wire, "other")
        error, other = caught.value, holder(wire)
    assert (error.pid, error.place, error.node, error.value) == (process.pid, wire.channel, wire.node, "bench")
    assert abs(time.mktime(time.strptime(error.since, "%Y-%m-%d %H:%M:%S")) - time.time()) < 120.0
    assert "-c" in error.command
    assert other == (process.pid, error.command, "bench", error.since)
    assert "wiring" not in str(error)
    assert str(process.pid) in str(error)


def test_a_killed_holder_leaves_the_channel_free(wire: Canopen) -> None:
    with held(wire.channel) as process:
        process.kill()
        process.wait()
        assert lock_path(wire).exists()
        ChannelLock(wire, "next").release()
    assert holder(wire) is None


def test_a_lock_is_not_taken_twice_and_is_free_after_its_release(wire: Canopen) -> None:
    first = ChannelLock(wire, "one")
    with pytest.raises(OtherMasterError) as caught:
        ChannelLock(wire, "two")
    assert caught.value.pid == os.getpid()
    first.release()
    first.release()
    assert holder(wire) is None


def test_what_a_holder_says_of_itself_is_not_believed(wire: Canopen) -> None:
    with held(wire.channel):
        for text in ("", "[]", '{"pid": "x"}', json.dumps({"pid": 1, "command": "a\x1b[2Jb", "stage": 7, "since": ""})):
            lock_path(wire).write_text(text)
            with pytest.raises(OtherMasterError) as caught:
                ChannelLock(wire, "other")
            assert "\x1b" not in str(caught.value)
    assert caught.value.pid == 1


def test_a_link_in_the_place_of_the_lock_is_not_followed(wire: Canopen, tmp_path: Path) -> None:
    target = tmp_path / "precious"
    target.write_text("mine")
    lock_path(wire).symlink_to(target)
    with pytest.raises(DriveError) as caught:
        ChannelLock(wire, "bench")
    assert caught.value.place == str(lock_path(wire))
    assert target.read_text() == "mine"


def test_each_channel_has_a_lock_of_its_own(tmp_path: Path) -> None:
    real = canopen_settings("can0", interface="socketcan")
    other = canopen_settings("can1", interface="socketcan")
    port, link = tmp_path / "tty", tmp_path / "by-id"
    port.touch()
    link.symlink_to(port)
    serial = canopen_settings(str(link), interface="slcan")
    assert lock_path(real) != lock_path(other)
    assert lock_path(real) == lock_path(canopen_settings("can0", interface="socketcan", node=6))
    assert lock_path(Odrive(str(port), 0.1)) == lock_path(Odrive(str(link), 0.1)) == lock_path(serial)


@pytest.mark.parametrize(
    ("identifier", "data", "kind"),
    [(0x080, b"", "SYNC"), (0x405, bytes(8), "RPDO"), (0x205, bytes(4), "RPDO"), (0x77F, b"\5", "heartbeat")],
)
def test_another_master_is_heard(bench: Workbench, wire: Canopen, identifier: int, data: bytes, kind: str) -> None:
    with sending(bench.channel, frame(identifier, data), 0.01):
        error = refused(wire, bench.bus())
    assert kind in str(error.value)
    assert 5 < error.frames <= 31
    assert error.period is not None
    assert 0.009 < error.period < 0.05
    assert (error.pid, error.node, error.place) == (None, wire.node, wire.channel)
    assert "wiring" not in str(error)


@pytest.mark.parametrize(
    ("identifier", "data"), [(0x185, bytes(8)), (0x705, b"\5"), (0x206, bytes(4)), (0x085, bytes(8)), (0x585, bytes(8))]
)
def test_drives_are_no_masters(bench: Workbench, wire: Canopen, identifier: int, data: bytes) -> None:
    with sending(bench.channel, frame(identifier, data), 0.01):
        listen(wire, bench.bus())


def test_a_slow_master_is_heard(bench: Workbench, wire: Canopen) -> None:
    with sending(bench.channel, frame(0x080), 0.05):
        assert refused(wire, bench.bus()).frames >= 2


def test_a_flooded_bus_ends_the_listening(wire: Canopen) -> None:
    class Flood:
        def receive(self, timeout: float) -> bytes:
            return frame(0x185, bytes(8))

    begun = time.monotonic()
    listen(wire, Flood())  # type: ignore[arg-type]
    assert time.monotonic() - begun < 2.0


def test_a_foreign_master_is_heard(bench: Workbench, wire: Canopen) -> None:
    """One made with the stock library, which knows nothing of our lock."""
    import canopen

    network = canopen.Network()
    network.connect(interface="stagectl", channel=bench.channel)
    network.sync.start(0.002)
    try:
        error = refused(wire, bench.bus())
    finally:
        network.sync.stop()
        network.disconnect()
    assert error.value == "SYNC"
    assert error.frames > 9
    assert error.period is not None
    assert 0.0015 < error.period < 0.03


def test_ordinary_files_among_the_sockets_stay(bench: Workbench) -> None:
    """An entry that is no socket is no participant: a frame does not remove it."""
    bus = bench.bus()
    plain, link = bus.folder / "notes.can", bus.folder / "link.can"
    plain.write_text("mine")
    link.symlink_to(plain)
    bus.send(frame(0x080))
    assert plain.read_text() == "mine"
    assert link.is_symlink()


def test_a_folder_of_somebody_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BusError):
        lock_path(canopen_settings("a/b"))
