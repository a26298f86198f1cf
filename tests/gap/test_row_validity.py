"""Rows that must not count, from columns alone; and stretches and bridges of them."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.gap.logs.row_validity import filled, row_validity
from stagectl.gap.logs.session import Array
from stagectl.recording.true_rows import stretches

DT, ROWS = 1e-3, 1000


def columns(**changed: Array) -> dict[str, Array]:
    """A sine that is followed and driven without fault."""
    t = DT * np.arange(ROWS, dtype=np.float64)
    sine = np.sin(10.0 * t)
    return {"position": sine, "reference": sine, "command": np.cos(10.0 * t), "current": np.cos(10.0 * t), **changed}


def test_a_sound_log_counts_as_a_whole() -> None:
    assert row_validity(columns(), DT, 5.0, 1e-6) == (pytest.approx(np.ones(ROWS)), [])


def test_a_fault_ends_the_log() -> None:
    fault = np.zeros(ROWS)
    fault[600] = 3.0
    valid, _ = row_validity(columns(fault=fault), DT, 5.0, 1e-6)
    assert valid[:600].all() and not valid[600:].any()


def test_a_long_gap_of_the_reference_costs_the_rows_until_the_loop_has_settled() -> None:
    reference = columns()["reference"].copy()
    reference[100:110] = np.nan  # 10 ms: a spline bridges it
    reference[300:330] = np.nan
    valid, _ = row_validity(columns(reference=reference), DT, 5.0, 1e-6)
    assert stretches(~valid) == [(300, 530)]


def test_a_command_that_no_drive_follows_ends_the_log() -> None:
    command = columns()["command"].copy()
    command[700] = 6.0
    valid, _ = row_validity(columns(command=command), DT, 10.0, 1e-6)
    assert valid[:700].all() and not valid[700:].any()


def test_a_plateau_below_the_known_limit_is_noted_and_counts() -> None:
    current = np.clip(columns()["current"], -0.5, 0.5)
    valid, notes = row_validity(columns(current=current), DT, 5.0, 1e-6)
    assert valid.all() and len(notes) == 1 and "0.5 A" in notes[0]
    assert not row_validity(columns(current=current), DT, 0.5, 1e-6)[1][1:]


def test_stretches_and_bridged_gaps() -> None:
    assert stretches(np.array([True, False, True, True])) == [(0, 1), (2, 4)]
    assert stretches(np.zeros(3, dtype=bool)) == []
    assert filled(np.array([np.nan, 1.0, np.nan, 3.0])) == pytest.approx([1.0, 1.0, 2.0, 3.0])
    assert filled(np.full(2, np.nan)) == pytest.approx([0.0, 0.0])
