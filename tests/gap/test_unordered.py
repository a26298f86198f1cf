"""What follows no coordinate of the motion: machines of the exam whose effect is left out of the library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stagectl.exam.trials import Options as Drawn
from stagectl.exam.trials import draw, stage_trial
from stagectl.gap import base, columns, diagnose, folder, refine, told, unordered
from stagectl.gap.found import Shape
from stagectl.gap.runs import runs


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
    session = folder.load([tmp_path / "captures"])
    options = diagnose.Options(excluded=(effect,), advice=False)
    found = diagnose.diagnose(session, options, lambda _: None).found
    assert found.verdict in ("unknown", "effects+unknown") and found.unknown is not None
    assert (found.unknown.coordinate, found.unknown.block) == (coordinate, block)
    assert words in found.sentence and len(found.unknown.grid) == len(found.unknown.force) > 3


def test_a_band_holds_what_lies_in_it(tmp_path: Path) -> None:
    """A sine of 40 Hz has all its squares, and its size, in the half octave around it."""
    stage_trial(draw(7, "null-exact", Drawn(short=True)), tmp_path)
    session = folder.load([tmp_path / "captures"])
    training = runs(session)[:1]
    refitted = base.refit(session, training, columns.model_of(session, session.stage))
    e = refine.evidence(training, refitted)
    clock = training[0].mean.dt * 2.0 * np.arange(len(training[0].weight))
    found, edges = unordered.powers(e, [np.sin(2.0 * np.pi * 40.0 * clock)]), unordered.edges_of(e)
    at = int(np.searchsorted(edges, 40.0)) - 1
    assert found[at] == pytest.approx(0.5 * len(clock), rel=0.02) and found.sum() == pytest.approx(found[at], rel=0.02)


def test_words_of_a_band() -> None:
    shape = Shape("frequency", np.array([10.0, 20.0]), np.array([0.1, 0.4]), 0.8)
    assert told.where_unknown(shape).startswith("it rings, strongest near 20 Hz")
    assert "another current" in told.where_unknown(shape._replace(block="drive"))
