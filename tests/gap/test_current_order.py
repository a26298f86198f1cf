"""A measured current that comes before its command is said, whether columns are swapped or a log is late."""

from __future__ import annotations

import numpy as np
import pytest

import stagectl as sc
from stagectl.gap.logs.current_order import order_notes, periods_ahead
from tests.conftest import CONFIG
from tests.gap.captured import Columns

DT = 5e-4  # s


@pytest.fixture(scope="module")
def columns() -> Columns:
    """Command and measured current of the ball screw with noise."""
    stage = sc.load_stage(CONFIG / "ball-screw.yaml")
    machine = stage.changed({"simulation.current_noise": 45e-3})
    ran = sc.simulate(stage, CONFIG / "trajectories" / "sine-1.6hz.yaml", plant=machine)
    return {"command": ran["command"], "current": ran["measured_current"]}


def test_a_drive_follows_its_command(columns: Columns) -> None:
    assert order_notes(columns, DT) == [] and order_notes({"command": columns["command"]}, DT) == []


def test_swapped_columns_are_said(columns: Columns) -> None:
    swapped = {"command": columns["current"], "current": columns["command"]}
    (note,) = order_notes(swapped, DT)
    assert "swapped" in note and periods_ahead(swapped["command"], swapped["current"]) in (1, 2)


@pytest.mark.parametrize("late", [2, 4])
def test_a_command_that_was_logged_late_is_said(columns: Columns, late: int) -> None:
    ahead = periods_ahead(np.roll(columns["command"], late), columns["current"])
    assert ahead in (late - 1, late - 2)  # the drive itself takes a period, and its lag


def test_noise_alone_has_no_order() -> None:
    random = np.random.default_rng(1)
    assert periods_ahead(random.standard_normal(4000), random.standard_normal(4000)) == 0
    assert periods_ahead(np.zeros(3), np.zeros(3)) == 0


def test_a_constant_current_has_none() -> None:
    assert periods_ahead(np.ones(400), np.ones(400)) == 0 and periods_ahead(np.ones(1), np.ones(1)) == 0
