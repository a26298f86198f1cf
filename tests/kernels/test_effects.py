"""Each effect of the plant against the closed form of its force, current or position."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest
import scipy.signal
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.kernels import effects, friction, friction_bristle, friction_effects, jit, stage
from stagectl.kernels import plant_with_effects as kernels
from stagectl.kernels.effects import Harmonic, Step, Table, Warming
from stagectl.kernels.plant import Along, Base, Cable, Dwell, Reported, SpeedPower, Transmission
from tests.conftest import ROOT, SOURCES
from tests.kernels.affected import affected

DT = 5e-4
J, D, KT, TC, SLIP = 0.01, 0.14, 0.72, 1.0, 1e-3
NOTHING = friction.bundle([0.0], [1.0])


def plant(viscous: float = D, coulomb: float = 0.0) -> stage.Stage:
    """One stop operator that slips at 1 mrad, or none; no lag, no quantum, continuous encoder."""
    return stage.Stage(
        stage.Drive(0.0, 0, 15.0, 0.0),
        stage.Motor(KT),
        stage.Mechanics(J, viscous),
        stage.Friction(friction.bundle([coulomb], [SLIP]) if coulomb else NOTHING, friction.Stribeck()),
        stage.Encoder(0.0, 0),
    )


def mechanics(p: stage.Stage, **changes: object) -> stage.Stage:
    return p._replace(mechanics=p.mechanics._replace(**changes))  # type: ignore[arg-type]


def drive(p: stage.Stage, **changes: object) -> stage.Stage:
    return p._replace(drive=p.drive._replace(**changes))  # type: ignore[arg-type]


def frictional(p: stage.Stage, **changes: object) -> stage.Stage:
    return p._replace(friction=p.friction._replace(**changes))  # type: ignore[arg-type]


def run(p: stage.Stage, current: float, seconds: float, x: stage.State | None = None, steps: int = 10) -> stage.State:
    x = x or stage.at_rest(p)
    for _ in range(round(seconds / DT)):
        x = stage.period(p, x, current, stage.SILENT, DT, steps)
    return x


def moving(p: stage.Stage, velocity: float) -> stage.State:
    x = stage.at_rest(p)
    return x._replace(velocity=velocity, memory=x.memory._replace(load_velocity=velocity))


def test_the_path_with_effects_is_the_plain_one_where_they_vanish(ball_screw: Setup) -> None:
    """Two ways of writing the same integrator."""
    p = ball_screw.stage
    state, other = stage.at_rest(p), stage.at_rest(p)
    for k in range(400):
        current = 3.0 * math.sin(0.05 * k)
        state = stage.period(p, state, current, stage.SILENT, DT, 10)
        other = stage.commanded(p.drive, other, current)
        other = stage.latched(p, kernels.drifted(p, other, stage.SILENT, DT, kernels.steps(p, DT, 10)))
    assert abs(state.position) > 1e-3
    assert other.position == pytest.approx(state.position, rel=1e-9)
    assert other.velocity == pytest.approx(state.velocity, rel=1e-9)


def test_what_only_shapes_a_neutral_effect_changes_no_bit(ball_screw: Setup) -> None:
    p = ball_screw.stage
    idle = p._replace(
        drive=p.drive._replace(foldback_time=3.0, resistance=2.0, back_emf=0.7),
        motor=p.motor._replace(cogging=Harmonic(0.0, 6.0, 0.3)),
        mechanics=p.mechanics._replace(pitch=1.0, viscous_step=Step(0.0, -1.0), base=Base(0.0, 8.0, 0.1)),
        friction=p.friction._replace(dwell=Dwell(0.0, 0.5), along=Along(0.0, 0.0, 1.0), warming=Warming(0.0, 1.0)),
        encoder=p.encoder._replace(eccentricity=Harmonic(0.0, 1.0, 1.0)),
        residual=Table(effects.NONE, 0.0, 1.0, jit.table([5.0])),
    )
    assert run(idle, 2.0, 0.1)[2:6] == run(p, 2.0, 0.1)[2:6]


# --- mechanics ---


def test_quadratic_friction_slows_down_hyperbolically() -> None:
    """v = v0 / (1 + c v0 t / J)."""
    p = mechanics(plant(0.0), viscous_power=SpeedPower(2e-3 * 10.0**2, 10.0, 2.0))
    assert run(p, 0.0, 0.1, moving(p, 20.0)).velocity == pytest.approx(20.0 / (1.0 + 2e-3 * 20.0 * 0.1 / J), rel=1e-4)


def test_friction_of_the_root_slows_down_parabolically() -> None:
    """Root of v = root of v0 - c t / (2 J)."""
    p = mechanics(plant(0.0), viscous_power=SpeedPower(0.2, 1.0, 0.5))
    expected = (math.sqrt(20.0) - 0.2 * 0.1 / (2.0 * J)) ** 2
    assert run(p, 0.0, 0.1, moving(p, 20.0)).velocity == pytest.approx(expected, rel=1e-4)
    assert abs(run(p, 0.0, 1.0, moving(p, 20.0)).velocity) < 1e-4  # and it stands at last


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_viscous_friction_differs_by_direction(sign: float) -> None:
    p = mechanics(plant(), viscous_asymmetry=0.2)
    assert run(p, 2.0 * sign, 1.5).velocity == pytest.approx(2.0 * sign * KT / (D * (1.0 + 0.2 * sign)), rel=1e-6)


def test_viscous_friction_follows_the_session_clock() -> None:
    p = mechanics(plant(), viscous_warming=Warming(0.5, 600.0), viscous_step=Step(0.2, 1000.0))
    for time, factor in (
        (0.0, 1.5),
        (600.0, 1.0 + 0.5 * math.exp(-1.0)),
        (1000.0, 1.2 * (1.0 + 0.5 * math.exp(-5 / 3))),
    ):
        end = run(p, 2.0, 1.5, stage.at_rest(p, 0.0, time))
        assert end.velocity == pytest.approx(2.0 * KT / (D * factor), rel=2e-3)
        assert end.memory.time == pytest.approx(time + 1.5)


def test_a_cable_pulls_to_its_centre_and_holds_by_its_hysteresis() -> None:
    p = mechanics(plant(), cable=Cable(0.5, 0.3, 0.0, 1.0))
    assert run(p, 1.0, 4.0).position == pytest.approx(0.3 + KT / 0.5, rel=1e-4)
    p = mechanics(plant(), cable=Cable(0.0, 0.0, 0.4, 0.1))
    assert run(p, 2.0, 1.5).velocity == pytest.approx((2.0 * KT - 0.4) / D, rel=1e-6)
    assert run(p, 0.25 / KT, 4.0).position == pytest.approx(0.25 / 0.4 * 0.1, rel=1e-3)  # sticks: a spring


def test_motor_and_load_ring_at_their_resonance() -> None:
    p = mechanics(plant(0.0), transmission=Transmission(0.4, 300.0, 0.0, 0.0, 1.0))
    x, differences = stage.at_rest(p)._replace(velocity=0.1), []
    for _ in range(4000):
        x = stage.drifted(p, x, stage.SILENT, 5e-5, 1)
        differences.append(x.position - x.memory.load)
    signs = np.flatnonzero(np.diff(np.sign(differences)) != 0)
    assert 0.5 * (len(signs) - 1) / ((signs[-1] - signs[0]) * 5e-5) == pytest.approx(300.0, rel=2e-3)
    assert x.velocity * 0.6 + x.memory.load_velocity * 0.4 == pytest.approx(0.06, rel=1e-9)  # momentum


def test_the_load_follows_by_half_a_gap_on_either_side() -> None:
    """Friction at the load: the motor crosses the gap alone, then takes it along, behind gap and wound spring."""
    p = mechanics(plant(D, TC), transmission=Transmission(0.5, 300.0, 0.05, 0.01, 1.0))
    reduced = 0.25 * J
    spring = (2.0 * math.pi * 300.0) ** 2 * reduced
    for sign in (1.0, -1.0):
        x = run(p, 3.0 * sign, 1.0)
        # the load, half of the inertia, at constant speed: the spring carries all friction
        through = TC + D * abs(x.velocity)
        assert sign * (x.position - x.memory.load) == pytest.approx(0.005 + through / spring, rel=1e-3)
    inside = run(p, 0.0, 0.02, stage.at_rest(p)._replace(velocity=0.1))
    assert inside.position == pytest.approx(0.002, rel=1e-9)  # nothing brakes the motor within the gap
    assert inside.memory.load == 0.0


def test_the_base_yields_and_rings() -> None:
    """x_b = -mu E / (J w^2) under a held effort of a stuck axis; free: w, and no friction turns it."""
    p = mechanics(plant(0.0), base=Base(0.1, 20.0, 0.0), bias=0.5)
    w = 2.0 * math.pi * 20.0
    x, places = stage.at_rest(p), []
    for _ in range(400):
        x = stage.period(p, x, 0.0, stage.SILENT, DT, 10)
        places.append(x.memory.base)
    t = DT * np.arange(1, 401)
    expected = -0.1 * 0.5 / (J * w * w) * (1.0 - np.cos(w * t))
    np.testing.assert_allclose(places, expected, atol=2e-3 * np.abs(expected).max())
    # q + x_b, seen from the ground: E / J
    assert x.position + x.memory.base == pytest.approx(0.5 * 0.5 / J * t[-1] ** 2, rel=1e-6)


# --- motor and drive ---


def test_cogging_stores_and_returns_energy() -> None:
    """J (v^2 - v0^2) / 2 = A / n (cos phase - cos(n theta + phase)) pitch / 2 pi."""
    p = mechanics(plant(0.0), pitch=3.0)
    p = p._replace(motor=p.motor._replace(cogging=Harmonic(0.1, 6.0, 0.3), cogging_second=Harmonic(0.05, 12.0, 0.0)))
    x = run(p, 0.0, 0.1, moving(p, 5.0))
    angle, work = 2.0 * math.pi * x.position / 3.0, 0.0
    for size, order, phase in ((0.1, 6.0, 0.3), (0.05, 12.0, 0.0)):
        work += size / order * (math.cos(phase) - math.cos(order * angle + phase)) * 3.0 / (2.0 * math.pi)
    assert 0.5 * J * (x.velocity**2 - 25.0) == pytest.approx(work, rel=1e-3)


def test_ripple_goes_with_the_current() -> None:
    p = plant(0.0)
    p = p._replace(motor=p.motor._replace(ripple=Harmonic(0.2, 4.0, 0.0)))
    x = run(p, 1.0, 0.05, moving(p, 5.0))
    work = KT * (x.position + 0.2 / 4.0 * (1.0 - math.cos(4.0 * x.position)))
    assert 0.5 * J * (x.velocity**2 - 25.0) == pytest.approx(work, rel=1e-5)


@pytest.mark.parametrize("dead", [0.2, 1.0, 1.25, 5.9])
@pytest.mark.parametrize("steps", [1, 3, 10])
def test_dead_time_delays_by_fractions_of_a_period(dead: float, steps: int) -> None:
    """Constant current from t = nd Ts + T_d on: v = Kt i / J (t - nd Ts - T_d), whatever the steps."""
    p = drive(plant(0.0), dead_time=dead * DT, delay_samples=1)
    x = run(p, 1.0, 20 * DT, None, steps)
    assert x.velocity == pytest.approx(KT / J * (20 - 1 - dead) * DT, rel=1e-9)


def test_jitter_moves_the_command_within_its_period_and_never_back() -> None:
    p = drive(plant(0.0), dead_time=DT, jitter=1e-4)
    x, begun = stage.at_rest(p), []
    for k in range(200):
        noise = stage.Noise(0.0, 0.0, 0.9 * DT * math.sin(2.7 * k))
        x = stage.period(p, x, float(k), noise, DT, 4)
        begun.append(x.memory.acting)
    assert np.all(np.diff(begun[3:]) >= 0.0)
    late = run(p, 1.0, 20 * DT)
    assert late.velocity == pytest.approx(KT / J * 19 * DT, rel=1e-9)
    once = stage.period(p, late, 0.0, stage.Noise(0.0, 0.0, 1e-4), DT, 4)
    once = stage.period(p, once, 0.0, stage.Noise(0.0, 0.0, 1e-4), DT, 4)
    assert once.velocity - late.velocity == pytest.approx(KT / J * (DT + 1e-4), rel=1e-6)


def test_an_offset_is_motor_current() -> None:
    assert run(drive(plant(), offset=0.3), 1.0, 0.01).current == pytest.approx(1.3)


def test_the_limit_folds_back_to_the_continuous_current() -> None:
    """Full current until 80 % of the heat, so for 0.8 of the time; then down to the continuous one."""
    p = drive(plant(), continuous_current=5.0, foldback_time=0.2, current_limit=10.0)
    assert run(p, 20.0, 0.155).current == 10.0
    assert 5.0 < run(p, 20.0, 0.19).current < 9.9
    assert run(p, 20.0, 1.0).current == pytest.approx(5.0, abs=0.05)
    assert run(p, 4.0, 1.0).current == 4.0


def test_the_voltage_limits_the_speed() -> None:
    """v = U Kt / (R D + Ke Kt) where the drive is asked for more."""
    p = drive(plant(), voltage_limit=24.0, resistance=2.0, back_emf=0.7)
    for sign in (1.0, -1.0):
        assert run(p, 15.0 * sign, 1.0).velocity == pytest.approx(sign * 24.0 * KT / (2.0 * D + 0.7 * KT), rel=1e-3)


def test_the_drive_reports_late_scaled_and_shifted() -> None:
    p = drive(plant(), telemetry=Reported(0.02, 0.1, 0.25 * DT))
    x = run(p, 1.0, 10 * DT)
    x = stage.period(p, x, 3.0, stage.SILENT, DT, 10)
    assert x.current == 3.0
    assert stage.reported(p.drive, x, DT) == pytest.approx((0.75 * 3.0 + 0.25 * 1.0) * 1.02 + 0.1)


@pytest.mark.parametrize("damping", [0.45, 0.99999999, 1.0, 1.5, 4.9])
def test_a_current_loop_of_second_order_follows_its_transfer_function(damping: float) -> None:
    """``1 / (1 + T s + (T s / 2 zeta)^2)``, by another library; exact, so that the number of steps does not matter."""
    lag, time = 0.4e-3, np.arange(1, 21) * DT
    p = drive(plant(), current_lag=lag, current_damping=damping)
    _, expected = scipy.signal.step(([1.0], [(lag / (2.0 * damping)) ** 2, lag, 1.0]), T=np.array([0.0, *time]))
    for steps in (1, 10):
        x, currents = stage.at_rest(p), []
        for _ in time:
            x = stage.period(p, x, 3.0, stage.SILENT, DT, steps)
            currents.append(x.current)
        assert currents == pytest.approx(list(3.0 * expected[1:]), abs=1e-5)


def test_a_current_loop_of_second_order_drives_by_its_mean(ball_screw: Setup) -> None:
    """The velocity after a step without friction is the integral of the current."""
    p = drive(plant(viscous=0.0), current_lag=0.4e-3, current_damping=0.5)
    coarse, fine = (run(p, 3.0, 0.01, steps=steps) for steps in (1, 50))
    late = 3.0 * KT / J * (0.01 - 0.4e-3)  # the lag is the area that is missing
    assert coarse.velocity == pytest.approx(fine.velocity, rel=1e-9) and fine.velocity == pytest.approx(late, rel=1e-4)


@pytest.mark.parametrize("late", [0.25, 0.5, 0.9])
def test_a_late_report_is_the_current_that_flowed_then(late: float) -> None:
    """``i(t) = 3 - 2 exp(-t / lag)`` within a period, read `late` before its end."""
    lag = 0.4 * DT
    p = drive(plant(), current_lag=lag, telemetry=Reported(late=late * DT))
    x = stage.period(p, run(p, 1.0, 0.1), 3.0, stage.SILENT, DT, 10)
    assert stage.reported(p.drive, x, DT) == pytest.approx(3.0 - 2.0 * math.exp(-(1.0 - late) * DT / lag), rel=1e-6)


@pytest.mark.parametrize("late", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("dead", [0.3, 0.7, 1.6])
def test_a_late_report_of_a_drive_with_a_dead_time_is_the_current_that_flowed_then(dead: float, late: float) -> None:
    """``lag di/dt = u(t - dead) - i`` by small steps, commands that change every period; times in periods."""
    lag, fine, commands = 0.4, 20_000, (1.0, 3.0, -2.0, 4.0, 0.5)
    p = drive(plant(), current_lag=lag * DT, dead_time=dead * DT, telemetry=Reported(late=late * DT))
    x, current, flowed = run(p, 1.0, 0.1), 1.0, []
    for step in range(len(commands) * fine):
        number = math.floor(step / fine - dead)
        current += ((commands[number] if number >= 0 else 1.0) - current) / (lag * fine)
        flowed.append(current)
    for k, command in enumerate(commands):
        x = stage.period(p, x, command, stage.SILENT, DT, 100)
        assert stage.reported(p.drive, x, DT) == pytest.approx(flowed[round((k + 1 - late) * fine) - 1], abs=2e-3)


# --- friction ---


@pytest.mark.parametrize("bristled", [False, True])
@pytest.mark.parametrize(
    ("changes", "factor"),
    [
        ({"asymmetry": 0.1}, lambda x, v: 1.0 + math.copysign(0.1, v)),
        ({"load": 0.05}, lambda x, v: 1.0 + 0.05 * 4.0 * KT / TC),
        ({"along": Along(0.02, 0.01, 0.5)}, lambda x, v: 1.0 + 0.02 * (x - 0.5) + 0.01 * (x - 0.5) ** 2),
        ({"lead": Harmonic(0.1, 1.0, 0.4)}, lambda x, v: 1.0 + 0.1 * math.sin(x + 0.4)),
        ({"ball_pass": Harmonic(0.1, 7.3, 0.0)}, lambda x, v: 1.0 + 0.1 * math.sin(7.3 * x)),
        ({"warming": Warming(0.4, 600.0)}, lambda x, v: 1.0 + 0.4 * math.exp(-0.2 / 600.0)),
        ({"step": Step(-0.3, 0.1)}, lambda x, v: 0.7),
        ({"step": Step(-0.3, 0.3)}, lambda x, v: 1.0),
    ],
)
def test_what_slips_carries_the_factor(changes: dict[str, object], factor: object, bristled: bool) -> None:
    """Sliding at speed, the force is T_c times the factor of this place, side and time."""
    p = frictional(plant(D, TC), **changes)
    if bristled:
        p = frictional(p, operators=NOTHING, bristle=friction_bristle.Bristle(TC, TC / SLIP))
    for sign in (1.0, -1.0):
        x = run(p, 4.0 * sign, 0.2)
        assert abs(x.position) > 100.0 * SLIP
        expected = factor(x.position, x.velocity)  # type: ignore[operator]
        assert x.force == pytest.approx(sign * TC * expected, rel=2e-3 if bristled else 1e-6)


@pytest.mark.parametrize("length", [0.0, 3.0 * SLIP])
def test_ageing_raises_the_break_away_and_slip_wipes_it(length: float) -> None:
    """T_c (1 + b ln(1 + t_d / tau)); each move wipes by its share F / (T_c factor); sliding: length / |v|."""
    p = frictional(plant(D, TC), dwell=Dwell(0.1, 0.1, length))
    wiping = length or SLIP
    x = run(p, 0.0, 1.0)
    assert x.memory.rested == pytest.approx(1.0, rel=1e-9)
    forces = []
    for k in range(1500):
        x = stage.period(p, x, 2.0 * TC / KT * k / 1000, stage.SILENT, DT, 10)
        forces.append(x.force)
    rate, force, age = 2.0 * TC / (1000 * DT), 0.0, 1.0  # the operator as a spring under a slow ramp
    while force < TC * (1.0 + 0.1 * math.log(1.0 + age / 0.1)):
        share = force / (TC * (1.0 + 0.1 * math.log(1.0 + age / 0.1)))
        age += 1e-5 * (1.0 - age * share * rate / TC * SLIP / wiping)
        force += 1e-5 * rate
    assert 1.1 * TC < force < TC * (1.0 + 0.1 * math.log(1.0 + (1.0 if not length else 2.0) / 0.1))
    assert max(forces) == pytest.approx(force, rel=0.005)
    assert x.memory.rested == pytest.approx(wiping / x.velocity, rel=0.05)
    assert forces[-1] == pytest.approx(TC * (1.0 + 0.1 * math.log1p(x.memory.rested / 0.1)), rel=1e-3)


def test_an_axis_that_begins_at_a_reading_reads_it() -> None:
    """An encoder with errors stands where it reads the log's first row: nothing moves to get there."""
    grating = stage.Encoder(0.0, 0, Harmonic(3e-4, 1.0, 0.4), Harmonic(2.4e-5, 1024.0, 1.0), Harmonic(9e-6, 2048.0))
    p = plant()._replace(encoder=grating)
    for reading in (-2.7, 0.0, 31.4):
        x = stage.at_reading(p, reading, 7.0)
        assert stage.measured(p.encoder, x, stage.SILENT) == pytest.approx(reading, abs=1e-13)
        assert 1e-5 < abs(x.position - reading) < 4e-4
        assert (x.velocity, x.memory.time) == (0.0, 7.0)
    assert stage.at_reading(plant(), 31.4).position == 31.4


def test_stribecks_velocity_lags() -> None:
    p = frictional(plant(D, TC), stribeck=friction.Stribeck(0.5, 3.0, 1.0), lag=0.02)
    x, velocity = moving(p, 5.0), 5.0
    lagged, forces = 0.0, []
    for _ in range(60):
        x = stage.period(p, x, (TC + D * 5.0) / KT, stage.SILENT, DT, 10)
        lagged += (0.5 * (velocity + x.velocity) - lagged) * -math.expm1(-DT / 0.02)
        velocity = x.velocity
        forces.append((x.force, TC * (1.0 + 0.5 * math.exp(-lagged / 3.0))))
    measured, expected = np.array(forces[20:]).T
    np.testing.assert_allclose(measured, expected, rtol=1e-3)


@pytest.mark.parametrize("bristled", [False, True])
def test_friction_with_every_effect_never_gives_out_energy(ball_screw: Setup, bristled: bool) -> None:
    """Work of the friction over a random path is at least what its elements have stored."""
    p = affected(ball_screw.stage)
    if bristled:
        law = friction_bristle.Bristle(TC, TC / SLIP, 1.0)
        p = frictional(p, operators=NOTHING, bristle=law)
    rng, work, least = np.random.default_rng(3), 0.0, 0.0
    x = stage.at_rest(p._replace(motor=stage.Motor(KT), drive=ball_screw.stage.drive, residual=effects.NO_TABLE))
    held = friction_effects.held(p.friction, 5e-5)
    drift = effects.drifting(p.friction.warming, p.friction.step, 0.0)
    contact, position, velocity = stage.Contact(x.force, x.bristle, 0.0, 0.0), 0.0, 0.0
    begin = _stored(p, x.stops, x.bristle)
    for _ in range(20000):
        velocity = 0.999 * velocity + 0.02 * rng.normal()
        dx = 5e-5 * velocity
        position += dx
        place = drift * friction_effects.place_factor(
            p.friction.along, p.friction.lead, p.friction.lead_second, p.friction.ball_pass, (position, position)
        )
        limits = friction_effects.limits(held, contact, velocity, place, 3.0 * rng.normal())
        force = friction.stops_between(p.friction.operators, x.stops, dx, limits.low, limits.high)
        contact = friction_effects.slid(held, contact, limits, force, dx)
        work += contact.force * dx
        least = min(least, work + begin - _stored(p, x.stops, contact.bristle))
    assert least >= -1e-9 if not bristled else least >= -1e-6 * work
    assert work > 0.05


def _stored(p: stage.Stage, stops: object, bristle: float) -> float:
    pairs = zip(p.friction.operators.weight, p.friction.operators.slip, stops, strict=True)  # type: ignore[call-overload]
    return float(sum(0.5 * a * d * s * s for a, d, s in pairs)) + 0.5 * p.friction.bristle.stiffness * bristle**2


# --- sensor and residual ---


def test_the_encoder_adds_its_harmonics_before_it_rounds() -> None:
    p = mechanics(plant(), pitch=2.0)
    p = p._replace(encoder=stage.Encoder(0.0, 1, Harmonic(1e-3, 1.0, 0.2), Harmonic(1e-4, 50.0, 0.0)))
    before = run(p, 1.0, 0.1)
    x = stage.period(p, before, 1.0, stage.SILENT, DT, 10)
    angle = math.pi * before.position
    expected = before.position + 1e-3 * math.sin(angle + 0.2) + 1e-4 * math.sin(50.0 * angle)
    assert stage.measured(p.encoder, x, stage.SILENT) == pytest.approx(expected, rel=1e-12)


COORDINATES = [
    (effects.VELOCITY, lambda x: x.velocity),
    (effects.SINCE_REVERSAL, lambda x: x.position),
    (effects.POSITION, lambda x: x.position),
    (effects.POSITION_MOD_PITCH, lambda x: x.position % 0.5),
    (effects.CURRENT, lambda x: x.current),
    (effects.TIME, lambda x: x.memory.time),
    (effects.SPEED, lambda x: abs(x.velocity)),
]


@pytest.mark.parametrize(("code", "place"), COORDINATES, ids=[effects.COORDINATES[c] for c, _ in COORDINATES])
def test_a_residual_opposes_the_motor_by_its_table(code: int, place: object) -> None:
    """The acceleration of one short step tells the effort."""
    values = [0.1, -0.2, 0.5, 0.3]
    base = mechanics(plant(0.0), pitch=0.5)
    p = base._replace(residual=Table(code, -4.0, 3.0, jit.table(values)))
    x = run(p, -1.5, 0.1, moving(p, -3.0))
    rows = (place(x) + 4.0) / 3.0  # type: ignore[operator]
    effort = float(np.interp(rows, range(4), values))
    after = stage.drifted(p, x, stage.SILENT, 1e-7, 1)
    assert (after.velocity - x.velocity) / 1e-7 * J == pytest.approx(-1.5 * KT - effort, rel=1e-4)


# --- all of them ---


@pytest.mark.parametrize("split", [Transmission(), Transmission(0.5, 800.0, 0.03, 2e-4, 0.7)], ids=["rigid", "split"])
def test_halving_the_step_changes_nothing_that_matters(ball_screw: Setup, split: Transmission) -> None:
    p = affected(ball_screw.stage, split)
    paths = {name: _path(plant_, steps) for name, plant_, steps in (("plain", ball_screw.stage, 10), ("ten", p, 10))}
    paths["twenty"] = _path(p, 20)
    effect = float(np.sqrt(np.mean((paths["ten"] - paths["plain"]) ** 2)))
    step = float(np.sqrt(np.mean((paths["ten"] - paths["twenty"]) ** 2)))
    assert effect > 1e-3
    assert step < 0.01 * effect


def _path(p: stage.Stage, steps: int) -> NDArray[np.float64]:
    x, states = stage.at_rest(p), []
    for k in range(400):
        x = stage.period(p, x, 3.0 * math.sin(0.03 * k), stage.SILENT, DT, steps)
        states.append(x.position)
    return np.array(states)


@pytest.mark.parametrize("bias", [0.0, 0.4])
@pytest.mark.parametrize("split", [Transmission(), Transmission(0.5, 400.0, 0.05, 2e-4, 0.6)], ids=["rigid", "split"])
def test_at_rest_all_of_them_are_carried(ball_screw: Setup, split: Transmission, bias: float) -> None:
    p = mechanics(affected(ball_screw.stage, split), bias=bias)
    x = stage.at_rest(p, 0.5)
    for _ in range(400):
        x = stage.period(p, x, 0.0, stage.SILENT, DT, 10)
    assert abs(x.position - 0.5) < 1e-9
    assert abs(x.memory.load_velocity) < 1e-9


SCRIPT = """
import hashlib, struct, math
from tests.conftest import CONFIG
from tests.kernels.affected import affected
from stagectl.config.stage_file import load_stage
from stagectl.kernels import friction_bristle, stage
from stagectl.kernels.plant import Transmission
p = affected(load_stage(CONFIG / "ball-screw.yaml").stage, Transmission(0.5, 400.0, 0.03, 1e-4, 0.7))
bristle = friction_bristle.Bristle(0.3, 300.0, 1.5, 0.01, p.friction.stribeck)
p, digest = p._replace(friction=p.friction._replace(bristle=bristle)), hashlib.sha256()
x = stage.at_rest(p, 0.1, 5.0)
for k in range(100):
    noise = stage.Noise(0.01 * math.sin(k), 0.0, 1e-5 * math.sin(3 * k))
    x = stage.period(p, x, 4.0 * math.sin(0.1 * k), noise, 5e-4, 4)
    digest.update(struct.pack("<6d", *x[2:6], stage.reported(p.drive, x, 5e-4), x.latched[0]))
    digest.update(struct.pack("<6d", *(x.memory[i] for i in (4, 5, 7, 9, 10, 11))))
found = digest.hexdigest()
"""


def test_compiled_and_interpreted_give_the_same_bits() -> None:
    compiled: dict[str, object] = {}
    exec(compile(SCRIPT, "compiled", "exec"), compiled)
    environment = {**os.environ, "STAGECTL_KERNELS": "interpreted", "PYTHONPATH": SOURCES}
    command = [sys.executable, "-c", SCRIPT + "print(found)"]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True)
    assert compiled["found"] == done.stdout.strip()


def test_a_decay_and_its_mean_are_exact_on_both_sides_of_the_series() -> None:
    """The series goes over into the function: nothing steps there, at any damping."""
    for y in (0.0, 1e-12, 1e-4, 0.00999999, 0.01, 0.0100001, 0.7, 30.0, 800.0):
        left, mean = effects.decayed(y)
        assert left == pytest.approx(math.exp(-y), abs=3e-16)
        assert mean == pytest.approx(-math.expm1(-y) / y if y else 1.0, rel=4e-16, abs=0.0)
