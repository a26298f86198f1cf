"""The rows that the law reads: limits first, and every column at its own instant."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stagectl.config.stage_file import Setup
from stagectl.plan import LONGEST, SETTLE, command_delay, plan
from stagectl.trajectories import Dwell, Sequence, Sine, Trajectory, TrajectoryError, Trapezoid
from tests.conftest import varied

PER_METRE = 2.0 * math.pi / 0.012
SINE = Sine(5e-3, 1.6, 2.0, 1.0)


def test_the_delay_of_the_command_path(ball_screw: Setup) -> None:
    assert command_delay(ball_screw) == 0.159e-3 + 0.5e-3
    assert command_delay(varied(ball_screw, nd=0)) == 0.159e-3


@pytest.mark.parametrize(("nd", "nm"), [(0, 0), (1, 0), (2, 1)])
def test_every_column_at_its_own_instant(ball_screw: Setup, nd: int, nm: int) -> None:
    dt, ahead, late = 5e-4, 0.159e-3 + nd * 5e-4, nm * 5e-4
    rows = plan(varied(ball_screw, nd=nd, nm=nm), SINE).references
    t = dt * np.arange(len(rows))
    instants = (t, t - late, t + 2 * dt + ahead, t + 2 * dt - late, t + ahead + 0.5 * dt)
    now, delayed, frame, target, stops = (SINE.at(instant) for instant in instants)
    wanted = (now[0], delayed[0], frame[0], frame[1], target[0], target[1], stops[0])
    for column, values in zip(rows.T, wanted, strict=True):
        np.testing.assert_allclose(column, values * PER_METRE, rtol=1e-14, atol=1e-15)


def test_whole_frames_and_a_standstill_at_the_end(ball_screw: Setup) -> None:
    laid_out = plan(ball_screw, SINE)
    rows = laid_out.references
    assert len(rows) % 2 == 0
    assert SETTLE <= len(rows) * 5e-4 - SINE.duration <= SETTLE + 2 * 5e-4
    assert laid_out.duration == SINE.duration
    assert laid_out.steady == SINE.steady
    assert not rows[-100:].any()


def test_a_linear_axis_needs_no_lead(ball_screw: Setup) -> None:
    axis = ball_screw.file.axis._replace(kind="linear", lead=0.0)
    limits = ball_screw.file.limits._replace(travel=(-0.05, 0.05), speed=0.3, acceleration=5.0)
    linear = ball_screw._replace(file=ball_screw.file._replace(axis=axis, limits=limits))
    np.testing.assert_allclose(
        plan(linear, SINE).references * PER_METRE, plan(ball_screw, SINE).references, rtol=1e-12, atol=1e-12
    )


JUST = [  # within a limit of stage A, and just beyond it
    (Trapezoid(0.05, 0.1, 1.0), Trapezoid(0.0501, 0.1, 1.0), "a travel of 0.0501 m upwards; .* allows 0.05 m"),
    (Trapezoid(-0.05, 0.1, 1.0), Trapezoid(-0.0501, 0.1, 1.0), "a travel of 0.0501 m downwards; .* allows 0.05 m"),
    (Trapezoid(0.05, 0.3, 4.0), Trapezoid(0.05, 0.301, 4.0), "a speed of 0.301 m/s; .* allows 0.3 m/s"),
    (Trapezoid(0.05, 0.3, 5.0), Trapezoid(0.05, 0.3, 5.01), "an acceleration of 5.01 m/s.2; .* allows 5 m/s.2"),
    (Dwell(4999.0), Dwell(5001.0), "takes 5001 s; must be at most 5000 s"),
]


@pytest.mark.parametrize(("good", "bad", "words"), JUST[:4])
def test_limits_admit_what_they_name_and_nothing_more(
    ball_screw: Setup, good: Trajectory, bad: Trajectory, words: str
) -> None:
    plan(ball_screw, good)
    with pytest.raises(TrajectoryError, match=words + ".*nothing has moved.*raise the limit in .*ball-screw.yaml"):
        plan(ball_screw, bad)


def test_what_no_memory_holds_is_refused_at_once(ball_screw: Setup) -> None:
    assert LONGEST * 5e-4 == 5000.0
    with pytest.raises(TrajectoryError, match="takes 86400 s; must be at most 5000 s, 10000000 control periods"):
        plan(ball_screw, Dwell(86400.0))


def test_parts_add_up_before_they_are_compared(ball_screw: Setup) -> None:
    step = Trapezoid(0.03, 0.1, 1.0, one_way=True)
    plan(ball_screw, Sequence((step,)))
    with pytest.raises(TrajectoryError, match=r"a travel of 0.06 m upwards"):
        plan(ball_screw, Sequence((step, step)))


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(1e-6, 0.1), st.floats(0.5, 30.0))
def test_nothing_beyond_the_limits_is_ever_laid_out(ball_screw: Setup, amplitude: float, frequency: float) -> None:
    sine = Sine(amplitude, frequency, 1.0, 1.0)
    omega = 2.0 * math.pi * frequency
    within = amplitude <= 0.05 and amplitude * omega <= 0.3 and amplitude * omega**2 <= 5.0
    try:
        rows = plan(ball_screw, sine).references
    except TrajectoryError:
        # The ramps ask for more than the steady sine does, so that a sine well within may not be refused either.
        assert not (amplitude <= 0.04 and amplitude * omega <= 0.15 and amplitude * omega**2 <= 1.5)
        return
    assert within
    assert np.abs(rows[:, 0]).max() <= 0.05 * PER_METRE * (1.0 + 1e-9)
    assert np.abs(np.diff(rows[:, 0])).max() / 5e-4 <= 0.3 * PER_METRE * (1.0 + 1e-9)
