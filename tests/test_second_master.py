"""A second `run` or `serve` at random moments of the first one's motion: the first loses nothing, the second goes."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from stagectl.recording.hdf5 import open_recording
from tests.conftest import ROOT
from tests.service.serving import Served, lasting
from tests.test_run import SINE, drive, rows

MOMENTS = int(os.environ.get("STAGECTL_SECOND_MASTERS", "2"))  # a run and a service; 50 in a nightly run
_ROOM = 30  # s of motion for each of them: the machine is shared


def _run(stage: Path, motion: Path, bus: Path, recording: Path) -> subprocess.Popen[str]:
    words = ["run", str(stage), str(motion), "--channel", str(bus), "-o", str(recording)]
    return subprocess.Popen([sys.executable, "-m", "stagectl", *words], cwd=ROOT, stderr=subprocess.PIPE, text=True)


def _second_run(folder: Path, stage: Path) -> tuple[int, str]:
    process = _run(stage, SINE, folder / "bus", folder / "second.h5")
    _, words = process.communicate(timeout=300)
    assert not (folder / "second.h5").exists()
    return process.returncode, words


def _second_service(folder: Path, number: int) -> str:
    place = folder / f"s{number}"
    place.mkdir()
    (place / "bus").symlink_to(folder / "bus")
    machine = Served(place)
    try:
        machine.start()
        assert machine.axis()["state"] == "offline"
        return str(machine.axis()) + machine.log
    finally:
        machine.end()


def test_the_first_master_loses_no_cycle_and_the_second_names_it(tmp_path: Path) -> None:
    chance, motion, path = random.Random(6), tmp_path / "long.yaml", tmp_path / "first.h5"
    motion.write_text(f"{{type: sine, amplitude: 2 mm, frequency: 1 Hz, periods: {_ROOM * MOMENTS}}}")
    stage = lasting(tmp_path)
    with drive(stage, tmp_path / "bus"):
        first = _run(stage, motion, tmp_path / "bus", path)
        while first.poll() is None and not (path.exists() and rows(path)):
            time.sleep(0.05)
        for number in range(MOMENTS):
            time.sleep(chance.uniform(0.0, 1.0))
            if number % 2:
                words = _second_service(tmp_path, number)
            else:
                code, words = _second_run(tmp_path, stage)
                assert code == 2
            assert first.poll() is None
            assert str(first.pid) in words
            assert "stagectl run" in words
            assert "wiring" not in words
        first.send_signal(signal.SIGINT)
        first.communicate(timeout=120)
    recording = open_recording(path)
    time_column, fault = recording.column("time"), recording.column("fault")
    assert recording.lost_rows == 0
    assert np.allclose(np.diff(time_column), 0.0005, atol=1e-9)
    assert not fault.any()
    assert np.max(np.abs(recording.column("error"))) < 0.2e-3 / (0.012 / (2 * np.pi))
