"""Logs of other hands: positions with more noise than their encoder rounds, and a loop that nobody would run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.api.record import MotionRecord
from tests.conftest import CONFIG

STAGE = CONFIG / "ball-screw.yaml"


@pytest.fixture(scope="module")
def moved() -> MotionRecord:
    return sc.simulate(STAGE, CONFIG / "trajectories" / "sine-1.6hz.yaml")


@pytest.mark.parametrize("counts", [1.0, 10.0, 60.0])
def test_noise_that_the_stage_file_does_not_state_does_not_take_the_inertia(
    tmp_path: Path, moved: MotionRecord, counts: float
) -> None:
    """Nine counts of white noise had left 0.6 % of the inertia, within an interval of 2 %."""
    stage = sc.load_stage(STAGE)
    noise = counts * stage.setup.file.encoder.one_count * np.random.default_rng(3).standard_normal(len(moved["time"]))
    columns = (moved["time"], moved["measured"] + noise, moved["measured_current"], moved["reference"])
    log = tmp_path / "log.csv"
    header = "time_s,position_rad,current_A,reference_rad"
    np.savetxt(log, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.10g")
    found = sc.identify(STAGE, log).parameters
    truth = stage.setup.stage.mechanics
    assert found["inertia"].value == pytest.approx(truth.inertia, rel=0.01)
    assert found["viscous"].value == pytest.approx(truth.viscous, rel=0.01)
    assert found["coulomb"].value == pytest.approx(1.0, rel=0.02)


def test_a_loop_that_must_not_run_is_no_reason_to_refuse_a_log(tmp_path: Path, moved: MotionRecord) -> None:
    """Whatever moved the axis: no controller of the stage file takes part."""
    text = STAGE.read_text().replace("eds: drives/", f"eds: {CONFIG / 'drives'}/")
    stage = tmp_path / "stage.yaml"
    stage.write_text(text.replace("bandwidth: 40 Hz", "bandwidth: 130 Hz"))
    with pytest.raises(sc.StageError):
        sc.load_stage(stage)
    found = sc.identify(stage, moved, "least-squares").parameters
    assert found["inertia"].value == pytest.approx(0.01, rel=0.02)
