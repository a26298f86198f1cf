"""`gap watch` and `gap drift` as a user types them."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest

from stagectl.twin.record import add
from tests.cli.conftest import Command
from tests.twin.test_twin_record import lines


@pytest.fixture
def record(tmp_path: Path) -> Path:
    path = tmp_path / "slow.jsonl"
    for line in lines({"viscous": -0.01}):
        add(path, {"format": "stagectl-twin/1", **line})
    return path


def snapshot(path: Path, **changes: Any) -> Path:
    """A live file as a twin writes it."""
    unknown = dict.fromkeys(("controller", "drive", "mechanics", "sensor"))
    shown = {
        **{"format": "stagectl-twin/1", "name": "a [b] stage", "kind": "rotary", "process": 1, "ended": "complete"},
        **{"written": time.time(), "time": 3.0, "covered": 3.0, "residual": unknown, "drift": {}, "verdict": "waiting"},
        **{"words": "too little motion yet", "form": "", "skipped_rows": 0, "behind": 0.1, "cpu_share": 0.05},
    }
    path.write_text(json.dumps({**shown, **changes}))
    return path


def test_drift_names_what_drifts_and_how_fast(command: Command, record: Path) -> None:
    code, out, said = command("gap", "drift", record, "--json", "-")
    assert code == 0, said
    answer = json.loads(out)
    assert answer["named"] == ["viscous"]
    assert answer["trends"]["viscous"]["slope"] == pytest.approx(-0.0014, rel=0.1)
    assert "viscous -1" in said
    assert "% a day" in said


def test_watch_shows_the_last_words_of_a_run_that_has_ended(command: Command, tmp_path: Path) -> None:
    path = snapshot(tmp_path / "a.twin.json", skipped_rows=512)
    code, _, said = command("gap", "watch", path)
    assert code == 0, said
    assert "the run has ended: complete" in said
    assert "a [b] stage" in said
    assert "512 rows were skipped: the twin had fallen behind" in said


def test_watch_says_that_a_twin_has_gone(command: Command, tmp_path: Path) -> None:
    path = snapshot(tmp_path / "a.twin.json", ended="", process=2**22 + 1, written=time.time() - 60.0)
    code, _, said = command("gap", "watch", path)
    assert code == 0, said
    assert "the twin's process 4194305 has ended; its last record is 60" in said


def test_watch_without_a_run_says_how_to_get_one(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, said = command("gap", "watch")
    assert code == 2
    assert "stagectl run STAGE TRAJECTORY --twin" in said
    other = tmp_path / "other.json"
    other.write_text("{}")
    code, _, said = command("gap", "watch", other)
    assert code == 2
    assert "stagectl-twin/1" in said
