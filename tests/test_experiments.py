"""Experiments: currents, open loops, releases - from their YAML to the rows, and on the simulated stage."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from stagectl import design
from stagectl.config.source import ConfigError
from stagectl.config.stage_file import Setup, load_stage
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.evaluation import evaluate
from stagectl.kernels import law
from stagectl.motion_limits import LimitError
from stagectl.plan import Plan, plan
from stagectl.problem import ProblemKind
from stagectl.simulation import simulate
from stagectl.trajectories import (
    CurrentMultisine,
    CurrentSine,
    CurrentSweep,
    Dwell,
    Excited,
    Experiment,
    Released,
    Sine,
    TrajectoryError,
    Trapezoid,
)
from tests.conftest import CONFIG
from tests.problems import refused

COLUMN = {name: number for number, name in enumerate(law.Setpoint._fields)}


def planned(setup: Setup, experiment: Experiment) -> Plan:
    return plan(setup, experiment, design.design(setup.stage, setup.file.control).feedforward)


def test_a_current_sine_is_the_injection_of_an_open_loop(ball_screw: Setup) -> None:
    rows = planned(ball_screw, CurrentSine(5.0, 1.6, 2.0, 1.0)).setpoints
    t = 5e-4 * np.arange(len(rows))
    inside = (t >= 0.625) & (t < 3 * 0.625)
    expected = 5.0 * np.sin(2.0 * math.pi * 1.6 * (t - 0.625))
    np.testing.assert_allclose(rows[inside, COLUMN["injection"]], expected[inside], atol=1e-12)
    others = [COLUMN[name] for name in ("reference", "target", "feedforward", "friction", "velocity", "closed")]
    assert not rows[:, others].any()


def test_a_sweep_measures_whole_periods() -> None:
    sweep = CurrentSweep(2.0, (10.0, 4.0), periods=3, settle=2)
    assert sweep.duration == pytest.approx(0.5 + 1.25)
    assert [(s.start, s.end, *s.frequencies) for s in sweep.spans] == [
        pytest.approx((0.2, 0.5, 10.0)),
        pytest.approx((1.0, 1.75, 4.0)),
    ]
    t = np.array([-0.1, 0.025, 0.5 + 0.0625, 1.76])
    assert sweep.at(t) == pytest.approx([0.0, 2.0, 2.0, 0.0])


def test_the_lines_of_a_multisine_are_in_its_span() -> None:
    multisine = CurrentMultisine(3.0, 5.0, 50.0, 1.0, periods=2.5)
    (span,) = multisine.spans
    assert (span.start, span.end) == pytest.approx((0.25, 2.25))
    assert span.frequencies == tuple(float(k) for k in range(5, 51, 2))
    current = multisine.at(np.arange(0.25, 1.25, 1e-3))
    lines = np.abs(np.fft.rfft(current)) / 500.0
    assert np.ptp(lines[[int(f) for f in span.frequencies]]) < 1e-9 < lines[5]


def test_an_excited_motion_keeps_its_loop_closed(ball_screw: Setup) -> None:
    motion = Trapezoid(0.01, 0.01, 0.1, one_way=True)
    laid_out = planned(ball_screw, Excited(motion, CurrentSine(0.5, 20.0, 4.0), 0.3))
    bare = planned(ball_screw, motion)
    assert laid_out.excitation[0].start == pytest.approx(0.3 + 0.05)
    assert laid_out.steady == pytest.approx((0.35, 0.55))
    count = len(bare.setpoints)
    for name in ("reference", "target", "feedforward", "friction", "velocity", "closed"):
        assert np.array_equal(laid_out.setpoints[:count, COLUMN[name]], bare.setpoints[:, COLUMN[name]])
    assert np.abs(laid_out.setpoints[:, COLUMN["injection"]]).max() == pytest.approx(0.5, rel=1e-3)


def test_a_release_ends_all_current(ball_screw: Setup) -> None:
    motion = Trapezoid(0.01, 0.01, 0.1, one_way=True)
    rows = planned(ball_screw, Released(motion, None, 0.2)).setpoints
    opened = 5e-4 * np.arange(len(rows)) >= motion.duration - 1e-9
    assert np.array_equal(rows[:, COLUMN["closed"]] == 0.0, opened)
    assert not rows[opened][:, [COLUMN["feedforward"], COLUMN["friction"], COLUMN["injection"]]].any()
    samples = simulate(ball_screw, planned(ball_screw, Released(motion, None, 0.2)), design_law(ball_screw))
    assert not samples["current"][opened].any()


def design_law(setup: Setup) -> law.Law:
    return design.design(setup.stage, setup.file.control).law


def test_an_open_loop_reports_no_tracking_error(ball_screw: Setup) -> None:
    laid_out = planned(ball_screw, CurrentSine(5.0, 1.6, 2.0, 1.0))
    samples = simulate(ball_screw, laid_out, design_law(ball_screw))
    axis = {"travel_per_unit": 0.012 / (2 * math.pi), "travel_unit": "m", "encoder_step": 1e-6}
    meta = {"name": "a", "trajectory": "b", "axis": axis, "dt": 5e-4, "nd": 1, "nm": 0}
    figures = evaluate(samples, {**meta, "steady": list(laid_out.steady), "duration": laid_out.duration})
    assert figures["open_loop"] and figures["in_position"]
    assert figures["tracking_error"] == {"peak": None, "rms": None}
    low, high = figures["travelled"]
    assert 3e-3 < high - low < 9e-3  # 5 A at 1.6 Hz


@pytest.mark.parametrize(
    ("experiment", "amplitude"),
    [(CurrentSine(15.1, 1.6, 2.0), 15.1), (Excited(Dwell(1.0), CurrentSine(16.0, 10.0, 5.0)), 16.0)],
)
def test_no_current_exceeds_that_of_the_drive(ball_screw: Setup, experiment: Experiment, amplitude: float) -> None:
    with refused(LimitError, kind=ProblemKind.LIMIT, key="drive.current_limit", needed=amplitude, allowed=15.0):
        planned(ball_screw, experiment)


def test_no_current_moves_the_axis_beyond_its_limits(ball_screw: Setup) -> None:
    with pytest.raises(LimitError) as caught:
        planned(ball_screw, CurrentSine(14.0, 0.3, 2.0))
    assert caught.value.problems[0].key in ("limits.travel", "limits.speed")
    assert caught.value.needed > caught.value.allowed > 0.0


def test_a_long_period_moves_no_axis_that_sticks(ball_screw: Setup) -> None:
    """A current that friction holds, at 100 Hz: in one step a period the model moved by 150 um."""
    limits = ball_screw.file.limits._replace(travel=(-1e-2, 1e-2), speed=0.3)  # rad, 19 um, and rad/s, 0.6 mm/s
    slow = ball_screw.having(control=design.Control(0.01, 1.0), limits=limits)
    assert planned(slow, CurrentSine(0.8 / 0.72, 1.6, 4.0)).setpoints[:, COLUMN["injection"]].max() > 1.1


def test_yaml_round(tmp_path: Path, ball_screw: Setup) -> None:
    path = tmp_path / "e.yaml"
    path.write_text(
        "type: excited\nmotion: {type: sine, amplitude: 1 mm, frequency: 2 Hz, periods: 3}\n"
        "current: {type: current_sine, amplitude: 500 mA, frequency: 30 Hz, periods: 9}\nstart: 100 ms\n"
    )
    trajectory = load_trajectory(path, axis_of(ball_screw))
    assert trajectory == Excited(Sine(0.001, 2.0, 3.0), CurrentSine(0.5, 30.0, 9.0), 0.1)
    path.write_text("type: release\nmotion: {type: dwell, duration: 1 s}\nat: 2 s\n")
    with refused(TrajectoryError, key="at", value="2 s", interval="[0, 1]", unit="s", file=path, line=3):
        load_trajectory(path, axis_of(ball_screw))
    path.write_text("type: current_sine\namplitude: 5 mm\nfrequency: 1 Hz\nperiods: 2\n")
    with refused(ConfigError, kind=ProblemKind.UNIT, key="amplitude", value="5 mm", unit="A"):
        load_trajectory(path, axis_of(ball_screw))


@pytest.mark.parametrize("path", sorted((CONFIG / "experiments").glob("*.yaml")), ids=lambda path: path.stem)
def test_the_shipped_experiments_can_be_laid_out(path: Path) -> None:
    setup = load_stage(
        CONFIG / ("linear-slider.yaml" if path.stem.startswith(("release", "slider")) else "ball-screw.yaml")
    )
    planned(setup, load_trajectory(path, axis_of(setup)))
