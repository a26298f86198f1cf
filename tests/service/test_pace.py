"""What a move may be asked for, and a stage file that changes under a service."""

from __future__ import annotations

from pathlib import Path

import pytest

from stagectl.config.stage_file import Setup
from stagectl.problem import ProblemKind
from stagectl.service.file_in_use import FileInUse
from stagectl.service.planning import ServiceError, check_pace, check_time
from stagectl.trajectories import SCurve
from tests.problems import refused


@pytest.mark.parametrize(
    ("speed", "acceleration", "key"),
    [(0.0, None, "speed"), (-5e-3, None, "speed"), (0.31, None, "speed"), (0.1, 100.0, "acceleration")],
)
def test_the_word_that_no_move_may_have_is_named(
    ball_screw: Setup, speed: float, acceleration: float | None, key: str
) -> None:
    check_pace("axis", ball_screw, 0.3, 5.0)
    with refused(ServiceError, kind=ProblemKind.RANGE, key=key):
        check_pace("axis", ball_screw, speed, acceleration)


def test_a_move_that_a_slip_of_a_unit_makes_endless_is_refused(ball_screw: Setup) -> None:
    endless, creeping = SCurve(6e-3, 1e-9, 1.0, 50.0), SCurve(6e-3, 5e-3, 1e-6, 50e-6)
    with refused(ServiceError, kind=ProblemKind.LIMIT, key="speed"):
        check_time("axis", ball_screw, endless, (True, False))
    with refused(ServiceError):
        check_time("axis", ball_screw, creeping, (True, True))
    check_time("axis", ball_screw, SCurve(1e-6, 0.1, 1.0, 50.0), (True, False))  # too short for its speed


def test_a_stage_file_that_is_changed_or_removed_is_told(tmp_path: Path) -> None:
    path = tmp_path / "live.yaml"
    path.write_text("name: a")
    file = FileInUse(path)
    assert file.changed() == []
    for change in (lambda: path.write_text("name: other"), path.unlink):
        change()
        assert len(file.changed()) == 1
    path.write_text("name: a")
    assert file.changed() == []
