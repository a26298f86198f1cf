"""The verb `gap exam` around trials that are made up: files, ledger, and what it refuses."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stagectl.cli.app import app
from stagectl.exam.blind import exam as exams
from stagectl.units import StageError
from tests.exam.made import records


@pytest.fixture(autouse=True)
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exams, "held", lambda *_: records(60, 3))


def held(folder: Path, *words: str) -> None:
    CliRunner().invoke(app, ["gap", "exam", "--trials", "60", *words, "-o", str(folder)], catch_exceptions=False)


def test_page_scores_and_ledger(tmp_path: Path) -> None:
    held(tmp_path / "exam", "--seed", "3", "--short")
    scores = json.loads((tmp_path / "exam" / "scores.json").read_text())
    assert scores["exam"]["seed"] == 3 and len(scores["records"]) == 60
    assert "--seed 3 --short -o" in (tmp_path / "exam" / "exam.html").read_text()
    (line,) = (json.loads(one) for one in (tmp_path / "ledger.jsonl").read_text().splitlines())
    assert line["seed"] == 3 and line["version"] and line["date"].endswith("Z")
    value, trials = line["scores"]["pairs, all found"]
    assert trials == scores["strata"]["pair"] and 0.0 <= value <= 1.0


def test_going_on_keeps_the_seed(tmp_path: Path) -> None:
    """Also where the sources, and so the default seed, have changed since."""
    held(tmp_path / "exam", "--seed", "3")
    with pytest.raises(StageError, match="--resume"):
        held(tmp_path / "exam", "--seed", "3")
    held(tmp_path / "exam", "--resume")
    assert len((tmp_path / "ledger.jsonl").read_text().splitlines()) == 2


def test_strata_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(StageError, match="no such stratum"):
        held(tmp_path / "exam", "--strata", "double")
