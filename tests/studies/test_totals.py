"""Rows of an exam against an examinee whose skill is known."""

from typing import Any

import pytest
from stagectl_studies.exam.plan import QUOTAS
from stagectl_studies.exam.rows import Asked, rate
from stagectl_studies.exam.totals import totals

from tests.studies.made import records


@pytest.fixture(scope="module")
def summary() -> dict[str, Any]:
    return totals(records(600, 3))


def row(summary: dict[str, Any], name: str) -> dict[str, Any]:
    line: dict[str, Any] = next(row for row in summary["rows"] if row["name"].strip() == name)
    return line


def test_every_trial_counts(summary: dict[str, Any]) -> None:
    assert summary["strata"] == {name: 2 * count for name, count in sorted(QUOTAS.items())}
    assert row(summary, "null, false alarms")["trials"] == 72 and row(summary, "pairs, all found")["trials"] == 72
    assert row(summary, "triples, all found")["trials"] == row(summary, "effect left out: unknown")["trials"] == 66


def test_skill_comes_back(summary: dict[str, Any]) -> None:
    """Named with 0.9 and rightly with 0.9: 0.81 of large singles, 0.66 of pairs, 0.53 of triples; nothing for nulls."""
    for name, wanted in (
        ("single effect, top-1 at >= 2x its limit", 0.81),
        ("pairs, all found", 0.81**2),
        ("triples, all found", 0.81**3),
        ("effect left out: unknown", 0.9),
        ("alien effect: unknown", 0.9),
        ("null, false alarms", 0.0),
    ):
        line = row(summary, name)
        assert line["low"] <= wanted <= line["high"], (name, line)
        assert line["high"] - line["low"] < 0.27


def test_what_experiments_bring(summary: dict[str, Any]) -> None:
    """The examinee is right after one experiment and asks for no second: then its answer stands."""
    rows = [row(summary, f"poor battery, named first {when}") for when in ("at once", "after one experiment")]
    assert rows[0]["low"] <= 0.81 <= rows[0]["high"] and rows[0]["trials"] == 66
    assert rows[1]["value"] == row(summary, "poor battery, named first after two experiments")["value"] == 1.0
    assert row(summary, "poor battery, set holds the effect at once")["value"] == rows[0]["value"]
    assert row(summary, "poor battery, experiments run")["value"] == 1.0


def test_limits_are_where_half_is_noticed(summary: dict[str, Any]) -> None:
    """At half the typical size the examinee sees 0.45 of them, at typical size 0.9; a class has 5 to 40 trials."""
    sizes = list(summary["limits"].values())
    assert max(sizes) < 1.0 and 0.35 < sum(sizes) / len(sizes) < 0.75


def test_baselines_stand_beside(summary: dict[str, Any]) -> None:
    naming = {record["name"]: record["rows"][1]["value"] for record in summary["beside"]}
    assert naming["oracle"] is None  # it was told the names
    assert naming["refit"] == 0.0 and 0.4 < naming["sparse"] < 0.6
    assert set(naming) == {"diagnosis", "oracle", "refit", "sparse"}
    assert summary["oracle_ratios"] == pytest.approx([1.0] * len(summary["oracle_ratios"])) and summary["oracle_ratios"]


def test_confusion_adds_up(summary: dict[str, Any]) -> None:
    assert sum(count for _, _, count in summary["confusion"]) == 192 + 72


def test_void_trials_do_not_count() -> None:
    some = records(30, 5)
    some[4] = {"number": 5, "stratum": some[4]["stratum"], "state": "void", "reasons": ["opened early"]}
    summary = totals(some)
    assert summary["void"] == [{"number": 5, "reasons": ["opened early"]}]
    assert sum(summary["strata"].values()) == 29 and summary["trials"] == 30


def test_what_is_reached() -> None:
    asked = Asked(0.9, 0.5)
    verdicts = [rate("", [True] * hits + [False] * (10 - hits), asked).reached for hits in (4, 5, 9)]
    assert verdicts == ["no", "must", "target"]
    assert rate("", [True], Asked(0.03, 0.08, True)).reached == "no" and rate("", [], asked).reached == ""
