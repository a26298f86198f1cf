"""The virtual drive as a process: whoever started it need not read what it says."""

from __future__ import annotations

import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import DriveError
from stagectl.service import virtual_drive
from tests.conftest import ROOT

PIPE = 1 << 16  # bytes that a pipe holds before its writer waits
TALKATIVE = """
import sys
from stagectl.cli.show import tell
tell("virtual drive of a stage")
for _ in range({lines}):
    tell("x" * 99)
open({mark!r}, "w").write("all said")
"""


def instead(monkeypatch: pytest.MonkeyPatch, folder: Path, program: str) -> None:
    """Let this program run in the virtual drive's place."""
    (folder / "program.py").write_text(program)
    script = folder / "drive"
    script.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" "{folder / "program.py"}"\n')
    script.chmod(0o755)
    monkeypatch.setattr(virtual_drive, "PYTHON", (str(script),))


def test_a_drive_that_says_more_than_a_pipe_holds_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    mark = tmp_path / "mark"
    instead(monkeypatch, tmp_path, TALKATIVE.format(lines=3 * PIPE // 100, mark=str(mark)))
    process = virtual_drive.start(tmp_path / "stage.yaml", "nowhere", 1)
    try:
        assert process.wait(timeout=120) == 0
    finally:
        process.kill()
        process.wait()
    assert mark.read_text() == "all said"
    assert capfd.readouterr().err == ""  # nor is a pipe without a reader an error at exit


def test_a_drive_that_does_not_start_is_an_error_with_its_words(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    instead(monkeypatch, tmp_path, "print('node 5 is there already')")
    with pytest.raises(DriveError, match="node 5 is there already"):
        virtual_drive.start(tmp_path / "stage.yaml", "nowhere", 1)


def test_a_channel_with_the_name_of_a_real_one_is_told_from_it(
    monkeypatch: pytest.MonkeyPatch, ball_screw: Setup
) -> None:
    monkeypatch.setattr(virtual_drive, "wanted", lambda wire: True)
    monkeypatch.setattr(virtual_drive, "start", Mock())
    said: list[str] = []
    for channel in ("can0", "bench"):
        with virtual_drive.present(ball_screw.with_wire(channel=channel), said.append):
            pass
    assert ["socketcan" in words for words in said] == [True, False]
