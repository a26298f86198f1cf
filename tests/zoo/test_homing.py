"""Homing by foreign drives, ordered of a service: found, failed, endless, refused, and with answers a period old."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.zoo import table
from tests.zoo.bench import settle, until
from tests.zoo.diary import Diary
from tests.zoo.homing import SWITCH
from tests.zoo.service import ServedZoo, served

HOME = 3e-3  # m, homing.position


@pytest.fixture
def homing(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[ServedZoo, Diary]]:
    """A service that has enabled the drive of this kind."""
    row = table.Row(f"homing-{request.param}", table.MOVES)
    with served(tmp_path, row) as (machine, diary):
        yield machine, diary
        machine.tries("disable")
        settle(diary)


def enable(machine: ServedZoo) -> bool:
    """Power; False where it is refused."""
    return machine.tries("enable") and str(machine.axis()["state"]) == "standing"


@pytest.mark.parametrize("homing", ["switch", "switch-late"], indirect=True)
def test_the_home_is_the_switch_and_the_axis_goes_on_from_there(homing: tuple[ServedZoo, Diary]) -> None:
    machine, diary = homing
    assert enable(machine), machine.words
    assert machine.tries("home"), machine.words
    axis = machine.axis()
    assert axis["homed"]
    assert axis["position"] == pytest.approx(diary.last["x"] - SWITCH + HOME, abs=2e-4)
    assert machine.tries("move", by={"axis": "2 mm"}, speed="10 mm/s"), machine.words
    assert machine.heard()["position"] == pytest.approx(diary.last["x"] - SWITCH + HOME, abs=2e-4)


@pytest.mark.parametrize("homing", ["here", "here-late"], indirect=True)
def test_a_home_where_it_stands_is_attained_at_once(homing: tuple[ServedZoo, Diary]) -> None:
    machine, _ = homing
    assert enable(machine), machine.words
    assert machine.tries("home"), machine.words
    assert machine.heard()["position"] == pytest.approx(HOME, abs=2e-5)


@pytest.mark.parametrize(
    ("homing", "word"), [("error", "bit 13"), ("never", "homing.distance"), ("stubborn", "0x6060")], indirect=["homing"]
)
def test_a_homing_that_fails_leaves_no_power_and_says_why(homing: tuple[ServedZoo, Diary], word: str) -> None:
    machine, diary = homing
    assert enable(machine), machine.words
    assert not machine.tries("home")
    until(lambda: machine.axis()["state"] == "fault", machine.axis)
    assert word in machine.words
    assert not machine.axis()["homed"]
    assert diary.stands()


@pytest.mark.parametrize("homing", ["absent"], indirect=True)
def test_a_drive_without_the_mode_is_refused(homing: tuple[ServedZoo, Diary]) -> None:
    machine, diary = homing
    assert not enable(machine)
    assert "homing" in machine.words
    assert diary.moved() == 0.0
