"""The rows that the law reads: limits first, and every column at its own instant."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stagectl import design
from stagectl import plan as plans
from stagectl.config.stage_file import Setup
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.kernels import law
from stagectl.motion_limits import LimitError, beyond_current
from stagectl.plan import LONGEST, SETTLE, Plan, command_delay, foresee, plan
from stagectl.problem import ProblemKind
from stagectl.trajectories import Dwell, Experiment, Recorded, Sequence, Sine, Trajectory, TrajectoryError, Trapezoid
from stagectl.workflows.motion import Commanded, lay_out
from tests.conftest import CONFIG, varied
from tests.problems import refused

PER_METRE = 2.0 * math.pi / 0.012
SINE = Sine(5e-3, 1.6, 2.0, 1.0)


def planned(setup: Setup, trajectory: Trajectory) -> Plan:
    """The trajectory laid out for the controller that the stage asks for."""
    return plan(setup, trajectory, design.design(setup.stage, setup.file.control).feedforward)


def test_the_delay_of_the_command_path(ball_screw: Setup) -> None:
    assert command_delay(ball_screw) == 0.159e-3 + 0.5e-3
    assert command_delay(varied(ball_screw, nd=0)) == 0.159e-3


@pytest.mark.parametrize(("nd", "nm"), [(0, 0), (1, 0), (2, 1)])
def test_everything_is_foreseen_at_its_own_instant(ball_screw: Setup, nd: int, nm: int) -> None:
    dt, ahead = 5e-4, 0.159e-3 + nd * 5e-4
    seen = foresee(varied(ball_screw, nd=nd, nm=nm), SINE, SINE.duration)
    t = dt * np.arange(len(seen.late))
    frame, late = (np.stack(SINE.at(instant)[:2], axis=1) for instant in (t + ahead, t - nm * dt))
    now, middle = SINE.at(t[:-2]).position, SINE.at(t[:-2] + ahead + 0.5 * dt).position
    for foreseen, values in zip(seen, (now, frame, late, middle), strict=True):
        np.testing.assert_allclose(foreseen, values * PER_METRE, rtol=1e-12, atol=1e-13)


def test_whole_frames_and_a_standstill_at_the_end(ball_screw: Setup) -> None:
    laid_out = planned(ball_screw, SINE)
    rows = laid_out.setpoints
    assert rows.shape[1] == len(law.Setpoint._fields)
    assert len(rows) % 2 == 0
    assert SETTLE <= len(rows) * 5e-4 - SINE.duration <= SETTLE + 2 * 5e-4
    assert laid_out.duration == SINE.duration
    assert laid_out.steady == SINE.steady
    np.testing.assert_allclose(rows[-100:, :3], 0.0, atol=1e-9)  # friction holds what it held


def test_a_linear_axis_needs_no_lead(ball_screw: Setup) -> None:
    axis = ball_screw.file.axis._replace(kind="linear", lead=0.0)
    linear = ball_screw.having(axis=axis)
    for metres, angles in zip(
        foresee(linear, SINE, SINE.duration), foresee(ball_screw, SINE, SINE.duration), strict=True
    ):
        np.testing.assert_allclose(metres * PER_METRE, angles, rtol=1e-12, atol=1e-12)


JUST = [  # within a limit of stage A, and just beyond it
    (Trapezoid(0.05, 0.1, 1.0), Trapezoid(0.0501, 0.1, 1.0), "travel", 0.0501, 0.05),
    (Trapezoid(-0.05, 0.1, 1.0), Trapezoid(-0.0501, 0.1, 1.0), "travel", 0.0501, 0.05),
    (Trapezoid(0.05, 0.3, 4.0), Trapezoid(0.05, 0.301, 4.0), "speed", 0.301, 0.3),
    (Trapezoid(0.05, 0.3, 5.0), Trapezoid(0.05, 0.3, 5.01), "acceleration", 5.01, 5.0),
]


@pytest.mark.parametrize(("good", "bad", "limit", "needed", "allowed"), JUST)
def test_limits_admit_what_they_name_and_nothing_more(
    ball_screw: Setup, good: Trajectory, bad: Trajectory, limit: str, needed: float, allowed: float
) -> None:
    planned(ball_screw, good)
    with refused(LimitError, kind=ProblemKind.LIMIT, key=f"limits.{limit}", needed=pytest.approx(needed)) as caught:
        planned(ball_screw, bad)
    assert caught.value.allowed == pytest.approx(allowed)


def test_all_limits_that_a_motion_exceeds_are_named_as_the_file_states_them(ball_screw: Setup) -> None:
    with refused(LimitError, needed=pytest.approx(0.08), allowed=pytest.approx(0.05)) as caught:
        planned(ball_screw, Sine(0.08, 20.0, 2))
    problems = caught.value.problems
    values = ["[-50, 50] mm", "[-50, 50] mm", "300 mm/s", "5 m/s^2"]
    assert [problem.value for problem in problems] == values
    lines = ball_screw.path.read_text().splitlines()
    assert all(problem.key.removeprefix("limits.") in lines[problem.line - 1] for problem in problems)
    assert {problem.file for problem in problems} == {ball_screw.path}


def test_travel_that_is_left_is_named_by_the_limit_itself(ball_screw: Setup) -> None:
    """A service lays a motion out from where the axis stands."""
    limits, here = ball_screw.file.limits, 0.005 / ball_screw.file.axis.travel_per_unit
    left = limits._replace(travel=(limits.travel[0] - here, limits.travel[1] - here))
    with refused(LimitError, value="[-50, 50] mm", needed=pytest.approx(0.046), allowed=pytest.approx(0.045)):
        planned(ball_screw.having(limits=left), Trapezoid(0.046, 0.2, 4.0))


def test_what_no_memory_holds_is_refused_at_once(ball_screw: Setup) -> None:
    assert LONGEST * 5e-4 == 5000.0
    with refused(LimitError, key="duration", value="86400 s", needed=86400.0, allowed=5000.0):
        planned(ball_screw, Dwell(86400.0))


def test_what_no_encoder_sees_is_a_mistaken_unit(ball_screw: Setup) -> None:
    """1e-6 um instead of 1e-6 m; the sine of 2 um stays good."""

    def laid(motion: Experiment) -> None:
        lay_out(ball_screw, Commanded("a.yaml", "", motion), frozenset(), Path("a.h5"))

    laid(load_trajectory(CONFIG / "trajectories" / "sine-2um.yaml", axis_of(ball_screw)))
    laid(Dwell(0.1))
    with refused(LimitError, kind=ProblemKind.LIMIT, unit="m", allowed=pytest.approx(0.012 / 2**20, abs=0.0)):
        laid(Sine(1e-9, 1.6, 2.0, 1.0))
    with refused(LimitError, kind=ProblemKind.LIMIT, unit="s", allowed=5e-4):
        laid(Trapezoid(1e-12, 0.2, 4.0))


def test_parts_add_up_before_they_are_compared(ball_screw: Setup) -> None:
    step = Trapezoid(0.03, 0.1, 1.0, one_way=True)
    planned(ball_screw, Sequence((step,)))
    with refused(LimitError, key="limits.travel", needed=pytest.approx(0.06)):
        planned(ball_screw, Sequence((step, step)))


@settings(max_examples=60, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(1e-6, 0.1), st.floats(0.5, 30.0))
def test_nothing_beyond_the_limits_is_ever_laid_out(ball_screw: Setup, amplitude: float, frequency: float) -> None:
    sine = Sine(amplitude, frequency, 1.0, 1.0)
    omega = 2.0 * math.pi * frequency
    within = amplitude <= 0.05 and amplitude * omega <= 0.3 and amplitude * omega**2 <= 5.0
    try:
        rows = planned(ball_screw, sine).setpoints
    except TrajectoryError:
        # The ramps ask for more than the steady sine does, so that a sine well within may not be refused either.
        assert not (amplitude <= 0.04 and amplitude * omega <= 0.15 and amplitude * omega**2 <= 1.5)
        return
    assert within
    assert np.abs(rows[:, 0]).max() <= 0.05 * PER_METRE * (1.0 + 1e-9)
    assert np.abs(np.diff(rows[:, 0])).max() / 5e-4 <= 0.3 * PER_METRE * (1.0 + 1e-9)


def moving(velocity: float) -> Recorded:
    """A record that is in motion from its first to its last sample."""
    t = np.linspace(0.0, 0.1, 21)
    return Recorded(t, velocity * t)


def stopping_short(velocity: float) -> Recorded:
    """From rest, x = v t^3 / (3 T^2), to `velocity` at the last sample."""
    t = np.linspace(0.0, 0.1, 21)
    return Recorded(t, velocity * t**3 / (3.0 * 0.1**2))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_jump_of_the_speed_is_refused(ball_screw: Setup, sign: float) -> None:
    """limits.acceleration, 5 m/s^2, over a period of 0.5 ms: 2.5 mm/s at once, and no more."""
    planned(ball_screw, moving(sign * 2.49e-3))
    with refused(LimitError, key="limits.acceleration", needed=pytest.approx(2.51e-3), allowed=pytest.approx(2.5e-3)):
        planned(ball_screw, moving(sign * 2.51e-3))
    with refused(LimitError, key="limits.acceleration", allowed=pytest.approx(2.5e-3)):
        planned(ball_screw, stopping_short(sign * 20e-3))


def test_run_up_and_run_out_take_the_jumps_away(ball_screw: Setup) -> None:
    planned(ball_screw, moving(0.1)._replace(run_up=0.1, run_out=0.1))
    with refused(LimitError, key="limits.acceleration", needed=pytest.approx(0.1)):
        planned(ball_screw, moving(0.1)._replace(run_out=0.1))
    with refused(LimitError, key="limits.acceleration", needed=pytest.approx(0.1)):
        planned(ball_screw, moving(0.1)._replace(run_up=0.1))


def test_the_longest_that_is_laid_out(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plans, "LONGEST", 256)
    planned(ball_screw, Dwell(0.128))
    with refused(LimitError, key="duration", needed=0.1281, allowed=0.128):
        planned(ball_screw, Dwell(0.1281))


def test_a_motion_that_takes_more_than_the_current_is_told_beforehand(ball_screw: Setup) -> None:
    """The limits of speed and acceleration alone do not tell; what is advised must then pass."""
    for speed, acceleration in ((0.28, 4.9), (0.1, 4.9), (0.1, 0.8)):
        beyond = planned(ball_screw, Trapezoid(0.05, speed, acceleration, 0.1)).setpoints
        assert "drive.current_limit, 15 A" in beyond_current(ball_screw, beyond)
    within = planned(ball_screw, Trapezoid(0.05, 0.1, 0.48, 0.1)).setpoints
    assert beyond_current(ball_screw, within) == ""
