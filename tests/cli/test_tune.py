"""``stagectl tune``: what it prints, writes and refuses, and that a refused stage can be tuned."""

from __future__ import annotations

import json
import math
import re
import shutil
from pathlib import Path

import pytest

from stagectl.config.stage_file import load_stage
from stagectl.design import CascadeControl, Control
from tests.cli.conftest import Command
from tests.conftest import CONFIG


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stage files of one's own."""
    monkeypatch.chdir(tmp_path)
    for path in CONFIG.glob("*.yaml"):
        shutil.copy(path, tmp_path)
    shutil.copytree(CONFIG / "drives", tmp_path / "drives")
    return tmp_path


@pytest.fixture
def unreported(monkeypatch: pytest.MonkeyPatch) -> None:
    """No page: drawing it takes longer than all else."""
    monkeypatch.setattr("stagectl.cli.show.write_page", lambda *_: None)


def test_a_design_is_shown_and_written_and_its_comments_stay(command: Command, folder: Path) -> None:
    before = (folder / "ball-screw.yaml").read_text()
    words = ("--bandwidth", "30Hz", "--margin", "30deg", "--write", "ball-screw.yaml", "--json", "-")
    code, out, err = command("tune", "ball-screw.yaml", *words)
    assert code == 0
    result = json.loads(out)
    assert result["bandwidth"] == {"value": 30.0, "unit": "Hz"}
    for word in ("PM", "GM up", "GM down", "delay margin", "Ms", "Mt", "Conditionally stable", "N/µm"):
        assert word in err
    assert "control.bandwidth: 40 Hz -> 30 Hz" in err
    after = (folder / "ball-screw.yaml").read_text()
    assert re.findall("#.*", after) == re.findall("#.*", before)
    control = load_stage(folder / "ball-screw.yaml").file.control
    assert isinstance(control, Control)
    assert (control.bandwidth, control.margin) == (30.0, pytest.approx(math.radians(30.0)))
    page = next((folder / "recordings").glob("*-tune-ball-screw.html")).read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 6
    assert not re.search(r"(src|href)=\"(?!data:)", page)


@pytest.mark.usefixtures("unreported")
def test_the_other_law_replaces_the_block(command: Command, folder: Path) -> None:
    code, _, err = command(
        "tune",
        "ball-screw.yaml",
        "--law",
        "cascade",
        "--write",
        "new.yaml",
        "--json",
        "r.json",
    )
    assert code == 0, err
    assert "a copy of ball-screw.yaml" in err
    assert "margin: 20 deg" in (folder / "new.yaml").read_text()
    result = json.loads((folder / "r.json").read_text())
    assert list(result["loops"]) == ["whole_loop", "velocity_loop", "position_loop"]
    control = load_stage(folder / "new.yaml").file.control
    assert isinstance(control, CascadeControl)
    for name, value in result["control"].items():
        assert getattr(control, name) == pytest.approx(value)
    assert control.margin == load_stage(folder / "ball-screw.yaml").file.control.margin


@pytest.mark.usefixtures("unreported")
def test_a_stage_whose_loop_is_refused_can_be_tuned(command: Command, folder: Path) -> None:
    text = (folder / "ball-screw.yaml").read_text()
    (folder / "refused.yaml").write_text(text.replace("bandwidth: 40 Hz", "bandwidth: 90 Hz"))
    assert command("config", "check", "refused.yaml")[0] == 1
    code, out, _ = command("tune", "refused.yaml", "--json", "-")
    assert code == 0
    assert 27.0 < json.loads(out)["bandwidth"]["value"] < 29.0


REFUSED = [
    (("--bandwidth", "60Hz", "--margin", "30deg"), "Nearest: --bandwidth 31.5Hz"),
    (("--bandwidth", "fast"), "--bandwidth fast: not a number"),
    (("--bandwidth", "40"), "the unit is missing"),
    (("--bandwidth", "40 mm"), "does not measure Hz"),
    (("--margin", "120deg"), "must lie in [0, 85.9] deg"),
    (("--ms", "0.9"), "must lie in (1, 100]"),
    (("--start", "own"), "--start own"),
    (("--bandwidth", "3000Hz"), "must lie in (0, 2000] Hz"),
]


@pytest.mark.parametrize(("words", "expected"), REFUSED)
def test_refusals_write_nothing(command: Command, folder: Path, words: tuple[str, ...], expected: str) -> None:
    before = (folder / "ball-screw.yaml").read_bytes()
    code, out, err = command("tune", "ball-screw.yaml", *words, "--write", "ball-screw.yaml")
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert expected in " ".join(err.split())
    assert (folder / "ball-screw.yaml").read_bytes() == before
    assert not (folder / "recordings").exists()
