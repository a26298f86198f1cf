"""Gravity by the angle, and what a drive gives of a command by its direction: closed forms; nothing when neutral."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.kernels import drive_effects, friction, stage, transmission
from stagectl.kernels.effects import Harmonic

DT = 5e-4


def test_a_weight_holds_the_axis_where_friction_carries_it(ball_screw: Setup) -> None:
    """At rest the friction carries the weight; the axis stays."""
    p = ball_screw.stage
    p = p._replace(mechanics=p.mechanics._replace(gravity=Harmonic(0.3, 1.0, 0.2)))
    x = stage.at_rest(p, 1.0)
    assert x.force == pytest.approx(-0.3 * math.sin(1.0 + 0.2), rel=1e-9)
    for _ in range(200):
        x = stage.period(p, x, 0.0, stage.SILENT, DT, 20)
    assert abs(x.position - 1.0) < 1e-4


def test_a_pendulum_swings_with_its_period(ball_screw: Setup) -> None:
    """Without friction, small swings about the hanging place have the period ``2 pi sqrt(J / m g l)``."""
    p = ball_screw.stage
    none = stage.Friction(friction.bundle([0.0], [1.0]), friction.Stribeck())
    gravity = Harmonic(0.3, 1.0, 0.0)
    p = p._replace(friction=none, mechanics=p.mechanics._replace(viscous=0.0, gravity=gravity))
    x, path = stage.at_rest(p, 0.01), []
    for _ in range(8000):
        path.append(x.position)
        x = stage.period(p, x, 0.0, stage.SILENT, DT, 4)
    crossings = np.flatnonzero(np.diff(np.sign(path)) < 0)
    period = DT * float(np.diff(crossings).mean())
    assert period == pytest.approx(2.0 * math.pi * math.sqrt(p.mechanics.inertia / 0.3), rel=2e-3)


def test_gravity_is_an_effort_of_its_own(ball_screw: Setup) -> None:
    p = ball_screw.stage.mechanics
    assert transmission.pulled(p, 0.7, 0.0) == 0.0
    hanging = p._replace(gravity=Harmonic(2.0, 1.0, 0.1))
    assert transmission.pulled(hanging, 0.7, 0.0) == pytest.approx(2.0 * math.sin(0.8))
    assert transmission.neutral(p) and not transmission.neutral(hanging)


@pytest.mark.parametrize(("command", "current"), [(2.0, 1.96), (-2.0, -1.8), (0.0, 0.0)])
def test_a_drive_gives_by_direction(ball_screw: Setup, command: float, current: float) -> None:
    """``(1 + g + a sgn c) c + o sgn c`` with g = -10 %, a = 4 %, o = 0.08 A, by hand: 2 -> 1.88 + 0.08."""
    p = ball_screw.stage.drive
    assert drive_effects.amplified(p, command) == command
    uneven = p._replace(gain=-0.1, gain_asymmetry=0.04, directed_offset=0.08)

    assert drive_effects.amplified(uneven, command) == pytest.approx(current)
    assert not drive_effects.neutral(uneven)


def test_steps_follow_the_stiffness_of_the_friction(ball_screw: Setup) -> None:
    """The paper's stage at its own period keeps its steps; a log of 94 Hz takes as many as its friction needs."""
    p = ball_screw.stage
    assert stage.steps_that_hold(p, DT, 4) == 4
    many = stage.steps_that_hold(p, 1.0 / 94.0, 4)
    turn = math.sqrt(stage.stiffness(p.friction) / p.mechanics.inertia) / 94.0
    assert turn / many <= 0.5 < turn / (many - 1)
