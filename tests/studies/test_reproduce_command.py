"""``stagectl reproduce``: what it writes and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from stagectl_studies.reproduction import papers
from stagectl_studies.reproduction.part import Outcome, Part
from stagectl_studies.reproduction.summary import Compared, Verdict, photograph

from stagectl.report.page import Section, Table
from tests.cli.conftest import Command

SECTION = Section("Fig. 5 - Speed", ["As <b> in the paper."], [], [Table("", ["D"], [["0.14"]])])
ROWS = [Compared("Fig. 5", "D 0.14", "D 0.1400", Verdict.REPRODUCED), photograph("Fig. 1", "stage")]
OUTCOME = Outcome("D is 0.14.", ["Simulated."], [Part("figure 5", SECTION, {"viscous": 0.14})], ROWS)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The experiments themselves take most of a minute."""
    asked: list[str] = []

    def reproduce(paper: str, tell: Any) -> Outcome:
        asked.append(paper)
        tell(1, 1)
        return OUTCOME

    monkeypatch.setattr(papers, "reproduce", reproduce)
    return asked


@pytest.mark.parametrize("paper", ["ball-screw", "slider"])
def test_it_writes_a_page_and_its_numbers(command: Command, quick: list[str], tmp_path: Path, paper: str) -> None:
    code, out, err = command("reproduce", paper, "-o", tmp_path / "new" / "folder", "--json", "-")
    assert code == 0, err
    assert quick == [paper]
    assert "simulated: D is 0.14." in err
    folder = tmp_path / "new" / "folder"
    written = json.loads((folder / f"{paper}.json").read_text(encoding="utf-8"))
    compared = written.pop("compared")
    assert json.loads(out) == {"compared": compared, **written}
    assert written == {"simulated": True, "answer": "D is 0.14.", "figure 5": {"viscous": 0.14}}
    assert [row["verdict"] for row in compared] == ["reproduced", "not drawn because"]
    page = (folder / f"{paper}.html").read_text(encoding="utf-8")
    assert page.index("not drawn because it is a photograph") < page.index("<h2>Fig. 5 - Speed</h2>")
    assert "As &lt;b&gt; in the paper." in page


def test_an_unknown_paper_is_refused_before_anything_is_written(command: Command, tmp_path: Path) -> None:
    code, out, err = command("reproduce", "ballscrew", "-o", tmp_path / "new")
    assert (code, out) == (2, "")
    assert "paper ballscrew; must be one of ball-screw, slider" in err
    assert not (tmp_path / "new").exists()
