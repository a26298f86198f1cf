"""Stop operators and Stribeck against their closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stagectl.kernels.friction import Stribeck, bundle, relaxed, stops, stribeck

WEIGHT, SLIP = [0.5, 0.3, 0.2], [1e-6, 4e-6, 9e-6]
P = bundle(WEIGHT, SLIP)


def walk(moves: list[float]) -> list[float]:
    s = relaxed(P)
    return [stops(P, s, dx) for dx in moves]


def virgin(x: float) -> float:
    """From rest each element is a spring up to its slip: F = sum min(alpha x / delta, alpha)."""
    return sum(min(a * x / d, a) for a, d in zip(WEIGHT, SLIP, strict=True))


def test_from_rest_the_force_is_the_sum_of_springs_that_slip() -> None:
    steps = [1e-7] * 120
    assert walk(steps) == pytest.approx([virgin(1e-7 * k) for k in range(1, 121)], rel=1e-12)


def test_a_full_reversal_is_the_virgin_curve_twice_as_large() -> None:
    """Masing's rule: F(s) = -Tc + 2 f(s/2); the reversal table of control-math.md."""
    forces = walk([-20e-6] + [1e-7] * 200)[1:]
    assert forces == pytest.approx([-1.0 + 2.0 * virgin(0.5e-7 * k) for k in range(1, 201)], abs=1e-12)


def test_a_small_loop_closes_and_leaves_no_trace() -> None:
    """Return-point memory: after a partial reversal and back the outer curve goes on as if nothing had been."""
    straight = walk([5e-6, 2e-6])
    looped = walk([5e-6, -1e-6, 1e-6, 2e-6])
    assert looped[2] == pytest.approx(straight[0], rel=1e-12)
    assert looped[3] == pytest.approx(straight[1], rel=1e-12)


@given(st.lists(st.floats(-2e-5, 2e-5), min_size=1, max_size=60))
def test_odd_and_bounded(moves: list[float]) -> None:
    forward, backward = walk(moves), walk([-dx for dx in moves])
    assert forward == [-f for f in backward]
    assert max(abs(f) for f in forward) <= sum(WEIGHT) * (1.0 + 1e-12)


@given(st.lists(st.floats(-2e-5, 2e-5), min_size=1, max_size=40))
def test_a_closed_path_never_gives_energy(moves: list[float]) -> None:
    """Out along `moves` in fine steps and straight back: the work done against friction is not negative."""
    path = [dx / 50 for dx in [*moves, -sum(moves)] for _ in range(50)]
    s, work, last = relaxed(P), 0.0, 0.0
    for dx in path:
        force = stops(P, s, dx)
        work, last = work + 0.5 * (force + last) * dx, force
    stored = sum(0.5 * a * d * x * x for a, d, x in zip(WEIGHT, SLIP, s, strict=True))
    # A trapezoid across the corner where an element starts to slip errs by at most a d/2 (step/d)^2 each.
    corners = sum(a * max(map(abs, path)) ** 2 / d for a, d in zip(WEIGHT, SLIP, strict=True)) * len(moves)
    assert work >= stored - corners - 1e-18


def test_standing_still_changes_nothing() -> None:
    s = relaxed(P)
    before = stops(P, s, 3e-6), s.copy()
    assert stops(P, s, 0.0) == before[0]
    assert np.array_equal(s, before[1])


def test_stribeck_is_exactly_one_when_neutral_and_the_papers_form_when_not() -> None:
    assert stribeck(Stribeck(), 0.3) == 1.0
    p = Stribeck(rise=0.5, velocity=0.2, shape=1.0)
    for v in (0.0, 0.1, -0.1, 2.0):
        assert stribeck(p, v) == pytest.approx(1.0 + 0.5 * math.exp(-abs(v) / 0.2), rel=1e-15)


def test_the_shape_is_the_exponents_exponent() -> None:
    """Gaussian at 2, even in v, and (T_s - T_c)/T_c at standstill."""
    for shape in (0.5, 2.0):
        p = Stribeck(rise=0.5, velocity=0.2, shape=shape)
        for v in (0.0, 0.1, -0.1, 0.3):
            expected = 1.0 + 0.5 * math.exp(-((abs(v) / 0.2) ** shape))
            assert stribeck(p, v) == stribeck(p, -v) == pytest.approx(expected, rel=1e-15)
