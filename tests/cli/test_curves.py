"""Dots where the curve is, and a range that is never empty."""

from __future__ import annotations

import math

import pytest

from stagectl.cli.scope import bounds_of, curve


def test_a_ramp_by_hand() -> None:
    """Four columns of dots, one line: a falling ramp from the upper left to the lower right."""
    values = [3.5, 2.5, 1.5, 0.5]
    (line,) = curve(values, values, (0.0, 4.0), (2, 1))
    left, right = (ord(mark) - 0x2800 for mark in line)
    assert left & 0x01
    assert left & 0x10
    assert right & 0x04
    assert right & 0x80
    assert not left & 0x80
    assert not right & 0x01


def test_a_peak_of_one_bucket_is_seen_wherever_it_falls() -> None:
    for place in range(1000):
        high = [0.0] * 1000
        high[place] = 1.0
        top, *_ = curve([0.0] * 1000, high, (-0.1, 1.0), (20, 4))
        assert sum(mark != "\u2800" for mark in top) == 1


def test_nothing_is_drawn_where_nothing_is_known() -> None:
    (line,) = curve([math.nan] * 8, [math.nan] * 8, (0.0, 1.0), (4, 1))
    assert line == "\u2800" * 4


@pytest.mark.parametrize("values", [[0.0], [5.0, 5.0], [math.nan], [1e-9, 2e-9]])
def test_bounds_are_never_the_same(values: list[float]) -> None:
    low, high = bounds_of(values, values)
    assert low < high
    assert all(low < value < high for value in values if not math.isnan(value))
