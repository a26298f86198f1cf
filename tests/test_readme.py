"""The first command of the README ends in its page; `test_printed` types the others."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image, ImageSequence

from tests.conftest import ROOT
from tests.printed import tool


def stagectl(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}  # a bus of its own
    command = [sys.executable, "-m", "stagectl", *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def test_the_demo_moves_the_stage_and_writes_its_page(tmp_path: Path) -> None:
    done = stagectl(["demo", "-o", str(tmp_path / "demo"), "--json", "-"], ROOT)
    assert done.returncode == 0, done.stderr
    figures = r"within ([\d.]+) nm with friction compensation; without it the error peaks at ([\d.]+) µm"
    match = re.search(figures, done.stderr)
    assert match is not None, done.stderr
    assert 5.0 < float(match[1]) <= 30.0
    assert 5.1 < float(match[2]) < 6.1
    answer = json.loads(done.stdout)
    assert [run["trajectory"] for run in answer["runs"][::2]] == ["sine-3.2hz", "sine-1.6hz", "sine-0.8hz"]
    assert max(run["tracking_error"]["peak"] for run in answer["runs"][1::2]) == pytest.approx(
        1e-9 * float(match[1]), 0.01
    )
    assert answer["report"] == str(tmp_path / "demo" / "report.html")
    page = (tmp_path / "demo" / "report.html").read_text(encoding="utf-8")
    assert page.count("<tr>") >= 4
    assert "data:image/png;base64," in page and page.count("data-plot=") == 3  # to print, and to explore
    assert not re.search(r"(src|href)=\"(?!data:)", page)  # self-contained
    assert len(list((tmp_path / "demo").glob("*.h5"))) == 6


def test_the_picture_of_the_live_page_moves_at_the_speed_of_the_axis(tmp_path: Path) -> None:
    """The one that is shown, and one of three frames: the last tells how long the second stood."""
    assert len(_stood(ROOT / "docs" / "live-page.webp")) > 10
    live_page = tool("live_page")
    grey = [live_page.Frame(Image.new("L", (8, 8), 40 * number), time) for number, time in enumerate((5.0, 5.1, 5.3))]
    live_page.write(grey, tmp_path / "moving.webp")
    assert _stood(tmp_path / "moving.webp") == [100, 200]


def _stood(path: Path) -> list[int]:
    """How long each frame of an animation that begins again stands (ms)."""
    with Image.open(path) as shown:
        assert shown.info["loop"] == 0
        return [frame.copy().info["duration"] for frame in ImageSequence.Iterator(shown)]
