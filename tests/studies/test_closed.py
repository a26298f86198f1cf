"""The exam's stratum of machines that are closed: its plan, a trial from end to end, and what is made of the errors."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stagectl_studies.exam import closed
from stagectl_studies.exam.closed_table import rows, section
from stagectl_studies.exam.plan import CLOSED, ExamError, Planned, plan
from stagectl_studies.exam.question import Manner
from stagectl_studies.exam.run_trial import Job, sit
from stagectl_studies.exam.totals import totals
from stagectl_studies.foreign.axis import Axis
from stagectl_studies.machine.controller import Model
from stagectl_studies.machine.machine import MAXWELL, Body, Drive, Law, Machine

from stagectl.config.stage_file import Setup, load_stage
from tests.conftest import CONFIG

ANSWERING = Path(__file__).parent / "answering"


def test_the_plan_deals_sizes_and_laws_evenly() -> None:
    made = plan(30, 3, (CLOSED,))
    assert Counter(len(trial.effects) for trial in made) == {1: 10, 2: 10, 3: 10}
    assert Counter(trial.law for trial in made) == {"dahl": 15, "bristle": 15}
    assert "controller" not in {name for trial in made for name in trial.effects}
    assert CLOSED not in {trial.stratum for trial in plan(300, 3)}  # only where it is asked for


@pytest.fixture(scope="module")
def sat(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A trial that a stand-in answers, which moves the machine twice and changes nothing."""
    manner = Manner(short=True, module="closing", code=str(ANSWERING))
    planned = Planned(1, CLOSED, 5, ("viscous_asymmetry",), 4.0, law="bristle")
    return sit(Job(planned, str(tmp_path_factory.mktemp("exam")), manner))


def test_a_trial(sat: dict[str, Any]) -> None:
    """The examinee saw no true position, each run had noise of its own, and the true errors are the exam's own."""
    assert (sat["state"], sat["reasons"]) == ("scored", [])
    assert sat["answer"] == {"named": ["cogging"], "ended": "blind: True, alike: False"}
    rms, closing = sat["closing"]["rms"], sat["closing"]
    assert rms["before"] == rms["after"] and 1e-9 < rms["oracle"] < 0.25 * rms["before"]
    assert (closing["realised"], closing["stated"], closing["foretold"]) == (0.0, 0.75, 0.75)


def test_its_totals(sat: dict[str, Any]) -> None:
    summary = totals([sat])
    over, _, worse, start, points = summary["rows"]
    assert summary["strata"] == {CLOSED: 1} and over["value"] > 4.0 and over["reached"] == "no"
    assert (worse["value"], start["value"], points["value"]) == (0.0, 1.0, 75.0)
    (table,) = section([sat]).tables  # type: ignore[union-attr]
    assert table.rows[0][:4] == ["1", "bristle", "viscous_asymmetry x4", "cogging"]


def test_what_the_rows_ask() -> None:
    def record(after: float, foretold: float | None) -> dict[str, Any]:
        rms = {"before": 4.0, "after": after, "oracle": 2.0}
        return {"closing": {"rms": rms, "true": rms, "realised": 1.0 - after**2 / 16.0, "foretold": foretold}}

    over, _, worse, _, points = rows([record(2.4, 0.65), record(2.0, 0.78), record(4.4, None)])
    assert (over.value, over.reached) == (pytest.approx(1.2), "target")
    assert (worse.value, worse.reached) == (pytest.approx(1.0 / 3.0), "no")
    assert (points.value, points.trials, points.reached) == (pytest.approx(2.0), 2, "target")
    assert rows([]) == [] and section([]) is None


def test_the_oracle_is_as_good_as_the_exact_model() -> None:
    """Of a machine that a stage file can describe, the inverse that is learned and that of its model track alike."""
    law = Law(MAXWELL, np.array([0.4, 0.6]), np.array([2000.0, 500.0]))
    body, drive = Body(0.01, 0.14, 1.0, 0.0), Drive(quantum=0.004)
    exact = Model(body.inertia, body.viscous, 0.72, law.weights * body.coulomb, 1.0 / law.inverse_slip)
    wrong = exact._replace(weight=0.9 * exact.weight)
    before, after = (_setup(model) for model in (wrong, exact))
    for rms in closed.levels(Axis(Machine(law, body, drive=drive), 3), before, after):  # as measured, and true
        assert rms["before"] > 2.0 * rms["after"]
        assert rms["oracle"] == pytest.approx(rms["after"], rel=0.1)


def _setup(model: Model) -> Setup:
    return load_stage(CONFIG / "ball-screw.yaml", text=closed.stage_text(model))


def test_no_ground_of_a_record(tmp_path: Path) -> None:
    planned = plan(1, 1, (CLOSED,))[0]._replace(ground=object())  # type: ignore[arg-type]
    with pytest.raises(ExamError, match="leave --on out"):
        closed.staged(planned, tmp_path, short=True)
