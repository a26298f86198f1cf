"""Amplitudes and phases of waves, from parts whose errors go together."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stagectl.gap.inference import amplitudes
from stagectl.gap.logs.session import Array
from stagectl.gap.result.diagnosis import Value

PAIR = ("sine", "cosine")


def wave(part: tuple[float, float], *errors: Array) -> dict[str, Value]:
    """Amplitude and phase of a sine and a cosine of order 2."""
    values = {name: Value(x, x, x, "N m") for name, x in zip(PAIR, part, strict=True)}
    return amplitudes.with_amplitudes({"order": Value(2.0, 2.0, 2.0, ""), **values}, {PAIR: errors})


def test_sine_and_cosine_become_amplitude_and_phase() -> None:
    found = wave((3.0, 4.0), 0.01 * np.eye(2), 0.04 * np.eye(2))
    assert list(found) == ["amplitude", "phase", "order"] and found["amplitude"].unit == "N m"
    assert found["amplitude"][:3] == pytest.approx((5.0, 5.0 - 1.96 * 0.2, 5.0 + 1.96 * 0.2), rel=1e-3)
    turn = math.asin(1.96 * 0.2 / 5.0)
    phase = math.atan2(4.0, 3.0)
    assert found["phase"][:3] == pytest.approx((phase, phase - turn, phase + turn), abs=1e-3)


def test_without_errors_an_amplitude_is_what_it_is() -> None:
    for errors in ((), (np.zeros((2, 2)),)):
        assert wave((3.0, 4.0), *errors)["amplitude"][:3] == pytest.approx((5.0, 5.0, 5.0), rel=1e-5)


def test_an_amplitude_that_may_be_none_has_any_phase() -> None:
    found = wave((0.1, 0.1), 20.0 * np.eye(2))
    assert found["amplitude"].low == 0.0 and found["phase"].high - found["phase"].low == pytest.approx(math.tau)


def test_a_wave_is_there_where_its_parts_may_not_both_be_none() -> None:
    """Each of them may; what they are together is known twenty times better than either."""
    along, across = np.array([1.0, -1.0]) / math.sqrt(2.0), np.array([1.0, 1.0]) / math.sqrt(2.0)
    error = 4.0 * np.outer(along, along) + 0.01 * np.outer(across, across)
    found = wave((1.0, 1.0), error)
    assert all(x < 1.96 * error[k, k] ** 0.5 for k, x in enumerate((1.0, 1.0)))
    assert found["amplitude"].low == pytest.approx(math.sqrt(2.0) - 1.96 * 0.1, rel=1e-2)
    assert found["phase"].high - found["phase"].value < 0.5 * math.pi


def test_the_shortest_and_the_longest_are_those_of_the_ellipsoid() -> None:
    source = np.random.default_rng(2)
    point, root = 3.0 * source.standard_normal(4), 0.4 * source.standard_normal((4, 4))
    around = source.standard_normal((200_000, 4))
    points = point + 1.959964 * (around / np.linalg.norm(around, axis=1)[:, None]) @ root.T
    sizes = np.linalg.norm(points, axis=1)
    shortest, longest = amplitudes.lengths(point, root @ root.T)
    assert shortest == pytest.approx(sizes.min(), rel=0.02) and longest == pytest.approx(sizes.max(), rel=0.02)
    assert shortest <= sizes.min() and longest >= sizes.max()
    small = amplitudes.lengths(1e-9 * point, 1e-18 * root @ root.T)
    assert small == pytest.approx((1e-9 * shortest, 1e-9 * longest), rel=1e-6, abs=0.0)


def test_a_map_has_the_amplitude_of_all_its_waves() -> None:
    """None of three is sure by itself, all of them are."""
    names = [f"{part}_{k}" for k in (1, 2, 3) for part in PAIR]
    values = {"order": Value(7.0, 7.0, 7.0, ""), **{name: Value(0.9, 0.0, 1.8, "N m") for name in names}}
    errors = {group: [np.eye(len(group)) * 0.5] for group in amplitudes.groups(values)}
    found = amplitudes.with_amplitudes(values, errors)
    assert list(found) == ["order", "amplitude", *(f"{part}_{k}" for k in (1, 2, 3) for part in ("amplitude", "phase"))]
    assert found["amplitude"].value == pytest.approx(0.9 * math.sqrt(6.0)) and found["amplitude"].low > 0.0
    assert found["amplitude_1"].low == 0.0
