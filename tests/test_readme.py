"""The README's commands run as printed, and the demo ends in its page."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from stagectl.cli.app import app
from tests.conftest import CONFIG, ROOT

DATA = ROOT.parent / "shared" / "data" / "emps" / "DATA_EMPS.mat"
COMMANDS = re.findall(r"(?m)^\.venv/bin/stagectl (.*)$", (ROOT / "README.md").read_text())


def stagectl(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}  # a bus of its own
    command = [sys.executable, "-m", "stagectl", *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def test_every_command_runs_as_printed(tmp_path: Path) -> None:
    """In order, in one folder, as a reader would; the EMPS ones where its record is at hand."""
    (tmp_path / "config").symlink_to(CONFIG)
    if DATA.is_file():
        (tmp_path / DATA.name).symlink_to(DATA)
    assert len(COMMANDS) >= 7
    for line in COMMANDS:
        words = [
            part
            for word in shlex.split(line, comments=True)
            for part in (sorted(map(str, _files(word, tmp_path))) or [word])
        ]
        if any("emps" in word.lower() and not word.startswith("config") for word in words) and not DATA.is_file():
            continue
        done = stagectl(words, tmp_path)
        assert done.returncode == 0, (line, done.stderr)
        assert "Traceback" not in done.stderr


def _files(word: str, folder: Path) -> list[Path]:
    return [path.relative_to(folder) for path in folder.glob(word)] if "*" in word else []


def test_the_demo_moves_the_stage_and_writes_its_page(tmp_path: Path) -> None:
    done = stagectl(["demo", "-o", str(tmp_path / "demo"), "--json", "-"], ROOT)
    assert done.returncode == 0, done.stderr
    figures = r"within ([\d.]+) nm with friction compensation; without it the error peaks at ([\d.]+) µm"
    found = re.search(figures, done.stderr)
    assert found is not None, done.stderr
    assert 5.0 < float(found[1]) <= 30.0
    assert 5.1 < float(found[2]) < 6.1
    told = json.loads(done.stdout)
    assert [run["trajectory"] for run in told["runs"][::2]] == ["sine-3.2hz", "sine-1.6hz", "sine-0.8hz"]
    assert max(run["tracking_error"]["peak"] for run in told["runs"][1::2]) == pytest.approx(
        1e-9 * float(found[1]), 0.01
    )
    assert told["report"] == str(tmp_path / "demo" / "report.html")
    page = (tmp_path / "demo" / "report.html").read_text(encoding="utf-8")
    assert page.count("<tr>") >= 4
    assert "data:image/png;base64," in page
    assert not re.search(r"(src|href)=\"(?!data:)", page)  # self-contained
    assert len(list((tmp_path / "demo").glob("*.h5"))) == 6


@pytest.mark.parametrize("verb", [*(command.name for command in app.registered_commands), "config check"])
def test_every_verb_has_help(verb: str) -> None:
    done = stagectl([*verb.split(), "--help"], ROOT)
    assert done.returncode == 0
    assert "Usage:" in done.stdout
