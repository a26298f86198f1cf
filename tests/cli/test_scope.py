"""scope and record against a service that runs, and what they say where there is none or it says no."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from stagectl.recording.hdf5 import open_recording
from tests.conftest import Command
from tests.service.serving import Served, served


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("scope")) as service:
        service.ask("POST", "enable")
        yield service


def test_one_capture_of_a_motion(machine: Served, command: Command) -> None:
    """A sine's current crosses 0.5 A upwards at the trigger, and nowhere is a row left out."""
    machine.ask("POST", "trajectory", yaml="{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 100}", wait=False)
    words = ["--trigger", "current > 0.5 A", "--span", "0.4 s", "--before", "50 %", "--json", "-"]
    code, out, err = command("scope", "measured", "current", *words, "--socket", machine.socket)
    assert code == 0, err
    assert "current " in err
    assert "^ trigger" in err
    answer = json.loads(out)
    time, current = np.array(answer["time"]), np.array(answer["channels"]["current"]["low"])
    assert answer["triggered"]
    assert answer["channels"]["measured"]["unit"] == "m"
    assert len(time) == 800
    assert np.allclose(np.diff(time), 5e-4)
    place = int(np.argmin(np.abs(time)))
    assert place == 400
    assert current[place - 1] < 0.5 <= current[place]
    machine.ask("POST", "stop")


def test_a_trigger_that_does_not_come_is_not_waited_for_in_silence(machine: Served) -> None:
    words = ["scope", "error", "--trigger", "current > 1000 A", "--once", "--socket", str(machine.socket)]
    waiting = subprocess.Popen([sys.executable, "-m", "stagectl", *words], stderr=subprocess.PIPE, text=True)
    with waiting as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        process.kill()
    assert re.fullmatch(r"waiting for the trigger; so far current lies between \S+ A and \S+ A; Ctrl-C ends\n", line)


def test_channels_are_listed(machine: Served, command: Command) -> None:
    code, out, _ = command("scope", "--list", "--socket", machine.socket)
    assert code == 0
    assert "axis  error             m      target minus measured" in out


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["nothing", "--once"], 1, "channel nothing;"),
        (["error,nothing", "--once"], 1, "channel nothing;"),  # several may stand in one word
        (["error", "--trigger", "big", "--once"], 2, "must be CHANNEL > LEVEL"),
        (["error", "--trigger", "error > 1 A", "--once"], 1, "trigger level 1 A: "),
        (["error", "--trigger", "error > 1", "--once"], 1, "trigger level 1: the unit is missing"),
        (["error", "--span", "1 h", "--once"], 2, "--span 1 h"),
        (["error", "--span", "1 m", "--once"], 2, "--span 1 m"),
        (["error", "--span", "20 s", "--once"], 1, "a capture of axis has 9.83 s at most"),
    ],
)
def test_what_cannot_be_is_said(machine: Served, command: Command, words: list[str], code: int, said: str) -> None:
    shown, _, err = command("scope", *words, "--socket", machine.socket)
    assert shown == code, err
    assert said in err


@pytest.mark.parametrize("verb", [["scope", "--once"], ["record", "--for", "1 s"], ["page"]])
def test_without_a_service(command: Command, tmp_path: Path, verb: list[str]) -> None:
    code, _, err = command(*verb, "--socket", tmp_path / "none.sock")
    assert code == 2
    assert "no service answers" in err


def test_a_recording_of_a_second(machine: Served, command: Command, tmp_path: Path) -> None:
    target = tmp_path / "now.h5"
    words = ["--for", "1 s", "--before", "0.1 s", "--name", "now", "-o", target, "--json", "-"]
    code, out, err = command("record", *words, "--socket", machine.socket)
    assert code == 0, err
    assert json.loads(out)["recording"] == str(target)
    recording = open_recording(target)
    assert recording.complete
    assert np.allclose(np.diff(recording.column("time")), 5e-4)
    code, _, err = command("record", *words, "--socket", machine.socket)
    assert code == 1
    assert "now.h5 exists already" in err


@pytest.mark.parametrize("name", ["mine.h5", "notes.yaml", "folder.h5"])
def test_what_is_no_recording_is_left_before_anything_is_recorded(
    machine: Served, command: Command, tmp_path: Path, name: str
) -> None:
    target, before = tmp_path / name, machine.ask("GET", "recordings")
    target.mkdir() if name.startswith("folder") else target.write_text("mine")
    code, out, err = command("record", "--for", "0.1 s", "-o", target, "--socket", machine.socket)
    assert (code, out) == (2, "")
    assert str(target) in err
    assert target.is_dir() or target.read_text() == "mine"
    assert machine.ask("GET", "recordings") == before


def test_a_recording_that_cannot_be_brought_is_said_to_be_with_the_service(
    machine: Served, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "old.h5"
    words = ["record", "--for", "0.1 s", "-o", target, "--socket", machine.socket]
    assert command(*words)[0] == 0
    before = target.read_bytes()

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(shutil, "copyfileobj", full)
    code, _, err = command(*words)
    assert (code, target.read_bytes(), list(tmp_path.iterdir())) == (2, before, [target])
    assert str(machine.folder / "state" / "recordings" / "axis") in err


def test_a_recording_of_an_axis_that_gives_no_rows(machine: Served, command: Command) -> None:
    """Its drive is gone, and with it the service that the tests above need: the verb says where to look."""
    machine.kill_drive()
    machine.until(lambda axis: axis["state"] == "fault")
    code, _, err = command("record", "--for", "0.2 s", "--socket", machine.socket)
    assert code == 1
    assert "nothing was recorded: axis gave no rows: see `stagectl status`" in " ".join(err.split())
