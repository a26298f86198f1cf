"""A disk that is slow or full, under a motion through real processes: the motion is as if there were none."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.kernels import law
from stagectl.recording.file_lock import claimed
from stagectl.recording.hdf5 import open_recording
from tests.conftest import ROOT
from tests.test_run import SINE, STAGE, drive, members, rows, stagectl

COLUMNS = ("measured", *law.Setpoint._fields, *law.Output._fields)


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("disks") / "s.h5"
    assert stagectl("simulate", STAGE, SINE, "-o", path).returncode == 0
    return open_recording(path).samples


def begun(stage: Path, folder: Path) -> tuple[subprocess.Popen[str], int]:
    """A run, and the process id of its recorder, which has opened its file."""
    words = ["run", stage, SINE, "--channel", folder / "bus", "-o", folder / "r.h5", "--json", "-"]
    run = subprocess.Popen(
        [sys.executable, "-m", "stagectl", *map(str, words)],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    end = time.monotonic() + 120.0
    while "stagectl.recording.recorder" not in members(run.pid) or not (folder / "r.h5").exists():
        assert time.monotonic() < end and run.poll() is None
        time.sleep(0.005)
    return run, members(run.pid)["stagectl.recording.recorder"]


def until_rows(run: subprocess.Popen[str], path: Path) -> None:
    """Wait for the first rows of a run that goes on."""
    end = time.monotonic() + 120.0
    while not rows(path):
        assert time.monotonic() < end and run.poll() is None
        time.sleep(0.005)


def test_a_disk_that_takes_nothing_for_two_seconds(tmp_path: Path, expected: Any) -> None:
    with drive(STAGE, tmp_path / "bus"):
        run, recorder = begun(STAGE, tmp_path)
        until_rows(run, tmp_path / "r.h5")
        os.kill(recorder, signal.SIGSTOP)  # as where it sleeps in a write
        before = rows(tmp_path / "r.h5")
        time.sleep(2.0)
        assert rows(tmp_path / "r.h5") == before
        os.kill(recorder, signal.SIGCONT)
        out, err = run.communicate(timeout=120)
    assert run.returncode == 0, err
    assert json.loads(out)["lost_rows"] == 0
    recording = open_recording(tmp_path / "r.h5")
    assert recording.complete and recording.gaps == ()
    for column in COLUMNS:
        assert np.array_equal(recording.samples[column], expected[column]), column


def test_a_disk_that_becomes_full(tmp_path: Path, expected: Any) -> None:
    with drive(STAGE, tmp_path / "bus"):
        run, recorder = begun(STAGE, tmp_path)
        until_rows(run, tmp_path / "r.h5")
        size = (tmp_path / "r.h5").stat().st_size
        resource.prlimit(recorder, resource.RLIMIT_FSIZE, (size, size))
        out, err = run.communicate(timeout=120)
    result, recording = json.loads(out), open_recording(tmp_path / "r.h5")
    kept = len(recording.samples)
    assert (result["cycles"], result["fault"]) == (len(expected), "")  # the axis went its way
    assert 0 < kept < len(expected) and result["lost_rows"] == recording.lost_rows == len(expected) - kept
    assert run.returncode == 1  # a script must not go on with it
    assert recording.complete and recording.gaps == ((kept, recording.lost_rows),)
    assert f"{recording.lost_rows} of {len(expected)} rows" in " ".join(err.split())
    for column in COLUMNS:
        assert np.array_equal(recording.samples[column], expected[column][:kept]), column


def test_a_disk_that_is_full_from_the_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No row is kept: the run says so, and has no position, no error and no traceback."""
    with drive(STAGE, tmp_path / "bus"):
        run, recorder = begun(STAGE, tmp_path)
        size = (tmp_path / "r.h5").stat().st_size
        resource.prlimit(recorder, resource.RLIMIT_FSIZE, (size, size))
        out, err = run.communicate(timeout=120)
    if len(open_recording(tmp_path / "r.h5").samples):
        pytest.skip("the first rows came before the limit")
    result = json.loads(out)
    assert run.returncode == 1 and "Traceback" not in err
    assert result["lost_rows"] == result["cycles"] > 0
    assert not result["in_position"] and result["tracking_error"]["peak"] is None
    report = stagectl("report", tmp_path / "r.h5")
    assert report.returncode == 2 and f"{result['lost_rows']} of {result['lost_rows']} rows" in " ".join(
        report.stderr.split()
    )


def test_why_nothing_can_be_recorded_is_in_the_error(tmp_path: Path) -> None:
    """The recorder's own reason, as an exception in Python has no message above it."""
    with drive(STAGE, tmp_path / "bus"), claimed(tmp_path / "r.h5"):
        run = stagectl("run", STAGE, SINE, "--channel", tmp_path / "bus", "-o", tmp_path / "r.h5")
    (error,) = [line for line in run.stderr.splitlines() if line.startswith("error: ")]
    assert run.returncode == 2 and "another run" in error and "nothing has moved" in error
