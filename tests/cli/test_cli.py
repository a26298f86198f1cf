"""The command as a whole: a mistake ends in words and an exit code, and nothing has moved, started or been written."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.cli.app import VERBS
from stagectl.cli.show import summary
from stagectl.kernels.rollout import COLUMNS
from stagectl.recording.hdf5 import Recording
from stagectl.workflows import motion as session
from stagectl.workflows import simulated_motion
from tests.cli.conftest import Command
from tests.config.corpus import Case, files
from tests.conftest import CONFIG

STAGE, SINE = CONFIG / "ball-screw.yaml", CONFIG / "trajectories" / "sine-2um.yaml"
_COMMANDS = {name for names in VERBS.values() for name in names}
BAD_STAGES = [case for case in files(STAGE.read_text()) if case.refused]
BAD_MOTIONS = [case for case in files(SINE.read_text()) if case.refused]


@pytest.fixture(autouse=True)
def still(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty folder to work in, and any motion or process is a failure."""
    monkeypatch.chdir(tmp_path)

    def moved(*_: Any, **__: Any) -> Any:
        raise AssertionError("something was about to move")

    for name in ("perform", "move", "drive_present"):
        monkeypatch.setattr(session, name, moved)
    monkeypatch.setattr(simulated_motion, "simulated", moved)
    monkeypatch.setattr(subprocess.Popen, "__init__", moved)  # the class stays: annotations name it


def refused(outcome: tuple[int, str, str], place: str) -> None:
    """Exit 2, nothing on standard output, an error with its place, no traceback and no new file."""
    code, out, err = outcome
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert place in err
    assert "Traceback" not in err
    assert {path.name for path in Path().iterdir()} <= {place.split(":")[0]}


@pytest.mark.parametrize("verb", ["run", "simulate"])
@pytest.mark.parametrize("case", BAD_STAGES[::2], ids=lambda case: case.name)
def test_no_malformed_stage_moves_anything(command: Command, verb: str, case: Case) -> None:
    Path("stage.yaml").write_bytes(case.content)
    refused(command(verb, "stage.yaml", SINE), "stage.yaml:")


@pytest.mark.parametrize("verb", ["run", "simulate"])
@pytest.mark.parametrize("case", BAD_MOTIONS[1::2], ids=lambda case: case.name)
def test_no_malformed_trajectory_moves_anything(command: Command, verb: str, case: Case) -> None:
    Path("motion.yaml").write_bytes(case.content)
    refused(command(verb, STAGE, "motion.yaml"), "motion.yaml:")


@pytest.mark.parametrize("verb", ["run", "simulate"])
def test_beyond_the_limits_nothing_moves(command: Command, verb: str) -> None:
    Path("motion.yaml").write_text("type: sine\namplitude: 51 mm\nfrequency: 0.1 Hz\nperiods: 1\n")
    code, out, err = command(verb, STAGE, "motion.yaml")
    assert (code, out) == (2, "")
    assert "the trajectory needs 51 mm" in err
    assert "nothing has moved" in err


@pytest.mark.parametrize("verb", ["run", "simulate", "virtual-drive"])
def test_no_such_file(command: Command, verb: str) -> None:
    refused(command(verb, "absent.yaml", *([SINE] if verb != "virtual-drive" else [])), "absent.yaml cannot be read")


def test_without_a_command_it_shows_where_to_begin(command: Command) -> None:
    code, out, err = command()
    assert (code, err) == (2, "") and all(door in out for door in ("stagectl demo", "drive probe", "gap diagnose"))


def test_the_version_is_that_of_the_distribution(command: Command) -> None:
    assert command("--version") == (0, f"stagectl {version('stagectl')}\n", "")


def test_the_help_lists_every_command_once_under_its_task(command: Command) -> None:
    _, out, _ = command("--help")
    listed = [line.split()[0] for line in out.splitlines() if re.match(r"  [a-z]", line)]
    assert sorted(set(listed) & _COMMANDS) == sorted(_COMMANDS)
    assert len([name for name in listed if name in _COMMANDS]) == len(_COMMANDS)
    assert "\nCommands:" not in out  # a command without a task


def test_usage(command: Command) -> None:
    for arguments in (("--help",), ("config",)):
        code, out, err = command(*arguments)
        assert code in (0, 2)
        assert "Usage" in out + err
    for wrong in (("dance",), ("run",), ("run", STAGE), ("config", "check"), ("simulate", "--quick", STAGE, SINE)):
        code, out, err = command(*wrong)
        assert (code, out) == (2, "")
        assert "Traceback" not in err
    refused(
        command("simulate", STAGE, SINE, "--without", "pid"),
        "--without pid: must be one of ptc, friction, effects, observer",
    )


def test_a_result_that_cannot_be_written(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def at_rest(motion: Any, *_: Any, **__: Any) -> Recording:
        samples = np.zeros(len(motion.plan.setpoints), [(name, "<f8") for name in COLUMNS])
        samples["time"], samples["closed"] = motion.setup.dt * np.arange(len(samples)), 1.0
        return Recording(motion.recording, {**motion.meta, "drive": {}}, samples, True, "complete", 0)

    monkeypatch.setattr(simulated_motion, "simulated", at_rest)
    Path("file").write_text("")
    for target in ("file/below.json", "/proc/result.json", "."):
        code, out, err = command("simulate", STAGE, SINE, "--json", target)
        assert (code, out) == (2, "")
        assert "error: " in err
    code, out, _ = command("simulate", STAGE, SINE, "--json", "-")
    assert code == 0
    assert json.loads(out)["nd"] == 1


PROCESSES = [
    (("config", "check", "bad.yaml"), 1),
    (("simulate", STAGE, "bad.yaml"), 2),
    (("run", "bad.yaml", SINE), 2),
    (("run", STAGE, "bad.yaml"), 2),
    (("virtual-drive", "bad.yaml"), 2),
]


@pytest.mark.parametrize(("arguments", "expected"), PROCESSES, ids=lambda value: str(value)[:20])
def test_in_a_process_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[object, ...], expected: int
) -> None:
    monkeypatch.undo()
    (tmp_path / "bad.yaml").write_text("type: !!python/object/apply:os.system ['touch moved']\nduration: 1e400 s\n")
    done = subprocess.run(
        [sys.executable, "-m", "stagectl", *map(str, arguments)],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert (done.returncode, done.stdout) == (expected, "")
    assert done.stderr.startswith("error: ")
    assert "bad.yaml:1)" in done.stderr
    assert "Traceback" not in done.stderr
    assert os.listdir(tmp_path) == ["bad.yaml"]  # no recording, no bus, nothing executed


def test_the_page_is_an_address_that_a_script_can_take(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    address = {"address": "http://127.0.0.1:8402/#key"}
    monkeypatch.setattr("stagectl.cli.service.ask_service", lambda *_: address)
    assert command("page") == (0, f"{address['address']}\n", "")
    assert json.loads(command("page", "--json", "-")[1]) == address


def test_where_rows_are_lost_nobody_says_that_the_axis_did_not_settle() -> None:
    result = {"tracking_error": {"peak": 1e-6, "rms": 1e-7}, "unit": "m", "steady": (0.0, 1.0), "nd": 1, "stage": "s"}
    result |= {"trajectory": "t", "open_loop": False, "fault": "", "simulated": False, "late_cycles": 0}
    result |= {"effects_limited_cycles": 0, "saturated_cycles": 0, "in_position": False, "lost_rows": 3}
    result |= {"tracking_error_after_start": {"peak": 1e-6, "rms": 1e-7}, "current_at_rest": None}
    assert "settle" not in summary(result)
    assert "settle" in summary({**result, "lost_rows": 0})
