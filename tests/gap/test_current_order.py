"""A measured current that comes before its command is said, whether columns are swapped or a log is late."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.api.diagnosis import GapDiagnosis
from stagectl.cli.gap_diagnose import show
from stagectl.gap.logs import load_session
from stagectl.gap.logs.current_order import drive_doubts, order_doubts, periods_ahead
from stagectl.report.gap.page import page
from tests.conftest import CONFIG
from tests.gap.captured import Columns
from tests.gap.examples import found

DT = 5e-4  # s


@pytest.fixture(scope="module")
def columns() -> Columns:
    """Command and measured current of the ball screw with noise."""
    stage = sc.load_stage(CONFIG / "ball-screw.yaml")
    machine = stage.changed({"simulation.current_noise": 45e-3})
    ran = sc.simulate(stage, CONFIG / "trajectories" / "sine-1.6hz.yaml", plant=machine)
    return {"command": ran["command"], "current": ran["measured_current"]}


def test_a_drive_follows_its_command(columns: Columns) -> None:
    assert order_doubts(columns["command"], columns["current"], DT) == []


def test_swapped_columns_are_said(columns: Columns) -> None:
    command, current = columns["current"], columns["command"]
    (doubt,) = order_doubts(command, current, DT)
    assert "swapped" in doubt and periods_ahead(command, current) in (1, 2)


@pytest.mark.parametrize("late", [2, 4])
def test_a_command_that_was_logged_late_is_said(columns: Columns, late: int) -> None:
    ahead = periods_ahead(np.roll(columns["command"], late), columns["current"])
    assert ahead in (late - 1, late - 2)  # the drive itself takes a period, and its lag


@pytest.mark.parametrize("rows", [4, 10])
def test_a_current_that_a_slow_log_shows_at_a_limit_is_said(columns: Columns, rows: int) -> None:
    """Between two rows there are commands that nobody knows; a limit lasts longer."""
    command, current = (np.repeat(columns[name], 4)[::rows] for name in ("command", "current"))
    assert drive_doubts(command, current, DT) == []
    limit = 0.6 * float(np.abs(command).max())
    (doubt,) = drive_doubts(command, np.clip(current, -limit, limit), DT)
    assert "steady command" in doubt


def test_noise_alone_has_no_order() -> None:
    random = np.random.default_rng(1)
    assert periods_ahead(random.standard_normal(4000), random.standard_normal(4000)) == 0
    assert periods_ahead(np.zeros(3), np.zeros(3)) == 0


def test_a_constant_current_has_none() -> None:
    assert periods_ahead(np.ones(400), np.ones(400)) == 0 and periods_ahead(np.ones(1), np.ones(1)) == 0


def test_a_doubt_comes_before_the_answer(columns: Columns, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is on the logs of a session, and first on the terminal and on the page."""
    position = 1e-2 * np.sin(np.arange(len(columns["command"])) * DT)
    rows = np.column_stack([DT * np.arange(len(position)), position, columns["current"], columns["command"]])
    head = "time_s,position_rad,current_command_A,current_A"
    np.savetxt(tmp_path / "swapped.csv", rows, delimiter=",", header=head, comments="")
    setup = sc.load_stage(CONFIG / "ball-screw.yaml").setup
    session = load_session.load([tmp_path / "swapped.csv"], setup)
    assert len(session.doubts) == 1 and not set(session.doubts) & set(session.notes)
    result = found("effects")._replace(doubts=session.doubts)
    show(GapDiagnosis(tmp_path, result, session, setup.stage), Path("captures"))
    shown = capsys.readouterr().err.splitlines()
    assert session.doubts[0][:40] in shown[0] and "stagectl gap apply captures STAGE.yaml" in shown[-1]
    assert session.doubts[0] in page(result, "logs", []).notes[0]
