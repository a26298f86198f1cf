"""An axis that its friction does not hold: a current does, in the plant at rest and in the law that begins there."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from stagectl.config.stage_file import Setup, load_stage
from stagectl.kernels import friction, law, rollout, stage
from stagectl.kernels.effects import Harmonic
from stagectl.kernels.plant import Transmission
from stagectl.kernels.stage import Stage
from tests.conftest import CONFIG

BIAS = -2.0  # N m; friction carries 1 N m


def weighted(p: Stage) -> Stage:
    return p._replace(mechanics=p.mechanics._replace(bias=BIAS))


def frictionless(p: Stage) -> Stage:
    operators = friction.bundle([0.0] * len(p.friction.operators.slip), p.friction.operators.slip)
    return weighted(p)._replace(friction=stage.Friction(operators, friction.Stribeck()))


def with_ripple(p: Stage) -> Stage:
    return weighted(p)._replace(motor=p.motor._replace(ripple=Harmonic(0.1, 1.0, 1.0)))


def with_load(p: Stage) -> Stage:
    geared = p.mechanics._replace(bias=BIAS, transmission=Transmission(0.3, 150.0, 0.1, 1e-3, 0.4))
    return p._replace(mechanics=geared)


def with_gain(p: Stage) -> Stage:
    return weighted(p)._replace(drive=p.drive._replace(gain=0.1, gain_asymmetry=0.05, directed_offset=0.2, offset=0.3))


def pressed(p: Stage) -> Stage:
    return weighted(p)._replace(friction=p.friction._replace(load=0.03, asymmetry=0.1))


@pytest.mark.parametrize("machine", [weighted, frictionless, with_ripple, with_load, with_gain, pressed])
def test_it_stays_where_it_is(machine: Callable[[Stage], Stage], ball_screw: Setup) -> None:
    p = machine(ball_screw.stage._replace(drive=ball_screw.stage.drive._replace(current_quantum=0.0)))
    x = stage.at_rest(p, 0.3)
    held = x.commands[0]
    assert abs(held) > 0.7
    for _ in range(400):
        x = stage.period(p, x, held, stage.SILENT, ball_screw.dt, 10)
    assert x.position == pytest.approx(0.3, abs=1e-8)  # 2 % of what the encoder shows


@pytest.mark.parametrize("machine", [weighted, with_ripple, with_load, with_gain, pressed])
def test_released_under_its_whole_load_it_stays_and_friction_is_unloaded(
    machine: Callable[[Stage], Stage], ball_screw: Setup
) -> None:
    p = machine(ball_screw.stage)
    held = stage.released(p, 0.3)
    x = stage.at_rest(p, 0.3, 0.0, held)
    assert x.commands[0] == held
    assert abs(x.force) <= p.motor.force_constant * p.drive.current_quantum  # what a step of the drive leaves
    for _ in range(400):
        x = stage.period(p, x, held, stage.SILENT, ball_screw.dt, 10)
    assert x.position == pytest.approx(0.3, abs=1e-8)


def test_the_drive_gives_what_is_called_for(ball_screw: Setup) -> None:
    """Beyond its limit nothing holds the axis."""
    p = weighted(ball_screw.stage)
    x = stage.at_rest(p._replace(drive=p.drive._replace(current_limit=1.0)), 0.0)
    assert x.current == 1.0


def test_a_load_that_friction_carries_needs_no_current(ball_screw: Setup) -> None:
    p = ball_screw.stage._replace(mechanics=ball_screw.stage.mechanics._replace(bias=0.99))
    x = stage.at_rest(p, 0.0)
    assert x.commands == stage.NO_COMMANDS and x.current == 0.0
    assert rollout.holding(x).feedback == law.AT_REST.feedback


@pytest.mark.parametrize("file", ["ball-screw.yaml", "linear-slider.yaml"])
def test_a_law_that_holds_goes_on_with_the_same_current(file: str) -> None:
    """PID, and a cascade with a filter of its force."""
    running = load_stage(CONFIG / file).controller.law
    x = law.carrying(law.AT_REST, 2.5)
    for _ in range(100):
        output, x = law.step(running, x, law.Setpoint(0.0, 0.0, 0.0, 0.0), 0.0)
        assert output.current == pytest.approx(2.5, rel=1e-12)
