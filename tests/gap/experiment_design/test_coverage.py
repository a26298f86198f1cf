"""What counts as shown: held speeds, dwells, strokes and scans of constructed motions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.gap.experiment_design import coverage
from stagectl.gap.experiment_design.coverage import ReferenceMotion

DT = 1e-3


def motion(velocity: NDArray[np.float64]) -> ReferenceMotion:
    return ReferenceMotion(DT * np.cumsum(velocity), velocity, False, DT)


@pytest.mark.parametrize(
    ("values", "count"), [([], 0), ([1.0], 1), ([1.0, 1.2, 1.3], 2), ([3.0, 1.0, 2.0], 3), ([2.0, 2.0, 2.0], 1)]
)
def test_values_are_distinct_by_their_ratio(values: list[float], count: int) -> None:
    assert coverage.distinct(values, 1.25) == count


def test_a_speed_is_held_both_ways_and_a_ramp_holds_none() -> None:
    held = coverage.held_speeds(motion(np.repeat([0.5, 0.0, -0.2], 400)), 0.01)
    assert {round(speed, 3) for speed in held} == {0.5, -0.2}
    assert coverage.held_speeds(motion(np.linspace(0.0, 1.0, 1000)), 0.01) == []


def test_the_shortest_stroke_lies_between_two_reversals() -> None:
    """10 mm up, 2 mm down, 5 mm up, down again: the first and the last have no reversal on one side."""
    strokes = motion(np.concatenate([np.full(100, 0.1), np.full(20, -0.1), np.full(50, 0.1), np.full(9, -0.1)]))
    assert coverage.shortest_stroke(strokes) == pytest.approx(2e-3, rel=0.06)
    once = motion(np.concatenate([np.full(100, 0.1), np.full(20, -0.1)]))
    assert coverage.shortest_stroke(once) == 0.0


@pytest.mark.parametrize(("speed", "travel", "scans"), [(0.1, 0.1, True), (0.1, 0.2, False), (0.5, 0.1, False)])
def test_a_scan_is_slow_and_covers_the_travel(speed: float, travel: float, scans: bool) -> None:
    way = motion(np.full(round(0.1 / speed / DT), speed))
    assert coverage._scans(way, 0.25, travel) is scans


def test_each_check_leads_to_an_experiment_of_the_battery(ball_screw: object) -> None:
    from stagectl.config.stage_file import Setup
    from stagectl.gap.experiment_design.battery import battery

    assert isinstance(ball_screw, Setup)
    assert {experiment for _, experiment in coverage.CHECKS} <= {experiment.name for experiment in battery(ball_screw)}
