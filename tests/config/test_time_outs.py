"""Time-outs that follow from the free distance, and those that exceed it."""

from __future__ import annotations

import pytest

from stagectl.config.source import ConfigError
from stagectl.config.stage_file import Setup, load_stage
from stagectl.config.time_outs import axis_limits, free_distance
from stagectl.drives.drive import Canopen
from stagectl.drives.limits import ANSWER_PERIODS, SHORTEST_TIMEOUT
from stagectl.problem import ProblemKind
from tests.conftest import CONFIG, half_second

STAGES = ("ball-screw.yaml", "linear-slider.yaml", "emps.yaml")


def text_of(name: str, *lines: str) -> str:
    text = (CONFIG / name).read_text()
    return text.replace("limits:\n", "limits:\n" + "".join(f"  {line}\n" for line in lines))


@pytest.mark.parametrize("name", STAGES)
def test_absent_time_outs_keep_the_axis_within_the_free_distance(name: str) -> None:
    file = load_stage(CONFIG / name, text=text_of(name)).file
    wire = file.drive.wire
    assert isinstance(wire, Canopen)
    cost = axis_limits(file).braking.cost
    assert cost(wire.rpdo_timeout) <= free_distance(file) or wire.rpdo_timeout == SHORTEST_TIMEOUT
    assert cost(wire.rpdo_timeout + 1e-3) > free_distance(file)
    assert wire.feedback_timeout == pytest.approx(ANSWER_PERIODS * file.control.period)


def test_more_room_gives_more_time() -> None:
    name = STAGES[0]
    times = []
    for room in ("7 mm", "15 mm", "40 mm"):
        wire = load_stage(CONFIG / name, text=text_of(name, f"free_distance: {room}")).file.drive.wire
        assert isinstance(wire, Canopen)
        times.append(wire.rpdo_timeout)
    assert times == sorted(set(times)) and times[0] >= SHORTEST_TIMEOUT


def test_stated_time_outs_stay(slow_screw: Setup) -> None:
    wire = slow_screw.file.drive.wire
    assert isinstance(wire, Canopen)
    assert (wire.rpdo_timeout, wire.feedback_timeout) == (0.5, 0.5)


def test_a_time_out_beyond_a_stated_free_distance_is_refused() -> None:
    """500 ms at 15 A cost 816 mm; 10 mm are free."""
    text = half_second(text_of(STAGES[0], "free_distance: 10 mm"))
    with pytest.raises(ConfigError) as caught:
        load_stage(CONFIG / STAGES[0], text=text)
    (problem,) = caught.value.problems
    assert (problem.kind, problem.key) == (ProblemKind.CONFLICT, "limits.free_distance")
