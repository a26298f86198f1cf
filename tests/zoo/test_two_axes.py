"""Two foreign drives on one bus: to set one up holds the other one up, and that is no fault of either."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.zoo.bench import SECOND_NODE, drive, until
from tests.zoo.diary import Diary
from tests.zoo.service import ServedZoo
from tests.zoo.table import EVERY

PLAIN = EVERY["plain"]
BOOT_TIME = 4.0  # s, that the second drive may take
_AXES = f"axes:\n  x: {{}}\n  y: {{drive.wire.node: {SECOND_NODE}, drive.wire.boot_time: {BOOT_TIME:g} s}}\n"


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[ServedZoo, Diary, ExitStack]]:
    """A service of two axes, of which x has its drive; what enters the stack ends with the test."""
    machine = ServedZoo(tmp_path, PLAIN)
    stage = machine.files.stage
    stage.write_text(stage.read_text().replace("axis:\n", f"{_AXES}axis:\n", 1))
    with ExitStack() as ends, drive(PLAIN.variant, machine.files) as diary:
        yield machine, diary, ends
        machine.end()


def _second(machine: ServedZoo, ends: ExitStack) -> None:
    """The drive of y: it boots for 3 s, and answers nothing meanwhile."""
    files = machine.files._replace(diary=machine.folder / "second.jsonl")
    ends.enter_context(drive("slow-boot", files, "--node", str(SECOND_NODE)))


def _states(machine: ServedZoo) -> list[str]:
    return [axis["state"] for axis in machine.ask("GET", "status")["axes"]]


def test_a_slow_drive_at_the_start(pair: tuple[ServedZoo, Diary, ExitStack]) -> None:
    machine, _, ends = pair
    _second(machine, ends)
    machine.start()
    assert machine.tries("enable"), machine.words
    assert _states(machine) == ["standing", "standing"]


def test_a_slow_drive_that_comes_later(pair: tuple[ServedZoo, Diary, ExitStack]) -> None:
    """The drive of x misses its controller while that of y boots, and says so."""
    machine, diary, ends = pair
    machine.start()
    assert _states(machine) == ["disabled", "offline"], machine.words
    until(lambda: machine.axis("x")["cycles"] > 300, "the axis was without power for more than a second")
    _second(machine, ends)
    assert machine.tries("enable"), machine.words
    assert [line["code"] for line in diary.lines("emergency")], "it has not missed its controller"
    assert _states(machine) == ["standing", "standing"]
    assert machine.tries("disable")
    assert _states(machine) == ["disabled", "disabled"]
