"""How a log begins: from rest or in the middle of a motion, and what the model makes of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.log_start import LogStart, initial_velocity, of_log
from stagectl.gap.residuals import model_tracking
from stagectl.gap.residuals.model_tracking import MeasuredPath
from stagectl.kernels import stage, tracked_model

CONFIG = Path(__file__).parents[2] / "config"
SETUP = load_stage(CONFIG / "ball-screw.yaml")


@pytest.fixture(scope="module")
def driven() -> MeasuredPath:
    """The stage in open loop under a current sine, sampled as a log is."""
    p, rows = SETUP.stage, np.empty((3000, 3))
    x, smooth = stage.at_rest(p, 1.0), p.encoder._replace(step=0.0)
    for k in range(len(rows)):
        command = 3.0 * math.sin(4.0 * math.pi * SETUP.dt * k)
        rows[k] = command, stage.measured(smooth, x, stage.SILENT), x.current
        x = stage.period(p, x, command, stage.SILENT, SETUP.dt, 10)
    return MeasuredPath(rows, 0.0, SETUP.dt)


def _residual(path: MeasuredPath) -> model_tracking.ModelResidual:
    tied = tracked_model.Tied(SETUP.stage, model_tracking.tracker(SETUP.stage, SETUP.dt))
    return model_tracking.tracking_residual(tied, path, 10)


@pytest.mark.parametrize(
    ("machine", "motion"),
    [("ball-screw", "sine-1.6hz"), ("ball-screw", "sine-2um"), ("linear-slider", "slider-dwell")],
)
def test_a_motion_of_ours_begins_at_rest(machine: str, motion: str) -> None:
    """To the last bit: a model that begins at rest beside the machine has no residual of its own."""
    ran = sc.simulate(CONFIG / f"{machine}.yaml", CONFIG / "trajectories" / f"{motion}.yaml")
    assert initial_velocity(np.asarray(ran["measured"], dtype=np.float64), SETUP.dt) == 0.0


def test_a_parabola_from_rest_and_noise_have_no_velocity() -> None:
    t = SETUP.dt * np.arange(200, dtype=np.float64)
    assert initial_velocity(5.0 * t * t, SETUP.dt) == 0.0
    assert initial_velocity(100.0 * t**3, SETUP.dt) == 0.0
    for spread in (0.1, 0.5, 3.0):  # of an encoder at rest, counts
        counts = np.round(0.4 + spread * np.random.default_rng(1).standard_normal((500, 9)))
        assert sum(initial_velocity(rows, SETUP.dt) != 0.0 for rows in counts) <= 2
    assert initial_velocity(np.array([0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 1.0, 2.0, 2.0]), SETUP.dt) == 0.0


def test_the_velocity_in_the_middle_of_a_motion(driven: MeasuredPath) -> None:
    position = driven.rows[:, 1]
    for row in (300, 700, 1300, 1700):
        true = (position[row + 1] - position[row - 1]) / (2.0 * SETUP.dt)
        assert initial_velocity(position[row:], SETUP.dt) == pytest.approx(true, rel=0.02)


def test_a_log_cut_from_a_motion_leaves_no_residual(driven: MeasuredPath) -> None:
    """From the first row on, where a model that begins at rest is far off until the tracker has caught it."""
    cut = driven._replace(rows=driven.rows[700:])
    friction = stage.sliding(SETUP.stage.friction)
    assert np.abs(_residual(cut).effort).max() < 0.1 * friction
    p = SETUP.stage
    still = LogStart(float(cut.rows[0, 1]), 0.0).plant(p, SETUP.dt)
    moving = of_log(cut.rows[:, 1], cut.rows[:, 0], 0.0, SETUP.dt).plant(p, SETUP.dt)
    assert still.velocity == 0.0 and moving.velocity != 0.0
    assert stage.measured(p.encoder._replace(step=0.0), moving, stage.SILENT) == pytest.approx(cut.rows[0, 1], abs=1e-9)


def test_what_is_left_of_the_noise_at_rest_is_no_velocity() -> None:
    """The moving mean of a rest is smooth, and ends where it has fewer rows: that looks like a motion."""
    source = np.random.default_rng(2)
    for _ in range(20):
        position = np.round(source.standard_normal(400)) * 6e-6
        rows = np.column_stack([np.zeros(400), position, np.zeros(400)])
        path = model_tracking.at_rest(MeasuredPath(rows, 3.0, SETUP.dt), True, [(0, 400)])
        assert path.begins.going_on == (0.0, 0.0) and path.begins.clock == 3.0
