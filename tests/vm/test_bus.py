"""Our frames on the kernel's CAN, against can-utils: candump, cansend, canplayer."""

from __future__ import annotations

import contextlib
import random
import re
import shutil
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from stagectl.drives.bus.frames import EXTENDED, REMOTE, frame, parse
from stagectl.drives.bus.interfaces import SocketCan
from stagectl.recording.hdf5 import open_recording
from tests.vm.bench import NODE, ROOT, stage_file, traced

TPDO = 0x180 + NODE
MOTION = "type: sine\namplitude: 2 um\nfrequency: 5 Hz\nperiods: 3\nramp: 1\n"


@pytest.fixture(autouse=True)
def can_utils(vcan: str) -> None:
    if shutil.which("candump") is None:
        pytest.skip("candump is not installed: apt-get install can-utils")


@pytest.fixture
def bus(vcan: str) -> Iterator[SocketCan]:
    with contextlib.closing(SocketCan(vcan)) as wire:
        yield wire


@contextlib.contextmanager
def candump(*options: str) -> Iterator[subprocess.Popen[str]]:
    """Its lines, from when it listens on."""
    command = ["stdbuf", "-oL", "candump", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        time.sleep(0.5)
        try:
            yield process
        finally:
            process.terminate()


def test_what_we_send_is_what_candump_shows(vcan: str, bus: SocketCan) -> None:
    source = random.Random(3)
    sent = [(source.randrange(0x800), source.randbytes(length)) for length in range(9) for _ in range(20)]
    with candump("-L", "-n", str(len(sent)), vcan) as process:
        for identifier, data in sent:
            bus.send(frame(identifier, data))
        shown, _ = process.communicate(timeout=20)
    expected = [f"{vcan} {identifier:03X}#{data.hex().upper()}" for identifier, data in sent]
    assert [line.split(" ", 1)[1] for line in shown.splitlines()] == expected


def test_what_cansend_sends_is_what_we_receive(vcan: str, bus: SocketCan) -> None:
    for text, expected in (
        ("080#", (0x080, b"")),
        ("205#0F00E803", (0x205, b"\x0f\x00\xe8\x03")),
        ("7FF#0001020304050607", (0x7FF, bytes(range(8)))),
        ("00000185#11", (0x185 | EXTENDED, b"\x11")),  # 29 bits: no frame of ours, and seen to be none
        ("705#R", (0x705 | REMOTE, b"")),
    ):
        subprocess.run(["cansend", vcan, text], check=True)
        raw = bus.receive(5.0)
        assert raw is not None
        assert parse(raw) == expected
    assert bus.receive(0.05) is None


def test_frames_of_can_fd_do_not_reach_us(vcan: str, bus: SocketCan) -> None:
    subprocess.run(["cansend", vcan, "123##3" + "00" * 64], check=True)
    assert bus.receive(0.2) is None
    assert bus.malformed == 0


def test_a_frame_reaches_all_others_and_not_its_sender(vcan: str, bus: SocketCan) -> None:
    with contextlib.closing(SocketCan(vcan)) as second, contextlib.closing(SocketCan(vcan)) as third:
        bus.send(frame(0x123, b"abc"))
        assert [second.receive(1.0), third.receive(1.0), bus.receive(0.05)] == [frame(0x123, b"abc")] * 2 + [None]


def test_a_thousand_frames_in_one_go_arrive_in_order(vcan: str, bus: SocketCan) -> None:
    with contextlib.closing(SocketCan(vcan)) as reader:
        took = []
        for number in range(1000):
            bus.send(frame(0x100 + number % 8, struct.pack("<Q", number)))
            if number % 50 == 49:  # no more than the socket's queue holds
                took += [struct.unpack("<Q", parse(raw)[1])[0] for raw in iter(lambda: reader.receive(0.0), None)]
    assert took == list(range(1000))


def test_a_motion_on_the_wire_is_the_motion_recorded_and_can_be_played_again(vcan: str, tmp_path: Path) -> None:
    """candump's log of a run holds the positions of our recording; canplayer brings back every frame, in order."""
    motion, log, recording = (tmp_path / name for name in ("sine.yaml", "run.log", "run.h5"))
    motion.write_text(MOTION)
    relaxed = {"heartbeat_timeout": "3000 ms", "rpdo_timeout": "3000 ms", "feedback_timeout": "1000 ms"}
    stage = stage_file(tmp_path, **relaxed, late_limit="2000", clock="sync")
    with traced(stage, tmp_path), log.open("w") as file:
        logger = subprocess.Popen(["stdbuf", "-oL", "candump", "-L", vcan], stdout=file)
        command = [sys.executable, "-m", "stagectl", "run", str(stage), str(motion), "-o", str(recording)]
        done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)
        logger.terminate()
        logger.wait()
    assert done.returncode == 0, done.stdout + done.stderr
    lines = re.findall(r" (\w{3})#([0-9A-F]*)$", log.read_text(), re.MULTILINE)
    logged = [(int(key, 16), bytes.fromhex(data)) for key, data in lines]
    positions = _positions(logged)
    measured = open_recording(recording)
    counts = np.round(measured.samples["measured"] / measured.meta["axis"]["encoder_step"]).astype(int)
    assert len(counts) > 400
    assert _within(counts.tolist(), positions)
    with contextlib.closing(SocketCan(vcan)) as reader:
        player = subprocess.Popen(["canplayer", "-I", str(log), f"{vcan}={vcan}"])  # with the pauses of the log
        played = [parse(raw) for _ in logged if (raw := reader.receive(60.0)) is not None]
        assert player.wait(timeout=60) == 0
        assert reader.receive(0.1) is None
    assert played == logged


def _positions(frames: list[tuple[int, bytes]]) -> list[int]:
    """Encoder counts of the drive's cyclic answers: 32 bits after the statusword."""
    return [struct.unpack_from("<i", data, 2)[0] for identifier, data in frames if identifier == TPDO]


def _within(wanted: list[int], seen: list[int]) -> bool:
    """Whether the one is a run of the other without a gap."""
    return any(seen[at : at + len(wanted)] == wanted for at in range(len(seen) - len(wanted) + 1))
