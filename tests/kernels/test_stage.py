"""The plant against closed forms: linear response, delay, limit, encoder, order of the integrator."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.kernels import friction, stage

DT = 5e-4


def plant(**drive: float) -> stage.Stage:
    """J 0.01, D 0.14, Kt 0.72, no friction, continuous encoder."""
    fields = {"current_quantum": 0.0, "delay_samples": 0, "current_limit": 15.0, "current_lag": 0.0, **drive}
    none = friction.bundle([0.0], [1.0])
    return stage.Stage(
        stage.Drive(**fields),  # type: ignore[arg-type]
        stage.Motor(0.72),
        stage.Mechanics(0.01, 0.14),
        stage.Friction(none, friction.Stribeck()),
        stage.Encoder(0.0, 0),
    )


def run(p: stage.Stage, commands: list[float], substeps: int = 10) -> list[stage.State]:
    states = [stage.at_rest(p)]
    for command in commands:
        states.append(stage.period(p, states[-1], command, stage.SILENT, DT, substeps))
    return states


def test_a_step_of_current_gives_the_first_order_velocity() -> None:
    """w(t) = Kt i/D (1 - exp(-D t/J)), x its integral."""
    end = run(plant(), [2.0] * 100)[-1]
    t, tau = 100 * DT, 0.01 / 0.14
    assert end.velocity == pytest.approx(0.72 * 2.0 / 0.14 * (1.0 - math.exp(-t / tau)), rel=1e-12)
    exact = 0.72 * 2.0 / 0.14 * (t - tau * (1.0 - math.exp(-t / tau)))
    assert end.position == pytest.approx(exact, rel=1e-6)


def test_the_current_loop_is_a_first_order_lag() -> None:
    end = run(plant(current_lag=0.159e-3), [1.0])[-1]
    assert end.current == pytest.approx(1.0 - math.exp(-DT / 0.159e-3), rel=1e-12)


def test_velocity_behind_the_current_loop_is_the_second_order_response() -> None:
    tau = 0.159e-3
    lagged = run(plant(current_lag=tau), [1.0] * 200)[-1]
    j_over_d, t = 0.01 / 0.14, 200 * DT
    gain = 0.72 / 0.14
    exact = gain * (1.0 - (j_over_d * math.exp(-t / j_over_d) - tau * math.exp(-t / tau)) / (j_over_d - tau))
    assert lagged.velocity == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize("nd", [0, 1, 2, 3, 7])
def test_a_command_acts_exactly_nd_periods_later(nd: int) -> None:
    states = run(plant(delay_samples=nd), [1.0] + [0.0] * 9)
    moved = [k for k, x in enumerate(states) if x.velocity != 0.0]
    assert moved[0] == nd + 1


def test_current_is_limited_and_rounded_in_the_drive() -> None:
    assert run(plant(current_limit=3.0), [100.0])[-1].current == 3.0
    assert run(plant(current_limit=3.0), [-100.0])[-1].current == -3.0
    assert run(plant(current_quantum=0.01), [0.0149])[-1].current == 0.01
    assert run(plant(current_quantum=0.01), [0.0151])[-1].current == 0.02


@pytest.mark.parametrize("nm", [0, 1, 3])
def test_the_encoder_reports_the_position_of_nm_periods_ago(nm: int) -> None:
    p = plant()._replace(encoder=stage.Encoder(0.0, nm))
    states = run(p, [1.0] * 10)
    for k in range(nm, 11):
        assert stage.measured(p.encoder, states[k], stage.SILENT) == states[k - nm].position


def test_encoder_rounds_to_the_nearest_count() -> None:
    encoder = stage.Encoder(0.25, 0)
    at = stage.at_rest(plant()._replace(encoder=encoder), 0.3)
    assert stage.measured(encoder, at, stage.SILENT) == 0.25
    assert stage.measured(encoder, at, stage.Noise(0.0, 0.1, 0.0)) == 0.5
    assert stage.counts(encoder, -0.3) == -1.0


def test_a_held_position_rings_at_the_presliding_resonance(ball_screw: Setup) -> None:
    """70 Hz for stage A: sqrt(sum(alpha/delta)/J)/(2 pi) (control-math.md, section 'The two stages')."""
    p = ball_screw.stage
    stiffness = float(np.sum(p.friction.operators.weight / p.friction.operators.slip))
    expected = math.sqrt(stiffness / p.mechanics.inertia) / (2.0 * math.pi)
    assert expected == pytest.approx(70.0, rel=0.05)
    x = stage.at_rest(p)._replace(velocity=1e-4)  # small: no element slips
    positions = []
    for _ in range(400):
        x = stage.period(p, x, 0.0, stage.SILENT, DT, 20)
        positions.append(x.position)
    crossings = np.flatnonzero(np.diff(np.sign(positions)) != 0)
    frequency = 0.5 * (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * DT)
    assert frequency == pytest.approx(expected, rel=0.01)


def test_it_converges_with_the_square_of_the_step(ball_screw: Setup) -> None:
    """Second order with friction and lag at work: halving the step quarters the error."""
    p = ball_screw.stage
    commands = [5.0 * math.sin(2.0 * math.pi * 20.0 * k * DT) for k in range(200)]
    finest = run(p, commands, 640)[-1].position
    coarse, fine = (abs(run(p, commands, n)[-1].position - finest) for n in (5, 20))
    assert coarse / fine > 6.0  # 16 for a smooth plant; corners of the operators cost some of it
    assert fine < 5e-6  # rad: 10 nm


def test_energy_is_never_made_from_nothing(ball_screw: Setup) -> None:
    p = ball_screw.stage
    x = stage.at_rest(p)._replace(velocity=1.0)
    energies = []
    for _ in range(2000):
        x = stage.period(p, x, 0.0, stage.SILENT, DT, 10)
        spring = 0.5 * np.sum(p.friction.operators.weight * p.friction.operators.slip * x.stops**2)
        energies.append(0.5 * p.mechanics.inertia * x.velocity**2 + spring)
    assert np.all(np.diff(energies) <= 1e-3 * np.max(energies) * DT)
    assert 0.5 * p.mechanics.inertia * x.velocity**2 < 1e-6 * energies[0]  # what is left is strain between elements


@pytest.mark.parametrize("bias", [0.4, -0.9])
def test_at_rest_the_friction_carries_the_bias(ball_screw: Setup, bias: float) -> None:
    """A tilted axis does not sag when nothing moves it: not by a nanometre in a second."""
    p = ball_screw.stage._replace(mechanics=ball_screw.stage.mechanics._replace(bias=bias))
    x = stage.at_rest(p, 0.5)
    assert x.force == pytest.approx(bias, rel=1e-12)
    for _ in range(2000):
        x = stage.period(p, x, 0.0, stage.SILENT, DT, 10)
    assert abs(x.position - 0.5) < 1e-10
    assert stage.at_rest(p._replace(mechanics=p.mechanics._replace(bias=9.0))).force == pytest.approx(1.0)


def test_half_a_count_goes_upwards_on_both_sides_of_zero() -> None:
    encoder = stage.Encoder(0.25, 0)
    halves = [-0.375, -0.125, 0.125, 0.375]
    assert [stage.counts(encoder, place) for place in halves] == [-1.0, 0.0, 1.0, 2.0]


def test_friction_and_encoder_see_the_same_displacement() -> None:
    """An element that never slips is a spring at the axis: F = alpha x / delta, however it is moved."""
    p = plant()._replace(friction=stage.Friction(friction.bundle([2.0], [1.0]), friction.Stribeck()))
    for x in run(p, [math.sin(0.3 * k) for k in range(300)], 3)[1:]:
        assert x.force == pytest.approx(2.0 * x.position, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("lag", [0.0, 0.01])
def test_an_axis_that_moves_on_goes_on_as_fast(lag: float) -> None:
    """With the current that its velocity needs: its friction slips already, in the place of Stribeck's curve there."""
    curve, velocity = friction.Stribeck(0.3, 2.0, 1.0), 2.0
    rubs = stage.Friction(friction.bundle([0.6, 0.4], [1e-4, 2e-3]), curve, lag=lag)
    p = plant()._replace(friction=rubs)
    needed = (0.14 * velocity + 1.0 + 0.3 * math.exp(-1.0)) / 0.72  # A
    x = stage.as_read(p, 0.5, 0.0, (velocity, needed), DT)
    assert x.force == pytest.approx(1.0 + 0.3 * math.exp(-1.0), rel=1e-12)
    for _ in range(20):
        x = stage.period(p, x, needed, stage.SILENT, DT, 10)
        assert x.velocity == pytest.approx(velocity, rel=1e-9)
