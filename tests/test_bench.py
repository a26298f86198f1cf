"""The page of figures against peers: what it says of a comparison, and that losses stand beside wins."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import pytest
from stagectl_studies.exam import ledger

from tests.conftest import ROOT

BENCH = ROOT / "tools" / "bench"


@pytest.fixture
def peers_page(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(BENCH))
    yield importlib.import_module("peers_page")
    sys.modules.pop("peers_page")


def line(low: float, median: float, high: float, what: str = "time of a fit") -> dict[str, Any]:
    spread = {"low": low, "median": median, "high": high}
    unity = {"low": 1.0, "median": 1.0, "high": 1.0}
    topic = {"topic": "Identification", "peer": "scipy", "what": what, "unit": "s", "method": "in turn"}
    return {**topic, "ours": unity, "theirs": spread, "ratio": spread}


def figures(*lines: dict[str, Any]) -> dict[str, Any]:
    exams = [one["scores"] for one in ledger.read(ROOT / "docs" / "exam-ledger.jsonl")]
    scores = [one for one in exams if "null, false alarms" in one][-1]  # of a diagnosis, not of machines closed alone
    return {
        "parts": {"identification": {"against": list(lines), "skipped": {"cycle": "no hardware"}}},
        "machine": "x86_64",
        "date": "2026-11-22",
        "load": 1.0,
        "versions": {"Python": "3.11"},
        "exam": {
            "last": {"date": "2026-11-22", "version": "0123456", "full": False, "trials": 9, "scores": scores},
            "beside": [],
        },
    }


@pytest.mark.parametrize(
    ("spread", "word"),
    [
        ((2.0, 3.0, 4.0), "ahead"),
        ((0.2, 0.3, 0.4), "behind"),
        ((0.9, 3.0, 4.0), "open"),  # the rounds do not agree
        ((0.2, 0.3, 1.1), "open"),
        ((1.01, 1.05, 1.2), "open"),  # too close
    ],
)
def test_nobody_is_ahead_by_chance(peers_page: Any, spread: tuple[float, float, float], word: str) -> None:
    assert peers_page.standing(line(*spread)) == word


def test_the_page_begins_with_wins_and_losses(peers_page: Any, tmp_path: Path) -> None:
    lines = figures(line(2.0, 3.0, 4.0), line(0.2, 0.25, 0.4, "installation"), line(0.9, 1.0, 1.1))
    peers_page.write_all(lines, tmp_path / "bench.html", tmp_path / "peers.md")
    words = "Ahead in 1 of 3 comparisons, behind in 1, open in 1. Furthest behind: installation, 4 x that of scipy."
    html, markdown = (tmp_path / "bench.html").read_text(), (tmp_path / "peers.md").read_text()
    assert words in html and words in markdown
    for text in (html, markdown):
        assert "no hardware" in text
        assert "No exam with the baselines" in text
        assert "single effect, top-1" in text
    assert "| installation | scipy | 1 s | 0.25 s | 0.25 x | 0.2 to 0.4 | behind |" in markdown


def test_baselines_of_an_exam_are_shown(peers_page: Any, tmp_path: Path) -> None:
    rows = [
        {"name": "single, top-1", "value": 0.9, "trials": 8},
        {"name": "closure, single effect", "value": None, "trials": 0},
    ]
    lines = figures(line(2.0, 3.0, 4.0))
    lines["exam"]["beside"] = [{"name": name, "rows": rows} for name in ("diagnosis", "sparse")]
    peers_page.write_all(lines, None, tmp_path / "peers.md")
    text = (tmp_path / "peers.md").read_text()
    assert "| single, top-1 | 90 % | 90 % | 8 |" in text
    assert "| closure, single effect | - | - | 0 |" in text
    assert "No exam with the baselines" not in text
