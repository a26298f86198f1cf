"""Friction over the reference: closed forms at a reversal, and every way in which a motion can stop and go on."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from stagectl_studies.reproduction.reversal_error import reversal_errors

from stagectl.compensation.legs import Array, legs
from stagectl.compensation.zero_crossing import Displacement, Exponential, Form, Gaussian, Symmetric
from stagectl.trajectories.motion import Motion
from stagectl.trajectories.periodic import Sine
from stagectl.trajectories.profiles import Dwell, SCurve, Trapezoid
from stagectl.trajectories.sequence import Sequence

DT = 0.5e-3
EXPONENTIAL = Exponential(20e-3, 15e-3, 5.3, 4.5, 4.2)
GAUSSIAN = Gaussian(20e-3, 18e-3, 5.3, 4.5, 4.2)
DISPLACEMENT = Displacement(3e-3, 14e-6, 5.3, 4.5, 4.2)
SYMMETRIC = Symmetric(20e-3, 5.3, 4.5, 4.2)
CONTINUOUS = (EXPONENTIAL, GAUSSIAN, DISPLACEMENT)
BACK_AND_FORTH = Trapezoid(5e-3, 10e-3, 0.1, 0.0, 2)
TZ, RAMP = 0.6, 0.1  # s, first reversal of it, and how long it accelerates
MESSY = Sequence(
    (
        Trapezoid(2e-3, 10e-3, 0.1, 30e-3, 1),
        Dwell(50e-3),
        Trapezoid(1e-3, 10e-3, 0.2, 20e-3, 2, True),  # goes on in the same direction
        Sine(20e-6, 8.0, 4.0, 1.0),  # turns round within the sliding distance
        SCurve(-1e-3, 20e-3, 0.2, 5.0, 0.0, 2),
    )
)


def sampled(trajectory: Any, dt: float = DT, ahead: float = 0.0, more: float = 0.1) -> tuple[Array, Motion]:
    t = dt * np.arange(round((trajectory.duration + more) / dt))
    return t, trajectory.at(t + ahead)


def force(form: Form, motion: Motion, dt: float = DT) -> Array:
    return form.along(legs(motion.position, motion.velocity, dt))


def test_legs_meet_where_the_velocity_crosses_zero() -> None:
    _, motion = sampled(BACK_AND_FORTH, ahead=0.2e-3)  # so that no sample lies on a crossing
    cut = legs(motion.position, motion.velocity, DT)
    assert cut.way.tolist() == [0.0, 1.0, -1.0, 1.0, -1.0]
    assert cut.start[1:] + 0.2e-3 == pytest.approx([0.0, 0.6, 1.2, 1.8], abs=1e-9)
    assert cut.end[-1] + 0.2e-3 == pytest.approx(2.4, abs=1e-9)
    assert cut.length[1:] == pytest.approx(5e-3, abs=1e-12)
    assert cut.reversals().tolist() == [2, 3, 4]


def test_the_papers_form_at_a_reversal_is_its_equation() -> None:
    t, motion = sampled(BACK_AND_FORTH)
    friction = force(EXPONENTIAL, motion)
    before = (t > TZ - 0.2) & (t <= TZ)
    after = (t > TZ) & (t < TZ + 0.2)
    assert friction[before] == pytest.approx(4.5 + 0.8 * np.exp(-(TZ - t[before]) / 20e-3), abs=1e-6)
    tail = (5.3 + 4.2) * np.exp(-(t[after] - TZ) / 15e-3)
    rise = (5.3 - 4.2) * np.exp(-(1.2 - t[after]) / 20e-3)  # of the next crossing: nothing yet
    assert friction[after] == pytest.approx(-4.2 + tail - rise, abs=1e-6)


def test_the_gaussian_behind_the_crossing() -> None:
    t, motion = sampled(BACK_AND_FORTH)
    after = (t > TZ) & (t < TZ + 0.2)
    expected = -4.2 + (5.3 + 4.2) * np.exp(-(((t[after] - TZ) / 18e-3) ** 2))
    assert force(GAUSSIAN, motion)[after] == pytest.approx(expected, abs=1e-6)


def test_the_displacement_form_at_a_reversal() -> None:
    t, motion = sampled(BACK_AND_FORTH)
    after = (t > TZ) & (t < TZ + RAMP)
    s, v = 5e-3 - motion.position[after], np.abs(motion.velocity[after])
    expected = -(4.2 + 1.1 * np.exp(-v / 3e-3)) * (1.0 - 2.0 * np.exp(-s / 14e-6))
    assert force(DISPLACEMENT, motion)[after] == pytest.approx(expected, abs=1e-6)


def test_the_symmetric_curve_jumps_and_is_symmetric() -> None:
    form = SYMMETRIC._replace(negative=4.5)
    _, motion = sampled(BACK_AND_FORTH, ahead=0.25e-3)
    friction, k = force(form, motion), round(TZ / DT)
    near = 5.3 - 4.5
    assert friction[k - 1] == pytest.approx(4.5 + near * math.exp(-0.25e-3 / 20e-3), abs=1e-9)
    assert friction[k] == pytest.approx(-friction[k - 1], abs=1e-9)
    assert friction[k : k + 200] == pytest.approx(-friction[k - 200 : k][::-1], abs=1e-9)


def test_the_displacement_form_knows_no_time() -> None:
    """The same path at another acceleration: the same force at the same place, where Stribeck is neutral."""
    form = DISPLACEMENT._replace(static=4.5, negative=4.5)
    place = np.linspace(4.9e-3, 5e-3, 50)
    forces = []
    for acceleration in (0.05, 0.2):
        t, motion = sampled(Trapezoid(5e-3, 10e-3, acceleration, 0.0, 1), dt=0.05e-3)
        back = t > t[np.argmax(motion.position)]
        forces.append(np.interp(-place, -motion.position[back], force(form, motion, 0.05e-3)[back]))
    assert forces[0] == pytest.approx(forces[1], abs=5e-4)
    assert forces[0][0] == pytest.approx(-4.5, abs=0.01)
    assert forces[0][-1] == pytest.approx(4.5, abs=1e-3)


@pytest.mark.parametrize("form", CONTINUOUS, ids=lambda form: type(form).__name__)
def test_continuous_whatever_the_motion_does(form: Form) -> None:
    """Ten times finer, the largest step is ten times smaller; a jump would stay."""
    coarse = np.max(np.abs(np.diff(force(form, sampled(MESSY, 0.1e-3)[1], 0.1e-3))))
    fine = np.max(np.abs(np.diff(force(form, sampled(MESSY, 0.01e-3)[1], 0.01e-3))))
    assert 0.05 * coarse < fine < 0.15 * coarse
    assert coarse < 0.5


@pytest.mark.parametrize("form", CONTINUOUS, ids=lambda form: type(form).__name__)
def test_never_beyond_the_static_friction(form: Form) -> None:
    assert 5.2 < np.max(np.abs(force(form, sampled(MESSY)[1]))) <= 5.3 * (1.0 + 1e-12)


@pytest.mark.parametrize("form", [*CONTINUOUS, SYMMETRIC], ids=lambda form: type(form).__name__)
def test_a_mirrored_motion_has_the_mirrored_force(form: Form) -> None:
    _, motion = sampled(MESSY)
    turned = form._replace(positive=form.negative, negative=form.positive)
    assert turned.along(legs(-motion.position, -motion.velocity, DT)) == pytest.approx(-force(form, motion), abs=1e-9)


@pytest.mark.parametrize("form", [*CONTINUOUS, SYMMETRIC], ids=lambda form: type(form).__name__)
def test_a_standstill_holds_the_force(form: Form) -> None:
    t, motion = sampled(Trapezoid(5e-3, 10e-3, 0.1, 0.2, 1))
    standing = force(form, motion)[(t > 0.6) & (t < 0.8)]
    assert np.ptp(standing) == 0.0 and standing[0] == pytest.approx(5.3, abs=1e-6)


@pytest.mark.parametrize("form", [*CONTINUOUS, SYMMETRIC], ids=lambda form: type(form).__name__)
def test_going_on_does_not_start_anew(form: Form) -> None:
    """The same direction again: from Cs down to C1, never through zero."""
    t, motion = sampled(Trapezoid(5e-3, 10e-3, 0.1, 0.2, 2, True))
    friction = force(form, motion)
    again = friction[(t > 0.8) & (t < 1.2)]
    assert again[0] == pytest.approx(5.3, abs=0.1) and np.min(again) == pytest.approx(4.5, abs=0.05)
    assert np.all(again > 4.4)


@pytest.mark.parametrize("form", CONTINUOUS, ids=lambda form: type(form).__name__)
def test_from_rest_it_begins_at_zero_even_where_the_first_row_moves(form: Form) -> None:
    _, motion = sampled(BACK_AND_FORTH, ahead=0.9e-3)
    friction = force(form, motion)
    assert 0.0 < friction[0] < 0.6
    assert np.all(np.diff(friction[:20]) > 0.0)


def test_from_rest_the_displacement_form_takes_half_the_slip() -> None:
    """Masing: the first branch is the reversal's, halved in force and in displacement: the same stiffness."""
    form = Displacement(1e-9, 14e-6, 4.5, 4.5, 4.5)
    _, motion = sampled(BACK_AND_FORTH)
    friction = force(form, motion)[:100]
    assert friction == pytest.approx(4.5 * (1.0 - np.exp(-2.0 * motion.position[:100] / 14e-6)), abs=1e-9)


@pytest.mark.parametrize("form", [*CONTINUOUS, SYMMETRIC], ids=lambda form: type(form).__name__)
def test_no_motion_no_force(form: Form) -> None:
    assert form.along(legs(np.zeros(50), np.zeros(50), DT)).tolist() == [0.0] * 50
    assert form.along(legs(np.zeros(0), np.zeros(0), DT)).tolist() == []


@pytest.mark.parametrize("form", [*CONTINUOUS, SYMMETRIC], ids=lambda form: type(form).__name__)
def test_without_a_reversal_it_is_the_constant_friction(form: Form) -> None:
    t, motion = sampled(Trapezoid(-20e-3, 10e-3, 0.1, 0.0, 1, True))
    assert force(form, motion)[(t > 0.5) & (t < 1.5)] == pytest.approx(-4.2, abs=0.05)


@pytest.mark.parametrize("form", [*CONTINUOUS, SYMMETRIC], ids=lambda form: type(form).__name__)
def test_half_the_period_gives_the_same_force_at_the_same_instants(form: Form) -> None:
    ahead = 0.13e-3
    coarse = force(form, sampled(BACK_AND_FORTH, DT, ahead)[1], DT)
    fine = force(form, sampled(BACK_AND_FORTH, DT / 2, ahead)[1], DT / 2)
    assert fine[::2] == pytest.approx(coarse, abs=1e-6)


def test_errors_at_reversals_have_the_machinists_sign() -> None:
    """An axis that sticks where it turns lags: negative, whichever way it turned."""
    t, motion = sampled(BACK_AND_FORTH)
    measured = np.array(motion.position)
    for turn, way in ((0.6, -1.0), (1.2, 1.0), (1.8, -1.0)):
        stuck = (t > turn) & (t < turn + 10e-3)
        measured[stuck] = motion.position[round(turn / DT)]
        measured[np.argmin(np.abs(t - turn - 0.05))] += 1e-6 * way  # ahead of the reference, once
    errors = reversal_errors(motion.position, motion.velocity, measured, DT)
    assert [(round(error.time, 9), error.way) for error in errors] == [(0.6, -1.0), (1.2, 1.0), (1.8, -1.0)]
    for error in errors:
        assert error.negative == pytest.approx(-0.5 * 0.1 * 9.5e-3**2, rel=1e-3)
        assert error.positive == pytest.approx(1e-6, rel=1e-9)
