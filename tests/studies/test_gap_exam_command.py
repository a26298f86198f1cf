"""The verb `gap exam` around trials that are made up: files, ledger, and what it refuses."""

import json
from pathlib import Path
from typing import Any

import pytest
from stagectl_studies.exam import exam as exams
from stagectl_studies.exam import ledger
from typer.testing import CliRunner

from stagectl.cli.app import application
from stagectl.units import StageError
from tests.studies.made import records


@pytest.fixture(autouse=True)
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exams, "held", lambda _, planned, *__: records(60, 3)[: len(planned)])


def entered(folder: Path) -> list[dict[str, Any]]:
    """The ledger: the line of an exam that is begun, and those with scores."""
    begun, *scored = (json.loads(splitline) for splitline in (folder / "ledger.jsonl").read_text().splitlines())
    assert begun["begun"] and "scores" not in begun and begun["seed"] == 3 and begun["date"].endswith("Z")
    assert all("scores" in record for record in scored)
    assert list(ledger.read(folder / "ledger.jsonl")) == scored
    return scored


def held(folder: Path, *words: str) -> None:
    asked = ["gap", "exam", "--trials", "60", *words, "-o", str(folder)]
    CliRunner().invoke(application(), asked, catch_exceptions=False)


def test_page_scores_and_ledger(tmp_path: Path) -> None:
    held(tmp_path / "exam", "--seed", "3", "--short")
    scores = json.loads((tmp_path / "exam" / "scores.json").read_text())
    assert scores["exam"]["seed"] == 3 and len(scores["records"]) == 60
    assert "--seed 3 --short -o" in (tmp_path / "exam" / "exam.html").read_text()
    (line,) = entered(tmp_path)
    assert line["seed"] == 3 and line["version"] and line["date"].endswith("Z")
    value, trials = line["scores"]["pairs, all found"]
    assert trials == scores["strata"]["pair"] and 0.0 <= value <= 1.0


def test_going_on_keeps_the_seed(tmp_path: Path) -> None:
    """Also where the sources, and so the default seed, have changed since."""
    held(tmp_path / "exam", "--seed", "3")
    with pytest.raises(StageError, match="--resume"):
        held(tmp_path / "exam", "--seed", "3")
    held(tmp_path / "exam", "--resume")
    assert len(entered(tmp_path)) == 2


def test_there_must_be_an_exam_to_continue(tmp_path: Path) -> None:
    with pytest.raises(StageError, match="no exam to continue"):
        held(tmp_path / "exam", "--resume", "--seed", "3")
    assert not (tmp_path / "exam").exists()


def test_the_first_of_them_and_then_the_rest(tmp_path: Path) -> None:
    """What is told of a part says that it is one; the exam that lies there stays the whole one."""
    held(tmp_path / "exam", "--seed", "3", "--first", "7")
    scores = json.loads((tmp_path / "exam" / "scores.json").read_text())
    assert len(scores["records"]) == 7 and scores["exam"]["stopped after"] == 7 and scores["exam"]["trials"] == 60
    page = (tmp_path / "exam" / "exam.html").read_text()
    assert "The first 7 of 60 trials" in page and "--trials 60 --first 7 --seed 3 -o" in page
    held(tmp_path / "exam", "--resume")
    assert "stopped after" not in json.loads((tmp_path / "exam" / "scores.json").read_text())["exam"]
    first, whole = entered(tmp_path)
    assert first["stopped after"] == 7 and "stopped after" not in whole


def test_strata_that_are_none(tmp_path: Path) -> None:
    """Refused with the names there are, before anything is written."""
    with pytest.raises(
        StageError, match=r"--strata double: no such .* null, single, null-exact, .* alien, poor, closed$"
    ):
        held(tmp_path / "exam", "--strata", "pair,double")
    assert list(tmp_path.iterdir()) == []
    held(tmp_path / "exam", "--strata", "pair")  # the folder is free for the exam that was meant
    assert json.loads((tmp_path / "exam" / "exam.json").read_text())["strata"] == ["pair"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--seed", "4"], "--seed 4 (there: --seed 3)"),
        (["--strata", "pair"], "--strata pair (there: all strata)"),
        (["--short"], "--short (there: no --short)"),
        (["--baselines", "--trials", "61"], "--trials 61 (there: --trials 60), --baselines (there: no --baselines)"),
    ],
)
def test_another_exam_than_the_one_that_lies_there(tmp_path: Path, words: list[str], said: str) -> None:
    """Both values are said, and what goes on with the one that lies there; it stays as it is."""
    held(tmp_path / "exam", "--seed", "3")
    before = (tmp_path / "exam" / "exam.json").read_bytes()
    with pytest.raises(StageError) as refused:
        held(tmp_path / "exam", "--resume", *words)
    again = f"or: stagectl gap exam --resume --trials 60 --seed 3 -o {tmp_path / 'exam'}"
    assert f"holds another exam: {said}; choose another folder, {again}" in str(refused.value)
    assert (tmp_path / "exam" / "exam.json").read_bytes() == before


@pytest.mark.parametrize(
    ("content", "said"),
    [("{", "describes no exam"), ("[]", "describes no exam"), ('{"seed": 3}', "another version, .* baselines")],
)
def test_a_description_that_is_none(tmp_path: Path, content: str, said: str) -> None:
    (tmp_path / "exam.json").write_text(content)
    with pytest.raises(StageError, match=f"exam.json .*{said}"):
        held(tmp_path, "--resume")
    assert (tmp_path / "exam.json").read_text() == content


def test_interrupted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next step is said, the exam that was begun lies there for it, and stands in the ledger."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(exams, "held", interrupted)
    with pytest.raises(StageError, match=r"interrupted: .* go on with --resume"):
        held(tmp_path / "exam", "--seed", "3")
    assert [path.name for path in (tmp_path / "exam").iterdir()] == ["exam.json"]
    assert entered(tmp_path) == []
