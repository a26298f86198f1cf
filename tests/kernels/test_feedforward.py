"""Perfect tracking control is exact on the discrete plant, at every sample."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from stagectl.kernels import feedforward as ff
from stagectl.kernels.friction import bundle, relaxed
from stagectl.kernels.stage import Mechanics

DT, KT, PLANT = 5e-4, 0.72, Mechanics(0.01, 0.14)
UM = 1e6 * 0.012 / (2.0 * math.pi)  # um of table travel per rad


def sine(t: float) -> ff.Desired:
    w, a = 2.0 * math.pi * 1.6, 0.005 * 2.0 * math.pi / 0.012
    return ff.Desired(a * (1.0 - math.cos(w * t)), a * w * math.sin(w * t))


@pytest.mark.parametrize(
    ("viscous", "dt"),
    [(0.14, 5e-4), (0.0, 5e-4), (1e-9, 5e-4), (1e-5, 5e-4), (9.9, 5e-4), (10.1, 5e-4), (30.0, 1e-3), (0.14, 0.1)],
)  # D dt/J from 5e-11 to 3, and on both sides of 0.5, where the series ends
def test_held_plant_is_the_matrix_exponential(viscous: float, dt: float) -> None:
    whole = np.zeros((3, 3))
    whole[0, 1], whole[1, 1], whole[1, 2] = 1.0, -viscous / 0.01, KT / 0.01
    exact = expm(whole * dt)
    p = ff.held(Mechanics(0.01, viscous), KT, dt)
    assert [p.a12, p.a22, p.b1, p.b2] == pytest.approx([exact[0, 1], exact[1, 1], exact[0, 2], exact[1, 2]], rel=1e-12)


def test_commands_are_the_papers_matrix_equation() -> None:
    """[u1; u2] = B^-1 (xd[i+1] - A xd[i]) with A = Ad^2, B = [Ad Bd, Bd]: solved by numpy."""
    p = ff.held(PLANT, KT, DT)
    ad, bd = np.array([[1.0, p.a12], [0.0, p.a22]]), np.array([p.b1, p.b2])
    start, end = sine(0.1), sine(0.1 + 2 * DT)
    expected = np.linalg.solve(np.stack([ad @ bd, bd], axis=1), np.array(end) - ad @ ad @ np.array(start))
    assert ff.commands(p, start, end) == pytest.approx(expected.tolist(), rel=1e-7)


def discrete_run(p: ff.Held, periods: int) -> tuple[list[float], list[float]]:
    """Errors (um) of the discrete plant under the feedforward alone: against y0, and against the reference."""
    desired = np.array([sine(k * DT) for k in range(periods + 2)])
    none = bundle([0.0], [1.0])
    rows = np.zeros((periods, 8))
    seen = ff.Foreseen(desired[:-2, 0].copy(), desired, desired.copy(), desired[:-2, 0].copy())
    ff.setpoints(ff.Feedforward(p, none, KT, True, True), seen, relaxed(none), rows)
    x, positions = np.zeros(2), []
    for current in rows[:, 2]:
        positions.append(x[0])
        x = np.array([x[0] + p.a12 * x[1] + p.b1 * current, p.a22 * x[1] + p.b2 * current])
    return list((positions - rows[:, 1]) * UM), list((positions - rows[:, 0]) * UM)


def test_exact_at_the_frames_and_between() -> None:
    """<= 1e-9 um at Tr, <= 1e-4 um between (issue); the target y0 is met at every single sample."""
    target, reference = discrete_run(ff.held(PLANT, KT, DT), 2000)
    assert max(abs(e) for e in reference[::2]) <= 1e-9
    assert 1e-8 < max(abs(e) for e in reference[1::2]) <= 1e-4
    assert max(abs(e) for e in target) <= 1e-9


def test_swapped_columns_are_seen_by_exactness_only() -> None:
    """B = [Bd, Ad Bd] costs 0.10 um in tracking, so tracking cannot show PTC right (control-math.md)."""
    p = ff.held(PLANT, KT, DT)
    x, worst = np.array([0.0, 0.0]), 0.0
    for i in range(0, 2000, 2):
        u1, u2 = ff.commands(p, sine(i * DT), sine((i + 2) * DT))
        for u in (u2, u1):
            x = np.array([x[0] + p.a12 * x[1] + p.b1 * u, p.a22 * x[1] + p.b2 * u])
        worst = max(worst, abs(x[0] - sine((i + 2) * DT).position) * UM)
    assert worst > 1e-4


@given(st.floats(-1.0, 1.0), st.floats(-20.0, 20.0), st.floats(-1e-3, 1e-3), st.floats(-1.0, 1.0))
def test_any_two_states_are_joined(position: float, velocity: float, dx: float, dv: float) -> None:
    p = ff.held(PLANT, KT, DT)
    start, end = ff.Desired(position, velocity), ff.Desired(position + dx, velocity + dv)
    x = np.array(start)
    for u in ff.commands(p, start, end):
        x = np.array([x[0] + p.a12 * x[1] + p.b1 * u, p.a22 * x[1] + p.b2 * u])
    assert x == pytest.approx(np.array(end), abs=1e-12 * (1.0 + abs(position) + abs(velocity)))


def test_standing_still_asks_for_nothing() -> None:
    rows, here = np.zeros((4, 8)), np.array([[0.7, 0.0]] * 6)
    operators = bundle([0.5], [1e-3])
    seen = ff.Foreseen(here[:-2, 0].copy(), here, here, here[:-2, 0].copy())
    ff.setpoints(ff.Feedforward(ff.held(PLANT, KT, DT), operators, KT, True, True), seen, relaxed(operators), rows)
    assert rows.tolist() == [[0.7, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] * 4


def test_each_layer_switches_off_alone() -> None:
    desired = np.array([sine(k * DT) for k in range(102)])
    operators = bundle([0.5], [1e-3])
    seen = ff.Foreseen(desired[:-2, 0].copy(), desired, desired, desired[:-2, 0].copy())
    rows_by_layer = {}
    for ptc in (True, False):
        for friction in (True, False):
            rows = np.zeros((100, 8))
            p = ff.Feedforward(ff.held(PLANT, KT, DT), operators, KT, ptc, friction)
            ff.setpoints(p, seen, relaxed(operators), rows)
            rows_by_layer[ptc, friction] = rows
    assert np.array_equal(rows_by_layer[True, False][:, :3], rows_by_layer[True, True][:, :3])
    assert np.array_equal(rows_by_layer[False, True][:, 3], rows_by_layer[True, True][:, 3])
    assert not rows_by_layer[False, False][:, 2:4].any()
    assert np.array_equal(rows_by_layer[False, False][:, 1], desired[:-2, 0])
