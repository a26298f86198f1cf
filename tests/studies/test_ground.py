"""An exam on the ground of a record: its machine rubs, weighs and measures as the axis of that record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from stagectl_studies.exam.exam import Asked, prepared
from stagectl_studies.exam.ground import TRAVEL, ground_of
from stagectl_studies.exam.plan import ExamError
from stagectl_studies.exam.question import Manner
from stagectl_studies.exam.staging import drawn

import stagectl as sc
from tests.conftest import CONFIG

SINE = "type: sine\namplitude: {amplitude}\nfrequency: 1.6 Hz\nperiods: 6\n"


def recorded(folder: Path, name: str, amplitude: str) -> tuple[Path, Path]:
    """A simulated sine of the stage of this name: the record, and the stage."""
    stage = CONFIG / f"{name}.yaml"
    (folder / "sine.yaml").write_text(SINE.format(amplitude=amplitude))
    record = sc.simulate(stage, folder / "sine.yaml").save(folder / "record.h5")
    return record, stage


@pytest.fixture(scope="module")
def ball_screw(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return recorded(tmp_path_factory.mktemp("ground"), "ball-screw", "10 mm")


def test_a_record_of_the_exam_s_own_kind_of_stage_is_found_as_it_is(ball_screw: tuple[Path, Path]) -> None:
    ground = ground_of(*ball_screw)
    assert ground.body.inertia == pytest.approx(0.010)
    assert ground.body.viscous == pytest.approx(0.14, rel=0.02)
    assert ground.body.coulomb == pytest.approx(1.0, rel=0.02)
    assert ground.law.weights.sum() == pytest.approx(1.0)
    assert bool(np.all(np.diff(ground.law.inverse_slip) < 0.0))  # the longest element is the last
    assert ground.step == pytest.approx(2.0 * np.pi / 2**20)


def test_a_slider_keeps_its_ratios(tmp_path: Path) -> None:
    """Damping by mass, friction by mass and slip by travel."""
    stage = sc.load_stage(CONFIG / "linear-slider.yaml").setup.stage
    ground = ground_of(*recorded(tmp_path, "linear-slider", "10 mm"))
    assert ground.body.viscous / ground.body.inertia == pytest.approx(20.0 / 6.0, rel=0.1)
    assert ground.body.coulomb / ground.body.inertia * TRAVEL == pytest.approx(4.5 / 6.0, rel=0.1)
    true, found = stage.friction.operators, ground.law
    mean = np.dot(true.weight, true.slip) / np.sum(true.weight)
    assert TRAVEL * np.dot(found.weights, 1.0 / found.inverse_slip) == pytest.approx(mean, rel=0.5)


def test_the_trials_are_drawn_on_it_and_the_exam_says_so(ball_screw: tuple[Path, Path], tmp_path: Path) -> None:
    ground, asked = ground_of(*ball_screw), Asked(2, 5, ("single-2",), *map(str, ball_screw))
    for planned in prepared(tmp_path / "exam", asked, Manner(short=True), False):
        (without,) = drawn(planned, short=True).without
        assert without.machine.body == ground.body and without.machine.drive.sensor_noise == ground.sensor_noise
    with pytest.raises(ExamError):
        prepared(tmp_path / "exam", asked._replace(on=""), Manner(short=True), True)
    with pytest.raises(ExamError):
        prepared(tmp_path / "exam", asked._replace(stage=str(CONFIG / "emps.yaml")), Manner(short=True), True)


def test_a_folder_is_no_record(ball_screw: tuple[Path, Path]) -> None:
    with pytest.raises(ExamError):
        ground_of(ball_screw[0].parent, ball_screw[1])
