"""What the loop accepts where the model holds more than a bias."""

from __future__ import annotations

import math

import pytest

from stagectl.config.stage_checks import decelerations
from stagectl.config.stage_file import Setup
from stagectl.config.time_outs import axis_limits
from stagectl.kernels.effects import Harmonic
from stagectl.kernels.plant import Cable
from stagectl.realtime.envelope import acceleration, braking, envelope, unwatched
from stagectl.service.axis_controller import AxisController


def pulled(setup: Setup) -> Setup:
    """A weight of 2 N m that turns with the axis, a cable of up to 1.5 N m, and cogging of 0.5 N m."""
    cable = Cable(1.5 / setup.file.limits.travel[1])
    mechanics = setup.stage.mechanics._replace(gravity=Harmonic(2.0), cable=cable)
    motor = setup.stage.motor._replace(cogging=Harmonic(0.4), cogging_third=Harmonic(-0.1))
    p = setup.stage._replace(mechanics=mechanics, motor=motor)
    return setup._replace(stage=p, file=setup.file._replace(mechanics=mechanics, motor=motor))


def test_a_weight_counts_whatever_the_model_calls_it(ball_screw: Setup) -> None:
    """Over a way that counts which does not turn back, at one instant all of it."""
    setup = pulled(ball_screw)
    most, inertia = 15.0 * 0.72, 0.010
    assert setup.load == pytest.approx(4.0)
    assert acceleration(setup) == pytest.approx((most + 1.0 + 4.0) / inertia)
    assert braking(setup) == pytest.approx((most + 1.0 - 2.0) / inertia)
    assert min(decelerations(setup.file).values()) == pytest.approx((most - 2.0) / inertia)
    allowed = axis_limits(setup.file)
    assert allowed.braking.acceleration == pytest.approx((most + 2.0) / inertia)
    assert allowed.braking.deceleration == pytest.approx((most - 2.0) / inertia)
    assert allowed.coasting.deceleration == 0.0  # friction of 1 N m does not stop it
    assert AxisController("axis", setup).effort == pytest.approx(most - 1.0 - 4.0)


def test_a_frozen_encoder_that_no_current_shows_is_told(ball_screw: Setup) -> None:
    """Twice what holds an axis at rest is 13.9 A here; a drive of no more gives no sign."""
    setup = pulled(ball_screw)
    assert envelope(setup).breakaway == pytest.approx(2.0 * (1.0 + 4.0) / 0.72)
    assert unwatched(setup) == ""
    weak = setup._replace(stage=setup.stage._replace(drive=setup.stage.drive._replace(current_limit=13.0)))
    assert envelope(weak).breakaway == math.inf
    assert unwatched(weak) != ""


def test_the_known_gain_of_a_drive_is_no_want_of_current(ball_screw: Setup) -> None:
    """What the drive gives more or less than it is told, by the model, does not trip `clamped`."""
    drive = ball_screw.stage.drive._replace(gain=-0.2, gain_asymmetry=-0.05, directed_offset=0.3, offset=-0.1)
    plain, known = envelope(ball_screw), envelope(ball_screw._replace(stage=ball_screw.stage._replace(drive=drive)))
    assert known.current_share - plain.current_share == pytest.approx(0.25)
    assert known.current_floor - plain.current_floor == pytest.approx(0.4)
