"""Recorder process and file: whole, ordered, and readable after every kind of end."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from stagectl.recording.hdf5 import BLOCK, RecordingError, open_recording, quantities, repair, save
from stagectl.recording.recorder import Order
from stagectl.recording.ring import Ring

COLUMNS = ("time", "reference", "measured")
META = {"created": "2026-01-01T00:00:00+0000", "axis": {"kind": "rotary"}, "name": "test"}


class Session:
    """A ring, and a recorder process that empties it."""

    def __init__(self, path: Path, capacity: int = 4096) -> None:
        self.path, self.ring = path, Ring.create(len(COLUMNS), capacity)
        read, self.alive = os.pipe()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "stagectl.recording.recorder"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(self.ring.descriptor, read),
            env={**os.environ, "STAGECTL_KERNELS": "interpreted"},
        )
        os.close(read)
        order = Order(self.ring.descriptor, len(COLUMNS), capacity, read, str(path), META, COLUMNS)
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        pickle.dump(order, self.process.stdin)
        self.process.stdin.close()
        self.process.stdin = None
        assert self.process.stdout.readline() == b"ready\n"

    def write(self, count: int) -> None:
        start = self.ring.written
        for k in range(start, start + count):
            self.ring.write((5e-4 * k, float(k), -float(k)))

    def end(self) -> int:
        self.process.communicate(timeout=10)
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
    time.sleep(0.3)
    during = open_recording(tmp_path / "a.h5")  # others may read along
    assert len(during.samples) == 3 * BLOCK
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


def test_nothing_recorded_leaves_no_file(tmp_path: Path) -> None:
    session = Session(tmp_path / "a.h5")
    os.close(session.alive)
    session.end()
    assert not (tmp_path / "a.h5").exists()


def test_what_is_no_recording_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "text.h5").write_text("hello")
    h5py.File(tmp_path / "other.h5", "w").close()
    with pytest.raises(RecordingError, match=r"no such recording"):
        open_recording(tmp_path / "absent.h5")
    with pytest.raises(RecordingError, match=r"no HDF5 file"):
        open_recording(tmp_path / "text.h5")
    with pytest.raises(RecordingError, match=r"no stagectl recording; `stagectl import`"):
        open_recording(tmp_path / "other.h5")
    samples: Any = np.zeros(3, dtype=[(name, "<f8") for name in COLUMNS])
    save(tmp_path / "good.h5", META, samples, "complete")
    with pytest.raises(RecordingError, match="has no column speed; it has time, reference, measured"):
        open_recording(tmp_path / "good.h5").column("speed")


def test_every_column_of_a_row_is_declared() -> None:
    from stagectl.kernels.rollout import COLUMNS as ALL

    assert set(quantities()) == set(ALL)
    assert all(quantity.meaning for quantity in quantities().values())
