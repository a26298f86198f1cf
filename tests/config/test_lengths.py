"""Lengths and angles: the lead converts both ways, and where there is none nothing is guessed."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from stagectl.config.friction_laws import Rolling
from stagectl.config.source import ConfigError
from stagectl.config.stage_file import Setup, load_stage
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.problem import ProblemKind
from stagectl.trajectories import Sine
from tests.conftest import CONFIG
from tests.problems import refused

STAGE = (CONFIG / "ball-screw.yaml").read_text()
SINE = "type: sine\namplitude: {}\nfrequency: 1 Hz\nperiods: 1\n"


def changed(folder: Path, *changes: tuple[str, str]) -> Setup:
    """Stage A with some texts in place of others."""
    if not (folder / "drives").exists():
        (folder / "drives").symlink_to(CONFIG / "drives")
    text = STAGE
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    (folder / "stage.yaml").write_text(text)
    return load_stage(folder / "stage.yaml")


def amplitude(folder: Path, setup: Setup, text: str) -> float:
    """Of a sine that is read for this stage."""
    (folder / "motion.yaml").write_text(SINE.format(text))
    motion = load_trajectory(folder / "motion.yaml", axis_of(setup))
    assert isinstance(motion, Sine)
    return motion.amplitude


NO_LEAD = (
    ("  lead: 12 mm\n", ""),
    ("shortest: 0.3 um", "shortest: 1 mrad"),
    ("longest: 9 um", "longest: 5 mrad"),
    ("deceleration: 5 m/s^2", "deceleration: 5 rad/s^2"),
    ("[-50 mm, 50 mm]", "[-2 rev, 90 deg]"),
    ("300 mm/s", "60 rpm"),
    ("  acceleration: 5 m/s^2", "  acceleration: 5 rad/s^2"),
    ("0.2 mm", "0.1 deg"),
)


def test_table_lengths_become_motor_angles(ball_screw: Setup) -> None:
    friction, limits = ball_screw.file.friction, ball_screw.file.limits
    assert isinstance(friction, Rolling)
    per_metre = 2.0 * math.pi / 0.012
    assert friction.longest == pytest.approx(9e-6 * per_metre, rel=1e-15)
    assert friction.shortest == pytest.approx(0.3e-6 * per_metre, rel=1e-15)
    assert limits.speed == pytest.approx(0.3 * per_metre, rel=1e-15)
    assert limits.acceleration == pytest.approx(5.0 * per_metre, rel=1e-15)
    assert limits.travel == pytest.approx((-0.05 * per_metre, 0.05 * per_metre), rel=1e-15)
    assert ball_screw.stage.encoder.step * 0.012 / (2.0 * math.pi) == pytest.approx(11.44e-9, rel=1e-3)  # the paper's


def test_an_angle_says_the_same_as_its_length(tmp_path: Path, ball_screw: Setup) -> None:
    angular = changed(tmp_path, ("lead: 12 mm", "lead: 12 mm"), ("speed: 300 mm/s", "speed: 25 rev/s"))
    assert angular.file.limits.speed == pytest.approx(ball_screw.file.limits.speed, rel=1e-15)


def test_a_trajectory_on_a_ball_screw_takes_both(tmp_path: Path, ball_screw: Setup) -> None:
    assert amplitude(tmp_path, ball_screw, "2 mm") == 0.002
    assert amplitude(tmp_path, ball_screw, "1 rev") == pytest.approx(0.012, rel=1e-15)
    assert amplitude(tmp_path, ball_screw, "1 rad") == pytest.approx(0.012 / (2.0 * math.pi), rel=1e-15)


def test_without_a_lead_travel_is_an_angle(tmp_path: Path) -> None:
    setup = changed(tmp_path, *NO_LEAD)
    assert setup.file.limits.travel == pytest.approx((-4.0 * math.pi, 0.5 * math.pi), rel=1e-15)
    assert amplitude(tmp_path, setup, "10 deg") == pytest.approx(math.radians(10), rel=1e-15)
    with refused(ConfigError, kind=ProblemKind.UNIT, key="amplitude", value="2 mm", unit="rad", interval="(0, 1e6]"):
        amplitude(tmp_path, setup, "2 mm")


def test_without_a_lead_metres_are_refused(tmp_path: Path) -> None:
    with refused(ConfigError, kind=ProblemKind.UNIT, key="limits.speed", value="300 mm/s", unit="rad/s"):
        changed(tmp_path, *(change for change in NO_LEAD if change[0] != "300 mm/s"))


def test_a_linear_axis_takes_no_angle(tmp_path: Path) -> None:
    slider = load_stage(CONFIG / "linear-slider.yaml")
    assert amplitude(tmp_path, slider, "2 mm") == 0.002
    with refused(ConfigError, kind=ProblemKind.UNIT, key="amplitude", unit="m", interval="(0, 1e6]"):
        amplitude(tmp_path, slider, "2 deg")


def test_hidden_zero_leads_convert_nothing(tmp_path: Path) -> None:
    for lead in ("0 mm", "1e-400 m"):
        with refused(ConfigError, kind=ProblemKind.UNIT, unit="rad"):
            changed(tmp_path, ("lead: 12 mm", f"lead: {lead}"))
