"""When the gap is open in each log."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.gap.inference import parameter_errors, swept_parameters, time_localisation
from stagectl.gap.result.diagnosis import FoundEffect, Value
from stagectl.gap.selection import refine
from stagectl.gap.selection.refine import Fitted

DT = 5e-4


def evidence(mechanics: float, drive: float, measured: bool = True, repeats: int = 2) -> Any:
    """Residuals of these sizes in one run of 100 rows, without noise."""
    rows = np.ones((1, 3)) if measured else np.array([[1.0, 1.0, np.nan]])
    run = SimpleNamespace(weight=np.ones(100), mean=SimpleNamespace(rows=rows), paths=(None,) * repeats)
    residual = np.tile([mechanics, drive], (100, 1))
    base = SimpleNamespace(before=[[residual] * repeats])
    deviations = [[np.zeros((100, 2))] * repeats]
    return SimpleNamespace(runs=[run], base=base, deviations=deviations, beside=None)


def test_the_excess_is_what_repeats_do_not_differ_by() -> None:
    """Two repeats that are 1 and -1 are their own noise; 1 + 2 and -1 + 2 have 4 a row beyond it."""
    e = evidence(0.0, 0.0)
    noise = np.ones((100, 2))
    e.deviations = [[noise, -noise]]
    assert refine.total(e, [[noise, -noise]]) - refine.floor(e) == pytest.approx(-400.0)
    assert refine.total(e, [[noise + 2.0, -noise + 2.0]]) - refine.floor(e) == pytest.approx(1200.0)


def test_a_rare_effect_is_measured_where_it_acts() -> None:
    """In 1 % of the rows, between 1 and 2: the 95 % quantile of these."""
    sizes = np.concatenate([np.zeros(9900), np.linspace(1.0, 2.0, 100)])
    assert time_localisation._quantile(sizes) == pytest.approx(1.95, abs=0.01)
    assert time_localisation._quantile(np.linspace(0.0, 1.0, 101)) == pytest.approx(0.95)


def test_a_jitter_acts_where_a_dead_time_of_its_size_would(ball_screw: Any) -> None:
    from stagectl.gap.residuals.sensitivities import TrackedModel

    model = TrackedModel(ball_screw.stage, None)  # type: ignore[arg-type]
    now: Any = SimpleNamespace(equipped=model, effects=())
    fields = (("drive.jitter", 1e-4),)
    effect = FoundEffect("jitter", (), 0.98, 0.0, {"rms": Value(1e-4, 0.0, 0.0, "s")}, "drive", fields)
    (part,) = time_localisation._of_drive(now, [effect])
    drive = ball_screw.stage.drive
    assert part.whole.stage.drive == drive._replace(dead_time=drive.dead_time + drive.jitter + 1e-4)
    assert part.less is model and part.block == "drive"
    assert time_localisation._of_drive(now, []) == []


def _flags(*spans: tuple[int, int]) -> time_localisation.Flags:
    flags = np.zeros(100, dtype=bool)
    for begin, end in spans:
        flags[begin:end] = True
    return flags


def test_spans_bridge_what_is_too_short_to_be_closed() -> None:
    assert time_localisation.stretches(_flags((10, 20), (22, 30), (50, 60)), DT) == ((0.005, 0.015), (0.025, 0.03))


def test_a_single_row_is_no_span() -> None:
    assert time_localisation.stretches(_flags((10, 11)), DT) == ()
    assert time_localisation.stretches(_flags((0, 100)), DT) == ((0.0, 0.05),)


def test_what_an_effect_does_counts_from_the_nominal_value_of_its_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine warms by 20 %: a nominal model of the cold one lacks that at the end, one of the warm one before."""
    taken_back: list[tuple[str, tuple[str, ...]]] = []

    def undone(_: Any, __: Any, rest: Any, *parameters: str) -> str:
        taken_back.append((",".join(valued.effect.name for valued in rest.effects), parameters))
        return "less"

    monkeypatch.setattr(parameter_errors, "undone", undone)
    monkeypatch.setattr(swept_parameters, "own_parameters", lambda *_: {"warming": ["viscous"]})
    effects = [
        SimpleNamespace(effect=SimpleNamespace(name=name, block="mechanics", time_variation=variation))
        for name, variation in (("warming", "decay"), ("ripple", None))
    ]
    now: Any = Fitted(SimpleNamespace(), tuple(effects), [], 0.0)  # type: ignore[arg-type]
    monkeypatch.setattr(Fitted, "equipped", "whole")
    parts = time_localisation._effects(None, None, now)  # type: ignore[arg-type]
    assert taken_back == [("ripple", ("viscous",)), ("warming", ())]
    assert [part.aging for part in parts] == [True, False]


def test_another_controller_opens_the_gap_where_its_command_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of the largest difference, and a single row that does not count, change nothing; no held-out log."""
    difference = np.zeros(100)
    difference[10:40], difference[60:80] = 1.0, -0.1
    difference[15] = np.nan
    comparisons = [
        SimpleNamespace(log=SimpleNamespace(name=name, rows=100, held_out=name == "held.csv"), difference=difference)
        for name in ("sine.csv", "held.csv")
    ]
    monkeypatch.setattr(time_localisation, "compared", lambda *_: comparisons)
    (spans,) = time_localisation.spans_of_command(SimpleNamespace(dt=DT), 1e-3)  # type: ignore[arg-type]
    assert spans.file == "sine.csv" and spans.spans == ((0.005, 0.02),) and spans.duration == 0.05
    monkeypatch.setattr(time_localisation, "compared", lambda *_: comparisons[1:])
    assert time_localisation.spans_of_command(SimpleNamespace(dt=DT), 1e-3) == ()  # type: ignore[arg-type]
