"""The scores of an identification campaign: what counts as held, as wide and as wrong in silence."""

from __future__ import annotations

import importlib
import io
from typing import Any

import pytest
from rich.console import Console

from tests.conftest import ROOT

TRUTH = {"inertia": 0.01, "viscous": 0.14, "coulomb": 1.0, "delay": 1e-3}
HALF = {"inertia": 1e-4, "viscous": 1e-3, "coulomb": 1e-2}


@pytest.fixture
def scores(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(ROOT / "tools" / "bench"))
    return importlib.import_module("campaign_scores")


def outcome(scores: Any, seed: int, inertia: tuple[float, float, float] | None) -> Any:
    setting = {"seed": seed, "law": "dahl", "motion": "sine", "counts": 4096, "row": 5e-4, "duration": 10.0}
    setting |= {"column": "command", "reference": True}
    intervals = {} if inertia is None else {"inertia": inertia, "delay": (1.2e-3, 0.9e-3, 1.5e-3)}
    oracle = {"shape_known": HALF, "law_known": {**HALF, "delay": 1e-4}, "estimates": {**TRUTH, "viscous": 0.15}}
    return scores.Outcome(setting, TRUTH, oracle, 0.5, "" if inertia else "noise", "too coarse", intervals)


def test_an_interval_that_is_not_stated_holds_nothing(scores: Any) -> None:
    answer = outcome(scores, 1, (0.0102, 0.0099, 0.0105))
    assert [answer.holds(name) for name in scores.LABELS] == [True, False, False, True]


def test_errors_are_relative_but_that_of_the_delay(scores: Any) -> None:
    answer = outcome(scores, 1, (0.0102, 0.0099, 0.0105))
    assert answer.error("inertia") == pytest.approx(0.02)
    assert answer.error("delay") == pytest.approx(0.2e-3)


def test_widths_are_over_the_oracles(scores: Any) -> None:
    answer = outcome(scores, 1, (0.0102, 0.0099, 0.0105))
    assert answer.width("inertia", "shape_known") == pytest.approx(3.0)
    assert answer.width("delay", "law_known") == pytest.approx(3.0)
    assert [outcome(scores, 1, None).oracle_holds(name) for name in HALF] == [True, False, True]


def test_the_tables_count(scores: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(file=io.StringIO(), width=170)
    monkeypatch.setattr(scores, "console", console)
    held, wrong = outcome(scores, 1, (0.0102, 0.0099, 0.0105)), outcome(scores, 77, (0.009, 0.0089, 0.0091))
    scores.show([held, wrong, outcome(scores, 3, None)])
    text = console.file.getvalue()  # type: ignore[attr-defined]
    every = next(line for line in text.splitlines() if line.split()[:1] == ["all"])
    assert "2/3 67%" in every and "1/2 50%" in every
    silent = text[text.index("Wrong in silence") :]
    assert "77" in silent and "-10.00" in silent


def test_nothing_at_all_is_shown_as_such(scores: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(file=io.StringIO())
    monkeypatch.setattr(scores, "console", console)
    scores.show([])
    assert console.file.getvalue().strip() == "no capture"  # type: ignore[attr-defined]
