"""The whole pipeline on machines of the exam: another integrator, other friction laws, wider shapes of the effects."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest

from stagectl.gap import diagnose
from stagectl.gap.logs import load_session
from stagectl.gap.logs.session import Session
from stagectl.gap.result.diagnosis import DiagnosisResult
from stagectl.gap.result.result_json import as_json
from stagectl.gap.steps import BEGINS, Step
from stagectl.gap.validation import rollouts
from tests.gap.captured import SINE, TRAPEZOID, exported, recorded
from tests.gap.drawn import by_night, diagnosed, drawn

FAST, SLOW = "sine-5.0 multisine-1 held-sine-b", "micro-8 sine-1.6 held-sine-b held-micro"


def _named(result: DiagnosisResult) -> list[str]:
    return [effect.name for effect in result.effects if effect.probability >= 0.5 and not effect.parameter]


def test_one_hidden_effect(tmp_path: Path) -> None:
    session = drawn(tmp_path, 3, "viscous_asymmetry", scale=2.0)
    done = diagnose.diagnose(session, diagnose.Options(advice=False), lambda _: None)
    result = done.result
    assert result.verdict == "effects" and _named(result) == ["viscous_asymmetry"]
    assert result.gap.closure > 0.8 and abs(result.gap.closure - (result.gap.predicted or 0.0)) < 0.1
    assert sum(share for _, share in result.shares) == pytest.approx(1.0, abs=1e-6)
    inertia = json.loads((tmp_path / "sealed" / "truth.json").read_text())["true"]["inertia"]
    assert done.improved.mechanics.inertia == pytest.approx(inertia, rel=0.01)
    assert set(as_json(result)) >= {"verdict", "effects", "gap", "where", "next_experiment"}
    assert [name for name, _ in result.seconds] == list(Step) == list(BEGINS)
    _check_predictions(session, done, tmp_path / "predictions")


@pytest.mark.parametrize(
    ("effect", "experiments"),
    [("current_gain", FAST), pytest.param("cogging", "scan sine-1.6 held-sine-b", marks=by_night)],
)
def test_a_small_effect_that_is_all_of_the_gap_is_named_and_no_unknown(
    tmp_path: Path, effect: str, experiments: str
) -> None:
    """At half its size, where a machine with larger gaps has it as a trace."""
    result = diagnosed(drawn(tmp_path, 7001, effect, scale=0.5, experiments=experiments))
    assert result.verdict == "effects" and _named(result) == [effect]


def test_a_current_that_is_read_off_its_zero_needs_no_constant_force(tmp_path: Path) -> None:
    """An offset of what the drive gives explains as much, with a constant force against it."""
    result = diagnosed(drawn(tmp_path, 605880760, "current_offset", scale=4.0, experiments=FAST))
    (offset,) = result.named
    assert offset.name == "current_offset" and offset.parameters["reported"].value == 1.0
    assert offset.parameters["current"].value == pytest.approx(0.1, abs=0.005)


@by_night
def test_a_viscous_friction_that_bends_downwards_is_no_stribeck_friction(tmp_path: Path) -> None:
    """Less than linear by a power of the speed: the exponent and its share come out with their intervals."""
    result = diagnosed(drawn(tmp_path, 3, "viscous_nonlinear", scale=2.0, experiments="stairs sine-5.0 held-sine-b"))
    assert result.verdict == "effects" and _named(result) == ["viscous_nonlinear"]


@pytest.mark.parametrize("seed", [pytest.param(3, marks=by_night), 4])  # early, late
def test_a_report_of_the_current_is_late_by_what_its_staircase_shows(tmp_path: Path, seed: int) -> None:
    """Half a period, of currents that are where they go to after a third of one: fast motions show all of it."""
    result = diagnosed(drawn(tmp_path, seed, "time_shift", scale=1.0, experiments=FAST))
    (shift,) = [effect for effect in result.effects if effect.name == "time_shift"]
    value = shift.parameters["time_shift"]
    assert result.verdict == "parameters" and abs(value.value) == pytest.approx(0.25e-3, abs=0.03e-3)
    assert value.low < value.value < value.high and value.high - value.low < 0.1e-3


@pytest.mark.parametrize(("seed", "damping"), [(5, 5.0), pytest.param(4, 0.466, marks=by_night)])
def test_a_slower_current_loop_is_no_time_shift(tmp_path: Path, seed: int, damping: float) -> None:
    """Of first order, and of second order with overshoot: 0.2 ms more lag."""
    result = diagnosed(drawn(tmp_path, seed, "current_loop", scale=1.0, experiments=FAST))
    loop = result.effects[0]
    assert _named(result) == ["current_loop"] and loop.probability > 0.9
    assert loop.parameters["lag"].value == pytest.approx(0.2e-3, rel=0.1)
    assert loop.parameters["damping"].value == pytest.approx(damping, rel=0.1)
    assert loop.parameters["damping"].low <= damping <= loop.parameters["damping"].high


def _check_predictions(session: Session, done: diagnose.Diagnosis, place: Path) -> None:
    """Anyone can recompute the gap from the files."""
    paths = rollouts.write_predictions(session, done.improved, place)
    held = [log for log in session.logs if log.held_out]
    assert [path.name for path in paths] == [log.name for log in held]
    first = pyarrow.csv.read_csv(paths[0]).to_pydict()
    difference = held[0].position - np.array(first["position_rad"])
    assert np.sqrt(np.mean(difference[1000:] ** 2)) < 1.5 * done.result.gap.before


def test_what_looks_like_a_bias_is_told_from_it_by_its_reversals(tmp_path: Path) -> None:
    """An asymmetry of the friction under another law: all but its way through the rolling zone is taken by the base."""
    result = diagnosed(drawn(tmp_path, 109, "coulomb_asymmetry", scale=2.0, experiments=SLOW))
    assert result.verdict == "effects" and _named(result) == ["coulomb_asymmetry"]


def test_another_friction_law_is_no_effect(tmp_path: Path) -> None:
    result = diagnosed(drawn(tmp_path, 2, stratum="null-law", experiments=SLOW))
    assert _named(result) == []
    assert result.verdict in ("none", "parameters")


def test_a_wrong_controller_is_told_and_the_rest_is_judged_by_the_logged_command(tmp_path: Path) -> None:
    session = drawn(tmp_path, 5, stratum="null-exact", experiments="sine-1.6 held-sine-b")
    assert session.law is not None
    pid = session.law.feedback
    wrong = session._replace(law=session.law._replace(feedback=pid._replace(integral=0.5 * pid.integral)))
    result = diagnosed(wrong)
    assert result.verdict == "controller" and _named(result) == []
    assert np.isfinite(result.gap.after) and result.gap.unit == "N m"
    assert "integral" in result.reason


def test_logs_without_a_force_tell_nothing(tmp_path: Path) -> None:
    session = drawn(tmp_path, 5, stratum="null-exact")
    bare = tuple(log._replace(command=None, current=None) for log in session.logs)
    result = diagnosed(session._replace(logs=bare, law=None))
    assert result.verdict == "not-identifiable" and "current" in result.reason


def test_a_machine_that_is_its_model_lacks_nothing(tmp_path: Path) -> None:
    """Without noise all that is left is rounding, the same in every repeat: it repeats, and is no gap."""
    session = load_session.load(
        [exported([*recorded(tmp_path, SINE), *recorded(tmp_path, TRAPEZOID)], tmp_path / "session")]
    )
    result = diagnosed(session)
    assert (result.verdict, _named(result), result.unknown, result.gap.before) == ("none", [], None, 0.0)
    assert any("copies" in note for note in result.notes)
