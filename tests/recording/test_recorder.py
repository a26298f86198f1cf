"""Recorder process and file: whole, ordered, and readable after every kind of end."""

from __future__ import annotations

import contextlib
import os
import pickle
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from stagectl.problem import ProblemKind
from stagectl.recording.constants import BLOCK
from stagectl.recording.hdf5 import RecordingError, open_recording, quantities, repair, save
from stagectl.recording.recorder import Order
from stagectl.recording.ring import Ring
from tests.problems import refused

COLUMNS = ("time", "reference", "measured")
META = {"created": "2026-01-01T00:00:00+0000", "axis": {"kind": "rotary"}, "name": "test"}


class Session:
    """A ring, and a recorder process that empties it."""

    def __init__(self, path: Path, capacity: int = 8 * BLOCK, stderr: int | None = None, script: str = "") -> None:
        self.path, self.ring, self.heard = path, Ring.create(len(COLUMNS), capacity), ""
        read, self.alive = os.pipe()
        self.process = subprocess.Popen(
            [sys.executable, *(["-c", script] if script else ["-m", "stagectl.recording.recorder"])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=stderr,
            pass_fds=(self.ring.descriptor, read),
            env={**os.environ, "STAGECTL_KERNELS": "interpreted"},
        )
        os.close(read)
        order = Order(self.ring.place, read, str(path), META, COLUMNS)
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        pickle.dump(order, self.process.stdin)
        self.process.stdin.close()
        self.process.stdin = None
        assert self.process.stdout.readline() == b"ready\n"

    def said(self) -> str:
        """Its next line of complaint."""
        assert self.process.stderr is not None
        return self.process.stderr.readline().decode()

    def until(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < end
            time.sleep(0.02)

    def waits(self) -> bool:
        """Whether the recorder sleeps until its next look at the ring; a busy one, or one without a core, runs."""
        return Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()[0] == "S"

    def write(self, count: int, seed: int | None = None) -> None:
        """Rows that count up; with a `seed` their last column is noise, which does not pack."""
        start, draw = self.ring.written, random.Random(seed)
        for k in range(start, start + count):
            self.ring.write((5e-4 * k, float(k), -float(k) if seed is None else draw.random()))

    def end(self) -> int:
        _, said = self.process.communicate(timeout=60)
        self.heard += (said or b"").decode()
        return self.process.returncode


def test_every_row_arrives_with_units_and_the_reason_of_the_end(tmp_path: Path) -> None:
    session = Session(tmp_path / "a.h5")
    for _ in range(5):
        session.write(700)
        time.sleep(0.03)
    session.ring.close()
    assert session.end() == 0
    os.close(session.alive)
    recording = open_recording(tmp_path / "a.h5")
    assert (recording.complete, recording.ended, recording.lost_rows) == (True, "complete", 0)
    assert np.array_equal(recording.column("reference"), np.arange(3500.0))
    with h5py.File(tmp_path / "a.h5") as file:
        assert '"reference": "rad"' in file["samples"].attrs["units"]
        assert file["samples"].chunks == (BLOCK,)


def test_when_the_writer_dies_all_rows_are_kept_and_the_file_says_so(tmp_path: Path) -> None:
    session = Session(tmp_path / "a.h5")
    session.write(BLOCK + 10)
    os.close(session.alive)  # what the kernel does when the loop is killed
    assert session.end() == 0
    recording = open_recording(tmp_path / "a.h5")
    assert (recording.ended, len(recording.samples)) == ("the loop process died", BLOCK + 10)


def test_rows_that_were_overwritten_are_counted(tmp_path: Path) -> None:
    session = Session(tmp_path / "a.h5", capacity=256)
    session.process.send_signal(signal.SIGSTOP)
    session.write(1000)
    session.process.send_signal(signal.SIGCONT)
    session.ring.close()
    session.end()
    os.close(session.alive)
    recording = open_recording(tmp_path / "a.h5")
    assert recording.lost_rows == 1000 - len(recording.samples) == 744
    assert recording.column("reference")[0] == 744.0


def test_a_killed_recorder_leaves_all_but_the_last_block(tmp_path: Path) -> None:
    session = Session(tmp_path / "a.h5")
    session.write(3 * BLOCK + 100)
    session.until(lambda: len(open_recording(session.path).samples) == 3 * BLOCK)  # others may read along
    session.process.kill()
    session.end()
    os.close(session.alive)
    recording = open_recording(tmp_path / "a.h5")
    assert not recording.complete
    assert "cut off" in recording.ended
    assert np.array_equal(recording.column("reference"), np.arange(3.0 * BLOCK))
    with pytest.raises(OSError, match="already open"):
        h5py.File(tmp_path / "a.h5", "r")
    assert repair(tmp_path / "a.h5")
    h5py.File(tmp_path / "a.h5", "r").close()
    assert not repair(tmp_path / "a.h5")


def test_a_full_disk_costs_rows_which_the_file_marks_and_goes_on_when_there_is_room(tmp_path: Path) -> None:
    session = Session(tmp_path / "a.h5", stderr=subprocess.PIPE)
    session.write(2 * BLOCK)
    session.until(lambda: len(open_recording(session.path).samples) == 2 * BLOCK)
    room, hard = resource.prlimit(session.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(session.process.pid, resource.RLIMIT_FSIZE, (session.path.stat().st_size, hard))
    session.write(3 * BLOCK)
    assert session.said().startswith(f"recorder: {session.path} cannot be written: File too large")
    session.until(session.waits)  # what is due has been tried
    resource.prlimit(session.process.pid, resource.RLIMIT_FSIZE, (room, hard))
    session.write(BLOCK + 5)
    session.ring.close()
    assert session.end() == 0
    os.close(session.alive)
    recording = open_recording(session.path)
    assert (recording.complete, recording.ended, recording.lost_rows) == (True, "complete", 3 * BLOCK)
    assert recording.gaps == ((2 * BLOCK, 3 * BLOCK),)
    kept = np.r_[0 : 2 * BLOCK, 5 * BLOCK : 6 * BLOCK + 5]
    assert np.array_equal(recording.column("reference"), kept)


@pytest.mark.parametrize("blocks", [1, 4])
def test_no_room_at_the_end_is_room_enough_to_say_so(tmp_path: Path, blocks: int) -> None:
    session = Session(tmp_path / "a.h5", stderr=subprocess.PIPE)
    session.write(BLOCK)
    session.until(lambda: len(open_recording(session.path).samples) == BLOCK)
    size = session.path.stat().st_size
    resource.prlimit(session.process.pid, resource.RLIMIT_FSIZE, (size, size))
    session.write(blocks * BLOCK)
    session.ring.close()
    assert session.end() == 0
    os.close(session.alive)
    recording = open_recording(session.path)
    assert (recording.complete, recording.lost_rows, len(recording.samples)) == (True, blocks * BLOCK, BLOCK)
    h5py.File(session.path, "r").close()  # no mark of a crash


def test_a_real_file_system_that_is_full(tmp_path: Path) -> None:
    """As above, on one of 40 KiB; there must be somebody who may mount it."""
    place = tmp_path / "small"
    place.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=40k", "none", place], capture_output=True).returncode:
        pytest.skip("mounting a file system is not allowed here")
    try:
        session = Session(place / "a.h5", stderr=subprocess.PIPE)
        session.write(8 * BLOCK, seed=1)
        session.ring.close()
        assert session.end() == 0
        os.close(session.alive)
        recording = open_recording(place / "a.h5")
        assert recording.lost_rows == 8 * BLOCK - len(recording.samples) and 0 < recording.lost_rows < 8 * BLOCK
        assert recording.gaps[0] == (len(recording.samples), recording.lost_rows)
        full = place / "full"
        with contextlib.suppress(OSError), full.open("wb", buffering=0) as file:
            while True:
                file.write(bytes(512))
        with refused(RecordingError, kind=ProblemKind.FILE, file=place / "b.h5"):
            save(place / "b.h5", META, np.zeros(3, dtype=[("time", "<f8")]), "complete")
    finally:
        subprocess.run(["umount", place], check=True)


# The descriptors of the file become such as can only be read: as on a disk that the kernel has made read-only.
READ_ONLY = """
import os, sys
from stagectl.recording import hdf5, recorder
class Failing(hdf5.Writer):
    def append(self, rows):
        if self._packer.samples.shape[0] >= 2 * recorder.BLOCK and MODE == "reserved":
            self._reserve = lambda more: None  # the room was there, the writing fails
        if self._packer.samples.shape[0] >= 2 * recorder.BLOCK:
            reading = os.open(self.path, os.O_RDONLY)
            for one in os.listdir("/proc/self/fd"):
                if int(one) != reading and os.path.realpath(f"/proc/self/fd/{one}") == str(self.path):
                    os.dup2(reading, int(one))
        super().append(rows)
recorder.Writer = Failing
recorder.main()
"""


@pytest.mark.parametrize("mode", ["at once", "reserved"])
def test_a_disk_that_fails_costs_the_rest_and_no_more(tmp_path: Path, mode: str) -> None:
    session = Session(tmp_path / "a.h5", stderr=subprocess.PIPE, script=f"MODE = {mode!r}\n{READ_ONLY}")
    session.write(6 * BLOCK)
    session.ring.close()
    assert session.end() == 2
    os.close(session.alive)
    assert "Bad file descriptor" in session.heard, session.heard
    assert f"rows are lost from row {2 * BLOCK} on" in session.heard
    assert f"{4 * BLOCK} of {6 * BLOCK} rows are lost" in session.heard
    recording = open_recording(session.path)
    assert not recording.complete and "cut off" in recording.ended
    assert np.array_equal(recording.column("reference"), np.arange(2.0 * BLOCK))


def test_nothing_recorded_leaves_no_file(tmp_path: Path) -> None:
    session = Session(tmp_path / "a.h5")
    os.close(session.alive)
    session.end()
    assert not (tmp_path / "a.h5").exists()


def test_what_is_no_recording_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "text.h5").write_text("hello")
    h5py.File(tmp_path / "other.h5", "w").close()
    with refused(RecordingError, kind=ProblemKind.FILE, file=tmp_path / "absent.h5"):
        open_recording(tmp_path / "absent.h5")
    with refused(RecordingError, kind=ProblemKind.SYNTAX, file=tmp_path / "text.h5"):
        open_recording(tmp_path / "text.h5")
    with refused(RecordingError, kind=ProblemKind.SYNTAX, file=tmp_path / "other.h5"):
        open_recording(tmp_path / "other.h5")
    samples: Any = np.zeros(3, dtype=[(name, "<f8") for name in COLUMNS])
    save(tmp_path / "good.h5", META, samples, "complete")
    with refused(RecordingError, kind=ProblemKind.UNKNOWN, column="speed"):
        open_recording(tmp_path / "good.h5").column("speed")


def test_every_column_of_a_row_is_declared() -> None:
    from stagectl.kernels.rollout import COLUMNS as ALL

    assert set(quantities()) == set(ALL)
    assert all(quantity.meaning for quantity in quantities().values())
