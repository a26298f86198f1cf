"""What the columns of a run hold, beside the law's own terms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.kernels import rollout, stage
from stagectl.plan import foresee
from stagectl.trajectories import Sine
from tests.conftest import Tracked, varied

SINE = Sine(0.001, 3.2, 0.5, 0.5)


@pytest.mark.parametrize("nd", [0, 1, 2])
def test_the_measured_current_is_the_motors(tracked: Tracked, nd: int) -> None:
    """First-order lag behind the command of nd periods ago, latched before this period's command."""
    run = tracked(SINE, nd=nd, quantum=0.0)
    decay = math.exp(-run.setup.dt / run.setup.stage.drive.current_lag)
    current, expected = 0.0, []
    for target in [0.0] * nd + run.samples["current"].tolist():
        expected.append(current)
        current = target + (current - target) * decay
    expected = expected[: len(run.samples)]
    np.testing.assert_allclose(run.samples["measured_current"], expected, rtol=1e-9, atol=1e-12)


def test_the_stage_gets_what_is_left_after_the_laws_limit(ball_screw: Setup, tracked: Tracked) -> None:
    run = tracked(SINE)
    tight, rows = run.law._replace(current_limit=0.5), np.zeros((len(run.plan.setpoints), rollout.WIDTH))
    inputs = (run.plan.setpoints, np.zeros((len(rows), 2)), rows)
    rollout.closed_loop(
        rollout.Loop(tight, ball_screw.stage), stage.at_rest(ball_screw.stage), inputs, run.setup.dt, 10
    )
    command, current, measured = (rows[:, rollout.COLUMNS.index(n)] for n in ("command", "current", "measured_current"))
    assert np.abs(command).max() > 0.6
    assert np.abs(current).max() == 0.5
    assert 0.45 < np.abs(measured).max() <= 0.5


def test_the_reference_is_that_of_now_whatever_the_delays(ball_screw: Setup, tracked: Tracked) -> None:
    run = tracked(SINE, nm=1)
    seen = foresee(varied(ball_screw, nm=1), SINE, SINE.duration)
    assert np.array_equal(run.samples["reference"], seen.reference)
    assert np.array_equal(run.samples["time"], run.setup.dt * np.arange(len(run.samples)))
