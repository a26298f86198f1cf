"""The twin beside a real run: its process, the loop's memory, what a kill changes, and what the verbs show."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from stagectl.recording.hdf5 import open_recording
from tests.conftest import CONFIG, ROOT, Command, child_of
from tests.test_run import drive

STAGE = CONFIG / "ball-screw.yaml"
MOTION = "{type: sine, amplitude: 5 mm, frequency: 1.6 Hz, periods: 4, ramp: 1}"


@contextlib.contextmanager
def stiffer_machine(folder: Path) -> Iterator[Path]:
    """A virtual drive with 20 % more viscous friction than the stage file; its channel."""
    plant, channel = folder / "plant.yaml", folder / "bus"
    text = STAGE.read_text()
    assert "viscous: 0.14 N m s/rad" in text
    plant.write_text(text.replace("viscous: 0.14 N m s/rad", "viscous: 0.168 N m s/rad"))
    with drive(plant, channel):
        yield channel


def started(folder: Path, channel: Path, name: str) -> subprocess.Popen[str]:
    (folder / "move.yaml").write_text(MOTION)
    words = ["run", STAGE, folder / "move.yaml", "--channel", channel, "-o", folder / name, "--json", "-"]
    twin = ["--twin", "--state", folder / "slow.jsonl"]
    return subprocess.Popen(
        [sys.executable, "-m", "stagectl", *map(str, [*words, *twin])],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def child(parent: int, module: str) -> int:
    """Process id of the child of `parent` that runs `module`."""
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        if (pid := child_of(parent, module)) is not None:
            return pid
        time.sleep(0.02)
    raise AssertionError(f"no {module} was started")


def compiler_in(process: int) -> bool:
    """Whether the process has numba's compiler in memory."""
    return "llvmlite" in Path(f"/proc/{process}/maps").read_text()


def test_the_twin_names_what_is_off_and_its_death_changes_nothing(command: Command, tmp_path: Path) -> None:
    with stiffer_machine(tmp_path) as channel:
        run = started(tmp_path, channel, "whole.h5")
        loop = child(run.pid, "stagectl.realtime.axes")
        twin = child(run.pid, "stagectl.twin.process")
        while not compiler_in(twin):
            assert run.poll() is None
            time.sleep(0.02)
        assert not compiler_in(loop)
        out, output = run.communicate(timeout=120)
        assert run.returncode == 0, output
        killed = started(tmp_path, channel, "killed.h5")
        child(killed.pid, "stagectl.realtime.axes")
        time.sleep(1.0)
        os.kill(child(killed.pid, "stagectl.twin.process"), signal.SIGKILL)
        _, said_killed = killed.communicate(timeout=120)
        assert killed.returncode == 0, said_killed
    answer = json.loads(out)["twin"]
    assert [entry["name"] for entry in answer["named"]] == ["viscous"]
    assert answer["named"][0]["share"] == pytest.approx(0.2, abs=0.005)
    assert answer["residual"]["controller"] == 0.0
    assert answer["residual"]["drive"] < 0.004  # A, a count of the drive's report
    whole, cut = open_recording(tmp_path / "whole.h5").samples, open_recording(tmp_path / "killed.h5").samples
    assert (answer["rows"], answer["skipped_rows"], answer["ended"]) == (len(whole), 0, "complete")
    assert "twin: the machine differs from the model: viscous +20 %" in output
    assert "ended early (exit -9)" in said_killed
    for column in ("measured", "command", "current"):
        assert np.array_equal(whole[column], cut[column]), column
    _verbs_show_it(command, tmp_path)


def _verbs_show_it(command: Command, folder: Path) -> None:
    code, _, output = command("gap", "watch", folder / "whole.twin.json", "--once")
    assert code == 0, output
    assert "C mechanics" in output
    assert "viscous +20 %" in output
    _, lines, _ = command("gap", "watch", folder / "whole.twin.json", "--json", "-")
    assert json.loads(lines.splitlines()[0])["verdict"] == "effects"
    code, _, output = command("gap", "watch", folder / "none.twin.json")
    assert code == 2
    assert "a run with --twin writes one" in output
    code, _, output = command("gap", "drift", folder / "slow.jsonl")
    assert code == 2
    assert "has 1 lines; at least 3" in output
