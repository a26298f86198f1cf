"""The examples: each runs as it is, in a folder with the configuration, and writes only into recordings/."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from tests.conftest import CONFIG, ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
SAYS = {
    "01_track_a_sine": "with friction compensation: peak error 0.0",
    "02_identify_from_a_csv": "mechanics.inertia: 0.010 kg m^2 -> 0.011",
    "03_tune": "tuned: 28 Hz",
    "04_diagnose_a_folder": "viscous_asymmetry probability 0.9",
    "05_a_friction_model_of_your_own": "LuGre: peak error ",
    "06_a_motion_on_the_virtual_drive": "100.0 % of the positions are those of the simulation",
}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_it_runs(
    example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "config").symlink_to(CONFIG)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # a bus of its own
    runpy.run_path(str(example), run_name="__main__")
    assert SAYS[example.stem] in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} - {"stagectl"} == {"config", "recordings"}


def test_there_are_six_and_they_are_short() -> None:
    assert [path.stem for path in EXAMPLES] == list(SAYS)
    assert all(len(path.read_text(encoding="utf-8").splitlines()) < 40 for path in EXAMPLES)


def test_the_manual_shows_them_all() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert all(f'--8<-- "examples/{path.name}"' in page for path in EXAMPLES)
