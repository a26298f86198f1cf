"""A diagnosis on the terminal."""

from __future__ import annotations

from pathlib import Path

import pytest
from rich.console import Console

from stagectl.cli import gap_show
from tests.gap.examples import every, found

FOUND = every()


@pytest.mark.parametrize("verdict", sorted(FOUND))
def test_the_sentence_comes_first_and_nothing_is_undefined(verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(width=160, record=True, markup=False, highlight=False)
    monkeypatch.setattr(gap_show, "console", console)
    gap_show.show(FOUND[verdict], Path("captures"))
    text = console.export_text()
    assert text.split("\n")[0].startswith(f"{FOUND[verdict].verdict}: {FOUND[verdict].sentence[:40]}")
    assert "nan" not in text and "None" not in text
    assert ("stagectl gap apply captures STAGE.yaml" in text) == any(effect.fields for effect in FOUND[verdict].named)


def test_many_captures_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(width=160, record=True, markup=False, highlight=False)
    monkeypatch.setattr(gap_show, "console", console)
    diagnosis = FOUND["effects"].captures[0]
    gap_show.show(found("effects", captures=(diagnosis,) * 11), Path("captures"))
    text = console.export_text()
    assert text.count("open in sine-1.6hz-1.csv") == gap_show.MOST_SPANS and "and 3 more captures" in text
    assert "where in the loop: controller 0 %, drive 3 %, mechanics 95 %, sensor 2 %" in text
