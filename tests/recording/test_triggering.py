"""A scope on a ring that fills up bit by bit: where it triggers, what it takes, and when it goes on."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stagectl.recording.ring import Ring
from stagectl.recording.triggering import Capture, Scope, Settings, Trigger, crossings

SINE = [math.sin(2.0 * math.pi * k / 100.0) for k in range(2000)]


def scoped(settings: Settings, values: list[float], piece: int = 7) -> tuple[Scope, list[Capture]]:
    """All captures of a scope that looks after each `piece` of rows (number, value)."""
    ring = Ring.create(2, 4096)
    scope, captures = Scope(settings, 0), []
    for k, value in enumerate(values):
        ring.write((float(k), value))
        if k % piece == piece - 1 and (capture := scope.look(ring)) is not None:
            captures.append(capture)
    return scope, captures


@pytest.mark.parametrize("piece", [1, 7, 60])
def test_it_triggers_where_the_level_is_crossed(piece: int) -> None:
    """sin crosses 0.5 upwards at 8.33 of 100 rows: the ninth row is the first above it."""
    _, captures = scoped(Settings(50, 20, Trigger(1, 0.5), "normal"), SINE, piece)
    assert len(captures) >= 18 if piece < 60 else len(captures) >= 9
    for capture in captures:
        number = capture.first + capture.at
        assert number % 100 == 9
        assert SINE[number - 1] < 0.5 <= SINE[number]
        whole = capture.first > 0
        assert len(capture.rows) == 50 or not whole
        assert capture.at == 20 or not whole
        assert np.array_equal(capture.rows[:, 0], np.arange(capture.first, capture.first + len(capture.rows)))
        assert capture.triggered


@pytest.mark.parametrize(("edge", "rows"), [("rising", {9}), ("falling", {42}), ("both", {9, 42})])
def test_edges(edge: Any, rows: set[int]) -> None:
    """Downwards it crosses 0.5 at 41.67."""
    assert {int(row) % 100 for row in crossings(np.array(SINE), 0.5, edge)} == rows


def test_nothing_is_no_crossing() -> None:
    assert len(crossings(np.array([0.0, np.nan, 1.0]), 0.5, "both")) == 0


def test_single_takes_one_and_no_more() -> None:
    scope, captures = scoped(Settings(50, 0, Trigger(1, 0.5), "single"), SINE)
    assert len(captures) == 1
    assert scope.done


def test_normal_waits_and_auto_does_not() -> None:
    never = Trigger(1, 2.0)
    assert scoped(Settings(50, 10, never, "normal"), SINE)[1] == []
    _, captures = scoped(Settings(50, 10, never, "auto", patience=100), SINE)
    assert 5 <= len(captures) <= 2000 // 150
    assert not any(capture.triggered for capture in captures)


def test_a_peak_between_two_looks_is_not_missed() -> None:
    values = [0.0] * 1000
    values[444] = 1.0
    _, captures = scoped(Settings(100, 50, Trigger(1, 0.9), "normal"), values, piece=250)
    assert [capture.first + capture.at for capture in captures] == [444]


def test_rows_that_were_overwritten_give_no_capture() -> None:
    ring = Ring.create(2, 64)
    scope = Scope(Settings(40, 10, Trigger(1, 0.5), "normal"), 0)
    for k in range(1000):
        ring.write((float(k), float(k == 100)))
    assert scope.look(ring) is None
