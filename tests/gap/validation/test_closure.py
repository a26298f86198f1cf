"""When a gap stays open, and how its shares are scaled."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.gap.effects.library import definitions
from stagectl.gap.logs import load_session
from stagectl.gap.residuals.sensitivities import model_of
from stagectl.gap.result.diagnosis import NOISE, UNEXPLAINED, Gap
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.refine import Fitted
from stagectl.gap.validation import closure
from stagectl.gap.validation.shapley import scaled
from stagectl.workflows.motion import prepare
from stagectl.workflows.simulated_motion import pretend
from tests.compensation.test_model_effects import SCALES, having
from tests.gap.captured import SINE


@pytest.mark.parametrize(
    ("after", "high", "stays"),
    [(60e-6, 0.75, True), (40e-6, 0.75, False), (60e-6, 0.85, False), (float("nan"), 0.75, False)],
)
def test_a_gap_that_stays_open(after: float, high: float, stays: bool) -> None:
    twice: Any = [SimpleNamespace(experiment="sine"), SimpleNamespace(experiment="sine")]
    assert closure.stays_open(Gap(80e-6, after, 10e-6, "m", high - 0.1, high - 0.2, high), twice) is stays


@pytest.mark.parametrize(("floor", "names"), [(0.0, ("sine", "sine")), (10e-6, ("sine",)), (10e-6, ("a", "a", "b"))])
def test_a_floor_that_is_not_known_lets_nothing_stay_open(floor: float, names: Sequence[str]) -> None:
    """Copies, a single run, and an experiment among others that ran once."""
    judged: Any = [SimpleNamespace(experiment=name) for name in names]
    assert not closure.stays_open(Gap(80e-6, 70e-6, floor, "m", 0.2, 0.1, 0.3), judged)


def gap(before: float, after: float, floor: float) -> Gap:
    return Gap(before, after, floor, "m", 0.0, 0.0, 0.0)


def test_shares_are_of_the_squared_gap_and_sum_to_one() -> None:
    """Of 100 units 64 go, in proportion 3 : 1; 4 are noise, and 32 stay."""
    shares = scaled({"parameters": 6.0, "dwell": 2.0}, gap(10.0, 6.0, 2.0))
    assert shares == pytest.approx({"parameters": 0.48, "dwell": 0.16, UNEXPLAINED: 0.32, NOISE: 0.04})
    assert sum(shares.values()) == pytest.approx(1.0)


def test_what_only_a_table_takes_is_unexplained() -> None:
    shares = scaled({"parameters": 6.0, UNEXPLAINED: 2.0}, gap(10.0, 6.0, 2.0))
    assert shares == pytest.approx({"parameters": 0.48, UNEXPLAINED: 0.16 + 0.32, NOISE: 0.04})


def test_where_there_is_no_gap_all_is_noise() -> None:
    assert scaled({"parameters": 1.0}, gap(0.0, 0.0, 0.0)) == {"parameters": 0.0, UNEXPLAINED: 0.0, NOISE: 1.0}


def test_a_model_that_takes_nothing_leaves_all_unexplained() -> None:
    assert scaled({"parameters": 0.0}, gap(10.0, 10.0, 1.0))[UNEXPLAINED] == pytest.approx(0.99)


def test_an_effect_that_surely_widens_the_gap_is_refuted() -> None:
    """The one that widens it most in the mean of the experiments; one experiment that never repeats is no reason."""
    widest, wider = np.array([1.2, 1.3, 1.1, 0.8, 0.4, 1.1]), np.array([0.3, 0.2, 0.4, 0.3, 0.2, 0.3])
    unsure = np.array([-0.2, 0.1, -0.1, 0.1, 0.0, 6.0])
    assert closure.most_harmful({"dwell": wider, "stribeck": widest, "cogging": unsure}) == "stribeck"
    assert closure.most_harmful({"cogging": unsure, "cable_spring": -widest, "dwell": np.array([5.0])}) == ""


@pytest.mark.parametrize(("times", "refuted"), [(1.0, ""), (0.5, ""), (-1.0, "viscous_asymmetry")])
def test_an_effect_of_the_wrong_sign_is_refuted(ball_screw: Setup, tmp_path: Path, times: float, refuted: str) -> None:
    """The machine has a viscous asymmetry; of half the right size it is still better than none."""
    effect = next(one for one in definitions(SCALES) if one.name == "viscous_asymmetry")
    machine = ball_screw._replace(stage=having(ball_screw.stage, effect, 1.0))
    for size in (4, 5, 6):
        motion, log = tmp_path / f"sine-{size}.yaml", tmp_path / f"sine-{size}.h5"
        motion.write_text(SINE.replace("5 mm", f"{size} mm"))
        pretend(prepare(ball_screw, motion, frozenset(), log), machine)
    session = load_session.load([tmp_path])
    values = {one.name: times * one.typical[0] for one in effect.amplitudes}
    now = Fitted(model_of(session.stage, session.dt), (EffectValues(effect, values),), [], 0.0)
    selected: Any = SimpleNamespace(fitted=now, beside=frozenset[str]())
    found = closure.in_closed_loop(session, selected, now.equipped.stage, session.logs)
    assert found.refuted == refuted


@pytest.mark.parametrize(("measured", "spared"), [(True, {"cogging", "current_offset"}), (False, {"cogging"})])
def test_no_gap_of_the_position_refutes_what_a_measured_current_shows(measured: bool, spared: set[str]) -> None:
    """The feedback hides an offset of 0.1 A from the position; what is left there is the friction's error of form."""
    valued = [SimpleNamespace(effect=SimpleNamespace(name=name, block=block)) for name, block in BLOCKS_OF.items()]
    selected: Any = SimpleNamespace(fitted=SimpleNamespace(effects=valued), beside=frozenset({"cogging"}))
    session: Any = SimpleNamespace(logs=[SimpleNamespace(current=np.ones(3) if measured else None)])
    assert closure.unjudged(session, selected) == spared


BLOCKS_OF = {"current_offset": "drive", "stribeck": "mechanics", "cogging": "mechanics"}


@pytest.mark.parametrize(
    ("members", "present"),
    [
        (set(), {}),
        ({"friction_lag"}, {}),  # of no curve
        ({"stribeck"}, {"friction_lag": 0.0}),
        ({"stribeck", "friction_lag", "cogging"}, {"friction_lag": 0.01, "cogging": None}),
    ],
)
def test_a_lag_has_a_share_beyond_that_of_the_curve_that_lags(
    members: set[str], present: dict[str, float | None]
) -> None:
    """A Stribeck friction that lags had all of the gap as its lag, and "takes none of the gap" as its curve."""
    known = {effect.name: effect for effect in definitions(SCALES)}
    lags = EffectValues(known["friction_lag"], {"rise": 0.1, "velocity": 1.0, "shape": 1.0, "lag": 0.01})
    waves = EffectValues(known["cogging"], {"sine": 0.1, "cosine": 0.0, "order": 4.0})
    among = closure._among([lags, waves], members)
    assert {each.effect.name: each.values.get("lag") for each in among} == present
