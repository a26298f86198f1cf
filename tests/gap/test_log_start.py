"""How a log begins: from rest or in the middle of a motion, and what the model makes of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.config.stage_file import load_stage
from stagectl.gap.controller_check.command_check import check_command
from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.log_start import LogStart, initial_velocity, of_log
from stagectl.gap.residuals import model_tracking
from stagectl.gap.residuals.model_tracking import MeasuredPath
from stagectl.gap.validation import rollouts
from stagectl.kernels import stage, tracked_model
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.trajectories import Sine
from stagectl.twin.estimate import status_of
from tests.gap.captured import recorded
from tests.twin.live import beside, followed

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


BRAKE = "brake: {control: drive, release: 30 ms, engage: 50 ms}\n"


def behind_a_brake(folder: Path, load: str, brake: str = BRAKE) -> Path:
    """The stage with a `load` on it, which a brake holds before the motion."""
    text, line = (CONFIG / "ball-screw.yaml").read_text(encoding="utf-8"), "  viscous: 0.14 N m s/rad\n"
    assert line in text
    (folder / "drives").symlink_to(CONFIG / "drives")
    path = folder / "stage.yaml"
    path.write_text(text.replace(line, line + load) + brake, encoding="utf-8")
    return path


LOADS = ["  bias: -2 N m\n", "  bias: -0.5 N m\n", "  gravity: {amplitude: 1.5 N m, phase: 90 deg}\n"]


@pytest.mark.parametrize("load_of", LOADS)
def test_what_was_recorded_behind_a_brake_is_simulated_bit_for_bit(tmp_path: Path, load_of: str) -> None:
    """The brake was released under the load: the friction is unloaded, and the law's integral holds the axis."""
    path = behind_a_brake(tmp_path, load_of)
    session = load(recorded(tmp_path / "own", "type: sine\namplitude: 2 mm\nfrequency: 3.2 Hz\nperiods: 2\n", 1, path))
    (log,) = session.logs
    rows = rollouts.simulated_log(session, session.stage, log, load_stage(path).file.simulation.substeps)
    assert log.command is not None and abs(log.carried) > 0.5
    assert np.array_equal(rollouts.column(rows, "measured"), log.position)
    assert np.array_equal(rollouts.column(rows, "command"), log.command)
    assert check_command(session).harmless == frozenset() and check_command(session).worst == 0.0
    tied = tracked_model.Tied(session.stage, model_tracking.tracker(session.stage, session.dt))
    residual = model_tracking.tracking_residual(tied, model_tracking.path_of(log, session.dt))
    assert np.abs(residual.effort).max() < 0.03 * stage.sliding(session.stage.friction)
    assert np.abs(residual.current).max() < 1e-12


def test_what_is_wrong_with_the_controller_of_a_braked_axis_is_found(tmp_path: Path) -> None:
    """Every law that is tried begins with the current that the axis was held with."""
    path = behind_a_brake(tmp_path, LOADS[0])
    session = load(recorded(tmp_path / "own", "type: sine\namplitude: 2 mm\nfrequency: 3.2 Hz\nperiods: 2\n", 1, path))
    (log,) = session.logs
    late = log._replace(position=np.concatenate([log.position[:1], log.position[:-1]]))
    cause = check_command(session._replace(logs=(late,))).cause
    assert cause is not None and (cause.kind, cause.term, cause.value) == ("shift", "position", -1)


def test_the_twin_of_a_braked_axis_begins_as_the_axis_does(tmp_path: Path) -> None:
    """Its law holds the axis, too, and no model of it has to get rid of a load on its friction."""
    setup = load_stage(behind_a_brake(tmp_path, LOADS[0]))
    motion = plan(setup, Sine(0.005, 1.6, 5.0, 1.0), setup.controller.feedforward)
    samples = simulate(setup, motion, setup.controller.law)
    twin = beside(setup)
    blocks = followed(twin, samples.view(np.float64).reshape(len(samples), -1))
    assert {block.controller for block in blocks} == {0.0}
    assert all(block.drive is not None and block.drive.power < 1e-20 for block in blocks)
    assert not status_of(twin, blocks).named


def test_a_recording_whose_axis_was_not_held_begins_without_a_current(tmp_path: Path) -> None:
    (log,) = load(recorded(tmp_path, "type: sine\namplitude: 2 mm\nfrequency: 3.2 Hz\nperiods: 2\n", 1)).logs
    assert log.carried == 0.0
