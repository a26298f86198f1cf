"""What `identify --watch` makes of looks at an axis: it follows, within bounds, and gives up what does not help."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.kernels import stage
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.plan import plan
from stagectl.trajectories import Sine
from stagectl.workflows.friction_watch import FrictionWatch, Look, change, legs
from tests.conftest import Run

COULOMB = 2.0  # N m of the stage file


def look(ratio: float, error: float, speed: float = 1.0, half: float = 0.01) -> Look:
    """Friction of `ratio` times the stage file's, and legs whose rms errors spread by a percent about `error`."""
    each = error * np.array([0.99, 1.0, 1.01, 1.0])
    return Look(COULOMB * ratio, COULOMB * (ratio - half), COULOMB * (ratio + half), each, speed)


def watch(within: float = 0.3) -> FrictionWatch:
    return FrictionWatch(COULOMB, 1.0, within)


def test_friction_that_is_compensated_is_left_alone() -> None:
    verdict = watch().see(look(1.005, 1e-6))
    assert (verdict.scale, verdict.ended) == (1.0, False)


def test_friction_that_has_changed_is_followed_as_long_as_that_helps() -> None:
    axis = watch()
    assert [axis.see(look(*seen)).scale for seen in ((1.1, 2e-6), (1.1, 1e-6), (1.2, 2e-6), (1.2, 1e-6))] == (
        pytest.approx([1.1, 1.1, 1.2, 1.2])
    )


@pytest.mark.parametrize("error", [1e-6, 1.5e-6], ids=["no smaller", "larger"])
def test_a_change_that_does_not_help_is_taken_back(error: float) -> None:
    axis = watch()
    axis.see(look(1.1, 1e-6))
    verdict = axis.see(look(1.1, error))
    assert (verdict.scale, axis.scale, verdict.ended) == (1.0, 1.0, True)


def test_another_motion_judges_nothing() -> None:
    """It is not compared; the next look at the same motion is."""
    axis = watch()
    axis.see(look(1.1, 1e-6))
    verdict = axis.see(look(1.1, 5e-6, speed=2.0))
    assert (verdict.scale, verdict.ended) == (pytest.approx(1.1), False)
    assert axis.see(look(1.1, 2e-6)).ended


def test_the_scale_stays_within_its_bounds_and_the_watch_ends_beyond_them() -> None:
    axis = watch(within=0.2)
    assert axis.see(look(1.5, 3e-6)).scale == pytest.approx(1.2)
    verdict = axis.see(look(1.5, 2e-6))
    assert (verdict.scale, verdict.ended) == (pytest.approx(1.2), True)


def test_the_interval_of_a_change_holds_it_as_often_as_it_says() -> None:
    source = np.random.default_rng(5)
    inside = 0
    for _ in range(400):
        before, after = source.normal(1.0, 0.1, 6), source.normal(0.8, 0.05, 9)
        low, high = change(before, after)
        inside += low <= (0.8 - before.mean()) / before.mean() + (before.mean() - 1.0) <= high
    assert 0.90 <= inside / 400 <= 0.99


def test_legs_are_those_between_reversals_at_full_speed(ball_screw: Setup) -> None:
    """A sine of four periods that rises over one period: its slower legs are left out."""
    run = Run(ball_screw, Sine(amplitude=5e-3, frequency=2.0, periods=4, ramp=1))
    meta: dict[str, Any] = {
        "nm": 0,
        "dt": ball_screw.dt,
        "axis": {"travel_per_unit": ball_screw.file.axis.travel_per_unit},
    }
    each, speed = legs(run.samples, meta)
    assert len(each) == 9  # of eleven
    assert speed * ball_screw.file.axis.travel_per_unit == pytest.approx(2 * np.pi * 2.0 * 5e-3, rel=0.01)
    assert float(each.max()) < 3.0 * float(each.min())


def test_the_scale_multiplies_the_friction_that_is_fed_forward_and_nothing_else(ball_screw: Setup) -> None:
    sine = Sine(amplitude=5e-3, frequency=2.0, periods=2, ramp=1)
    control = ball_screw.file.control
    scaled = ball_screw.having(control=control._replace(friction_scale=1.2))
    plain, more = (plan(setup, sine, setup.controller.feedforward).setpoints for setup in (ball_screw, scaled))
    column = SETPOINT_COLUMNS["friction"]
    np.testing.assert_allclose(more[:, column], 1.2 * plain[:, column], rtol=1e-12)
    assert np.abs(plain[:, column]).max() > 1.0
    others = [number for number in SETPOINT_COLUMNS.values() if number != column]
    np.testing.assert_array_equal(more[:, others], plain[:, others])
    assert scaled.controller.law.unloading.range == pytest.approx(1.2 * ball_screw.controller.law.unloading.range)
    assert stage.sliding(scaled.stage.friction) == stage.sliding(ball_screw.stage.friction)
