"""Shares of the closed gap, and its closure above the floor of repeats."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stagectl.gap.validation import held_out_gap


def test_shapley_shares_the_whole() -> None:
    worth = {"": 10.0, "a": 4.0, "b": 7.0, "ab": 2.0}
    found = held_out_gap.shapley(["a", "b"], lambda members: worth["".join(sorted(members))])
    assert found["a"] + found["b"] == pytest.approx(8.0)
    assert found == pytest.approx({"a": 5.5, "b": 2.5})


def test_closure_counts_above_the_floor() -> None:
    ones = np.ones(20)
    one = [held_out_gap.Squares(value * ones, 10.0 * ones) for value in (101.0, 2.0, 1.0)]
    gap = held_out_gap.gap(one[0], one[1], one[2], "rad")
    assert gap.closure == pytest.approx(0.99) and gap.low == pytest.approx(0.99) and gap.high == pytest.approx(0.99)
    assert gap.before == pytest.approx(math.sqrt(10.1))
