"""What follows no coordinate of the motion: machines of the exam whose effect is left out of the library."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from stagectl_studies.machine.stage_trial import stage_trial
from stagectl_studies.machine.trials import Options as Drawn
from stagectl_studies.machine.trials import draw

from stagectl.gap import diagnose
from stagectl.gap.inference import unstructured_residual
from stagectl.gap.logs import load_session
from stagectl.gap.residuals import sensitivities
from stagectl.gap.residuals.half_strokes import runs
from stagectl.gap.result import verdict_text
from stagectl.gap.result.diagnosis import UNORDERED, Gap, UnknownTerm
from stagectl.gap.selection import baseline_fit, refine
from stagectl.gap.validation import closure


@pytest.mark.parametrize(
    ("effect", "coordinate", "block", "words"),
    [
        ("base_vibration", "frequency", "mechanics", "rings"),
        ("thermal_viscous", "time", "mechanics", "from run to run"),
        ("current_loop", "frequency", "drive", "another current"),
    ],
)
def test_an_effect_left_out_is_told_by_where_it_is(
    tmp_path: Path, effect: str, coordinate: str, block: str, words: str
) -> None:
    stage_trial(draw(4711, "single", Drawn(short=True, effects=(effect,), scale=3.0)), tmp_path)
    session = load_session.load([tmp_path / "captures"])
    options = diagnose.Options(excluded=(effect,), advice=False)
    found = diagnose.diagnose(session, options, lambda _: None).found
    assert found.verdict in ("unknown", "effects+unknown") and found.unknown is not None
    assert (found.unknown.coordinate, found.unknown.block) == (coordinate, block)
    assert words in found.sentence and len(found.unknown.grid) == len(found.unknown.force) > 3


def test_what_stays_open_in_the_loop_is_unknown_whatever_lies_along_the_path(tmp_path: Path) -> None:
    """A gap between motor and load, left out: what is left may be friction's form, but the loop's gap stays."""
    stage_trial(draw(1418111386, "single", Drawn(short=True, effects=("backlash",), scale=4.0)), tmp_path)
    session = load_session.load([tmp_path / "captures"])
    found = diagnose.diagnose(session, diagnose.Options(excluded=("backlash",), advice=False), lambda _: None).found
    assert found.gap.after > 10.0 * found.gap.floor
    assert found.verdict == "unknown" and found.unknown == UNORDERED
    assert "no coordinate that was tried predicts most of it" in found.sentence


@pytest.mark.parametrize(
    ("after", "high", "stays"),
    [(60e-6, 0.45, True), (40e-6, 0.45, False), (60e-6, 0.55, False), (float("nan"), 0.45, False)],
)
def test_a_gap_that_stays_open(after: float, high: float, stays: bool) -> None:
    twice: Any = [SimpleNamespace(experiment="sine"), SimpleNamespace(experiment="sine")]
    assert closure.stays_open(Gap(80e-6, after, 10e-6, "m", high - 0.1, high - 0.2, high), twice) is stays


@pytest.mark.parametrize(("floor", "names"), [(0.0, ("sine", "sine")), (10e-6, ("sine",)), (10e-6, ("a", "a", "b"))])
def test_a_floor_that_is_not_known_lets_nothing_stay_open(floor: float, names: Sequence[str]) -> None:
    """Copies, a single run, and an experiment among others that ran once."""
    judged: Any = [SimpleNamespace(experiment=name) for name in names]
    assert not closure.stays_open(Gap(80e-6, 70e-6, floor, "m", 0.2, 0.1, 0.3), judged)


def test_the_noise_of_a_machine_that_ran_once_is_nothing_unknown(tmp_path: Path) -> None:
    stage_trial(draw(7, "null-exact", Drawn(short=True)), tmp_path)
    session = load_session.load([tmp_path / "captures"])
    once = session._replace(logs=tuple(log for log in session.logs if log.repeat == 1))
    found = diagnose.diagnose(once, diagnose.Options(advice=False), lambda _: None).found
    assert found.verdict == "none" and "floor not known" in found.sentence


def test_a_band_holds_what_lies_in_it(tmp_path: Path) -> None:
    """A sine of 40 Hz has all its squares, and its size, in the half octave around it."""
    stage_trial(draw(7, "null-exact", Drawn(short=True)), tmp_path)
    session = load_session.load([tmp_path / "captures"])
    training = runs(session)[:1]
    refitted = baseline_fit.refit(session, training, sensitivities.model_of(session, session.stage))
    e = refine.evidence(training, refitted)
    clock = training[0].mean.dt * 2.0 * np.arange(len(training[0].weight))
    found, edges = (
        unstructured_residual.powers(e, [np.sin(2.0 * np.pi * 40.0 * clock)]),
        unstructured_residual.edges_of(e),
    )
    at = int(np.searchsorted(edges, 40.0)) - 1
    assert found[at] == pytest.approx(0.5 * len(clock), rel=0.02) and found.sum() == pytest.approx(found[at], rel=0.02)


def test_words_of_a_band() -> None:
    shape = UnknownTerm("frequency", np.array([10.0, 20.0]), np.array([0.1, 0.4]), 0.8)
    assert verdict_text.where_unknown(shape).startswith("it rings, strongest near 20 Hz")
    assert "another current" in verdict_text.where_unknown(shape._replace(block="drive"))
