"""The slow record and the trend in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.gap.logs.session import GapError
from stagectl.twin.drift import DAY, drift
from stagectl.twin.record import add, line_of, read
from tests.twin.live import machine, seen

ABOUT = {"name": "stage A", "kind": "rotary"}
NOMINAL = {"inertia": 0.01, "viscous": 0.14, "coulomb": 1.0}


def lines(rates: dict[str, float], scatter: float = 0.002, count: int = 40, seed: int = 5) -> list[dict[str, Any]]:
    """A line each quarter of a day; `rates` are shares a day, `scatter` the share that each line is off by."""
    source, report = np.random.default_rng(seed), []
    for number in range(count):
        day = 0.25 * number
        entries = {}
        for name, nominal in NOMINAL.items():
            value = nominal * (1.0 + rates.get(name, 0.0) * day + source.normal(0.0, scatter))
            entries[name] = {"value": value, "error": 0.0005 * nominal, "scale": nominal, "unit": "SI"}
        report.append({"name": "stage A", "time": 1.7e9 + day * DAY, "drift": entries})
    return report


def test_the_viscous_friction_that_falls_is_named_with_its_rate() -> None:
    report = drift(lines({"viscous": -0.01}))
    assert report.named == ("viscous",)
    trends = {trend.name: trend for trend in report.trends}
    slope = trends["viscous"]
    assert slope.slope == pytest.approx(-0.01 * 0.14, rel=0.1)
    assert abs(slope.slope + 0.0014) < slope.half < 0.1 * 0.0014
    assert slope.days == pytest.approx(9.75)
    assert slope.start == pytest.approx(0.14, rel=0.01)
    assert "viscous -1" in report.sentence
    assert not trends["inertia"].drifts


def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    """The lines scatter four times more than they say: the interval must know."""
    missed = 0
    for seed in range(200):
        trend = next(t for t in drift(lines({"viscous": 0.01}, seed=seed, count=12)).trends if t.name == "viscous")
        missed += abs(trend.slope - 0.0014) > trend.half
    assert 2 <= missed <= 20  # of 200 at 95 %


def test_nothing_drifts_is_an_answer() -> None:
    report = drift(lines({}))
    assert report.named == ()
    assert report.sentence == "nothing drifts beyond 3 % over 9.75 days"
    assert drift(lines({"viscous": 0.001})).named == ()  # 1 % in all: sure, and nobody cares


def test_all_by_one_factor_is_the_force_constant_or_the_gain() -> None:
    report = drift(lines({"inertia": 0.01, "viscous": 0.01, "coulomb": 0.01}))
    assert report.named == ("force_constant",)
    assert report.alternatives == ("current_gain",)
    assert "-1" in report.sentence.split(" %")[0]  # less effort of one ampere: everything seems heavier
    apart = drift(lines({"inertia": 0.01, "viscous": 0.02, "coulomb": 0.015}))
    assert apart.named == ("viscous", "coulomb", "inertia")


def test_a_changed_stage_file_leaves_no_step(ball_screw: Setup, tmp_path: Path) -> None:
    """The machine is the same; the file learns of it in between."""
    plant = machine(ball_screw, viscous=0.168)
    for day, setup in enumerate((ball_screw, ball_screw, machine(ball_screw, viscous=0.168))):
        line = line_of(ABOUT, seen(setup, plant), day * DAY)
        assert line is not None
        assert line["named"] == (["viscous"] if setup is ball_screw else [])
        add(tmp_path / "slow.jsonl", line)
    report = drift(read(tmp_path / "slow.jsonl"))
    assert report.named == ()
    viscous = next(trend for trend in report.trends if trend.name == "viscous")
    assert viscous.start == pytest.approx(0.168, rel=0.005)


def test_a_line_that_was_cut_off_is_left_out_and_garbage_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "slow.jsonl"
    for line in lines({}, count=3):
        add(path, {"format": "stagectl-twin/1", **line})
    whole = path.read_text()
    path.write_text(whole + '{"format": "stagectl-tw')
    assert len(read(path)) == 3
    path.write_text("no record\n" + whole)
    with pytest.raises(GapError, match=r"slow\.jsonl:1 "):
        read(path)
    with pytest.raises(GapError, match=r"none\.jsonl"):
        read(tmp_path / "none.jsonl")


def test_too_few_lines_and_several_axes_are_refused() -> None:
    with pytest.raises(GapError, match="2 lines"):
        drift(lines({}, count=2))
    two = [*lines({}, count=3), *({**line, "name": "other"} for line in lines({}, count=3))]
    with pytest.raises(GapError, match="--axis"):
        drift(two)
    assert drift(two, "other").named == ()
    with pytest.raises(GapError, match="--axis third"):
        drift(two, "third")
