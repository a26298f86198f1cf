"""How residuals are formed, step by step: closed forms and properties, no whole pipeline."""

from __future__ import annotations

import dataclasses
import math
from itertools import accumulate
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import friction_family, least_squares, model_tracking, pitch_orders, whitening
from stagectl.gap.residuals.half_strokes import half_strokes, known_from, standstills
from stagectl.gap.residuals.model_tracking import MeasuredPath as Measured
from stagectl.gap.residuals.model_tracking import ModelResidual
from stagectl.gap.residuals.sensitivities import model_of, model_residual
from stagectl.gap.residuals.thresholds import LEAD_ORDERS, ORDERS_PER_WHOLE, ROLL_OFF
from stagectl.kernels import effects, friction, friction_bristle, stage, tracked_model
from stagectl.kernels.fields import put

SETUP = load_stage(Path(__file__).parents[2] / "config" / "ball-screw.yaml")


def _driven(p: stage.Stage, amplitude: float = 3.0, seconds: float = 1.0) -> Measured:
    """The stage in open loop under a current sine, sampled as a log is."""
    n = round(seconds / SETUP.dt)
    command = amplitude * np.sin(2.0 * math.pi * 2.0 * SETUP.dt * np.arange(n))
    rows, x, smooth = np.empty((n, 3)), stage.at_rest(p, 1.0), p.encoder._replace(step=0.0)
    for k in range(n):
        rows[k] = command[k], stage.measured(smooth, x, stage.SILENT), x.current
        x = stage.period(p, x, float(command[k]), stage.SILENT, SETUP.dt, 10)
    return Measured(rows, 0.0, SETUP.dt)


def _tied(p: stage.Stage) -> tracked_model.Tied:
    return tracked_model.Tied(p, model_tracking.tracker(SETUP.stage, SETUP.dt))


def test_a_true_model_has_no_residual() -> None:
    residual = model_tracking.tracking_residual(_tied(SETUP.stage), _driven(SETUP.stage), 10)
    assert np.abs(residual.effort).max() < 1e-9
    assert np.abs(residual.current).max() < 1e-12


def test_a_true_model_has_no_residual_behind_an_encoder_with_errors() -> None:
    """From the first row on: the model starts where the encoder reads it, not where it would be without errors."""
    encoder = SETUP.stage.encoder._replace(step=0.0, eccentricity=effects.Harmonic(3e-4, 1.0, 0.3))
    p = SETUP.stage._replace(encoder=encoder)
    assert np.abs(model_tracking.tracking_residual(_tied(p), _driven(p), 10).effort).max() < 1e-9


def test_a_bristle_that_creeps_at_rest_moves_on_as_the_current_tells() -> None:
    """It gives up half of its load while nothing moves; a model that knows the path alone goes on with all of it."""
    bristle, none = friction_bristle.Bristle(1.0, 500.0, 1.4), friction.bundle((), ())
    p = SETUP.stage._replace(friction=SETUP.stage.friction._replace(operators=none, bristle=bristle))
    path = _creeping(p, 0.8 / p.motor.force_constant)
    told, untold = (
        model_tracking.tracking_residual(_tied(p), one, 10).effort[_GOES_ON:] for one in (path, path._replace(still=()))
    )
    assert np.abs(told).max() < 0.01 * bristle.coulomb
    assert np.abs(untold).max() > 0.1 * bristle.coulomb


_CREEPS, _GOES_ON = 300, 600  # rows


def _creeping(p: stage.Stage, held: float) -> Measured:
    """A rest under a current `held` (A), half of it after the bristle has crept; then a motion."""
    rows, x, smooth = np.empty((1600, 3)), stage.at_rest(p, 1.0, held=held), p.encoder._replace(step=0.0)
    for k in range(len(rows)):
        command = held if k < _CREEPS else 0.5 * held
        if k == _CREEPS:
            waiting = stage.at_rest(p, 1.0, held=command).commands
            x = x._replace(commands=waiting, current=command, bristle=0.5 * x.bristle, force=0.5 * x.force)
        command += 3.0 * math.sin(4.0 * math.pi * SETUP.dt * max(k - _GOES_ON, 0))
        rows[k] = command, stage.measured(smooth, x, stage.SILENT), x.current
        x = stage.period(p, x, command, stage.SILENT, SETUP.dt, 10)
    return Measured(rows, 0.0, SETUP.dt, still=((0, _GOES_ON),), carried=held)


def test_a_constant_effort_is_recovered() -> None:
    p = SETUP.stage
    machine = p._replace(mechanics=p.mechanics._replace(bias=0.2))
    residual = model_tracking.tracking_residual(_tied(p), _driven(machine), 10)
    assert np.median(residual.effort[len(residual.effort) // 2 :]) == pytest.approx(0.2, rel=0.02)


def test_the_residuals_of_two_changes_add_up() -> None:
    p = SETUP.stage
    path = _driven(p)
    damped = p._replace(mechanics=p.mechanics._replace(viscous=1.2 * p.mechanics.viscous))
    heavy = p._replace(mechanics=p.mechanics._replace(inertia=1.1 * p.mechanics.inertia))
    both = damped._replace(mechanics=damped.mechanics._replace(inertia=heavy.mechanics.inertia))
    viscous, inertia, together = (
        model_tracking.tracking_residual(_tied(x), path, 10).effort for x in (damped, heavy, both)
    )
    assert np.linalg.norm(together - viscous - inertia) < 0.02 * np.linalg.norm(together)


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_a_model_is_tracked_whatever_its_inertia(factor: float) -> None:
    """At 94 Hz, with the gains of the nominal inertia, half of it is unstable; the residual is the missing inertia."""
    dt = 1.0 / 94.0
    slippery = SETUP.stage.friction.operators._replace(weight=np.zeros_like(SETUP.stage.friction.operators.weight))
    p = SETUP.stage._replace(friction=SETUP.stage.friction._replace(operators=slippery))
    p = p._replace(mechanics=p.mechanics._replace(viscous=0.0))
    other = p._replace(mechanics=p.mechanics._replace(inertia=factor * p.mechanics.inertia))
    model = model_of(p, dt)._replace(stage=other)
    t = dt * np.arange(1000)
    position = 1.0 - np.cos(2.0 * math.pi * t)
    rows = np.column_stack([np.zeros_like(t), position, np.zeros_like(t)])
    middle = slice(200, 800)
    effort = model_residual(model, Measured(rows, 0.0, dt)).effort[middle]
    acceleration = 4.0 * math.pi**2 * np.cos(2.0 * math.pi * t)[middle]
    assert np.corrcoef(effort, acceleration)[0, 1] > 0.9
    assert np.std(effort) / np.std(acceleration) == pytest.approx(other.mechanics.inertia, rel=0.15)


@pytest.mark.parametrize("dt", [1.0 / 64.0, 1e-2, 1e-3])
def test_friction_does_not_hold_a_model_where_the_machine_moves(dt: float) -> None:
    """A joint at 3 mrad/s with a ripple that its model lacks: a tracker of a few hertz would let the model stick."""
    p = SETUP.stage
    slip = p.friction.operators.slip[0]
    operators = p.friction.operators._replace(weight=5.0 * np.eye(len(p.friction.operators.weight))[0])
    p = p._replace(friction=p.friction._replace(operators=operators))
    for place, value in {
        "drive.current_lag": 0.0, "drive.delay_samples": 0, "drive.current_limit": 1e6, "encoder.delay_samples": 0,
        "mechanics.inertia": 1.0, "mechanics.viscous": 0.0,
    }.items():  # fmt: skip
        p = put(p, place, value)
    row = np.arange(40.0 / dt)

    def joint(t: Array) -> Array:
        return np.asarray(0.01 * np.sin(0.3 * t))

    middle = (row + 0.5) * dt  # a command is held for a period
    turned = joint(middle)
    stop = np.array(
        list(accumulate(np.diff(turned, prepend=0.0), lambda s, dx: min(max(s + dx / slip, -1.0), 1.0), initial=0.0))
    )[1:]
    ripple = 2.0 * np.sin(2.0 * math.pi * turned / 1.2e-3)
    command = (-0.09 * turned + 5.0 * stop + ripple) / p.motor.force_constant
    path = Measured(np.column_stack([command, joint(row * dt), np.full(len(row), np.nan)]), 0.0, dt)
    left = model_residual(model_of(p, dt), path).effort + ripple
    assert np.std(left[len(row) // 4 :]) < 0.1 * np.std(ripple)


def test_whitened_noise_is_flat() -> None:
    source = np.random.default_rng(7)
    noise = [
        ModelResidual(0.03 * source.standard_normal(20000), 0.01 * source.standard_normal(20000)) for _ in range(3)
    ]
    whitener = whitening.whitener(noise, (0.0, 0.0), SETUP.dt)
    flat = dataclasses.replace(
        whitener, effort=whitener.effort * np.hypot(1.0, whitener.frequency * SETUP.dt / ROLL_OFF)
    )
    white = whitening.whitened(flat, noise[0], SETUP.dt)[:, 0]
    assert 0.85 < white.var() < 1.15


def test_the_density_of_noise_that_grows_with_the_frequency_is_known_down_to_the_lowest_band() -> None:
    """Second differences of white noise: 2 dt s^2 (2 sin(pi f dt))^4, from 1e-12 at 0.3 Hz to 1."""
    source, dt = np.random.default_rng(5), 1e-3
    frequency, power = whitening.density([np.diff(source.standard_normal(20002), 2) for _ in range(6)], dt)
    expected = 2.0 * dt * (2.0 * np.sin(math.pi * frequency * dt)) ** 4
    assert frequency[0] < 0.5 and len(frequency) > 25
    assert np.all(np.abs(np.log(power / expected)[1:]) < math.log(2.0))


def test_what_drifts_over_the_session_is_no_noise() -> None:
    repeats = [np.full(50, 3.0 * t) for t in (0.0, 10.0, 30.0)]
    assert np.abs(whitening.single_noise(repeats, (0.0, 10.0, 30.0))).max() < 1e-9
    assert np.abs(whitening.single_noise(repeats[:2], (0.0, 10.0))).max() == pytest.approx(15.0 * math.sqrt(2.0))
    of_one_instant = whitening.single_noise(repeats, (5.0, 5.0, 5.0))
    assert np.mean(of_one_instant**2) == pytest.approx(np.var([0.0, 30.0, 90.0], ddof=1))


def test_what_repeats_differ_by_on_the_whole_is_noise_of_the_lowest_band_alone() -> None:
    dt, offset = 1e-3, 0.3
    frequency, power = whitening.density([np.full(10000, offset), np.full(10000, -offset)], dt)
    width = frequency[1] - frequency[0]
    assert power[0] * 2.0 * width > 0.2 * offset**2
    assert power[1:].max() < 1e-3 * power[0]


def test_bounded_least_squares() -> None:
    source = np.random.default_rng(3)
    x = source.standard_normal((400, 3))
    r = x @ np.array([2.0, -1.0, 0.5])
    z = np.column_stack([x, r])
    free = least_squares.bounded(z.T @ z, [0, 1, 2], np.full(3, -np.inf), np.full(3, np.inf))
    assert free == pytest.approx([2.0, -1.0, 0.5], abs=1e-9)
    held = least_squares.bounded(z.T @ z, [0, 1, 2], np.zeros(3), np.full(3, np.inf))
    assert held[1] == pytest.approx(0.0, abs=1e-9) and held[0] > 1.5
    assert least_squares.residual_sum_of_squares(z.T @ z, [0, 1, 2], free) == pytest.approx(0.0, abs=1e-6)


def test_a_column_that_the_data_do_not_have_moves_nothing() -> None:
    z = np.column_stack([np.arange(5.0), np.zeros(5), 2.0 * np.arange(5.0)])
    fit = least_squares.bounded(z.T @ z, [0, 1], np.full(2, -np.inf), np.full(2, np.inf))
    assert fit == pytest.approx([2.0, 0.0], abs=1e-6)


def test_half_strokes_of_a_sine() -> None:
    t = 0.001 * np.arange(4000)
    number = half_strokes(np.sin(2.0 * math.pi * t), 0.001)  # four periods of one second
    assert 8 <= number.max() + 1 <= 10
    assert np.all(np.diff(number) >= 0)


def test_standstills_are_found() -> None:
    t = 0.001 * np.arange(1000)
    position = np.where(t < 0.3, t, np.where(t < 0.7, 0.3, t - 0.4))
    ((begin, end),) = standstills(position, 0.001)
    assert begin == pytest.approx(300, abs=12) and end == pytest.approx(700, abs=12)


def test_the_friction_is_known_after_three_zones() -> None:
    assert known_from(np.linspace(0.0, 1.0, 101), 0.1) == 31  # three zones
    assert known_from(np.zeros(10), 0.1) == 0


def test_the_family_holds_the_nominal_law_exactly() -> None:
    p = SETUP.stage.friction
    place = np.geomspace(1e-5, 1e-1, 50)
    wide = friction_family.spread(p)
    assert friction_family.reversal(wide, place) == pytest.approx(friction_family.reversal(p, place), abs=1e-12)
    assert len(wide.operators.weight) > len(p.operators.weight)


def test_an_order_of_the_pitch_is_found() -> None:
    turns = np.linspace(-3.0, 4.0, 4000)
    signal = np.sin(2.0 * np.pi * 7.0 * turns + 0.3) + 0.2 * np.random.default_rng(1).standard_normal(4000)
    spectrum = pitch_orders.power(signal[None], turns, 19)[0]
    assert pitch_orders.peaks(np.arange(1, 20), spectrum)[0] == 7
    assert spectrum[6] == pytest.approx(4000 / 4, rel=0.03)


def test_a_ball_pass_may_have_any_order_but_those_of_the_lead() -> None:
    """And those that the travel does not tell from these: 0.01 and 0.23 orders, of 100 and 4.4 turns."""
    for told, apart in ((0.01, 0.09), (0.23, 0.22)):
        orders = pitch_orders._fractional(told) / ORDERS_PER_WHOLE
        assert {3.0, 4.0, 5.95, 6.0}.issubset(np.round(orders, 2).tolist())
        assert all(np.abs(orders - lead).min() > apart for lead in LEAD_ORDERS)
        assert np.abs(orders - 2.0).min() < apart + 0.1


@pytest.mark.parametrize(("ripple", "said"), [(0.0, 0), (0.2, 0), (1.0, 1)])
def test_a_ripple_above_the_band_is_said_to_be_hardly_judged(ripple: float, said: int) -> None:
    """Cogging of a bare motor at a turn a second lies at 72 Hz: at 1 kHz it weighs next to nothing."""
    time = 0.001 * np.arange(4000)
    current = np.sin(2.0 * np.pi * 0.5 * time) + ripple * np.sin(2.0 * np.pi * 72.0 * time)
    log = SimpleNamespace(commanded=True, driving=current, valid=np.ones(len(time), dtype=bool))
    session: Any = SimpleNamespace(dt=0.001, logs=[log])
    assert len(whitening.unjudged(session)) == said
