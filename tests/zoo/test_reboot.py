"""A drive that boots by itself after the N-th SDO of the set-up: it ends fully set up, or nothing is enabled."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.zoo.bench import Result, last_words, run, unsafe
from tests.zoo.diary import Diary
from tests.zoo.objects import objects
from tests.zoo.sample import sample
from tests.zoo.stage import NODE
from tests.zoo.table import EVERY
from tests.zoo.variants import VARIANTS

LAST = 110  # SDO requests; the set-up of a plain drive has fewer
POINTS = range(1, LAST + 1)
PLAIN = EVERY["plain"]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A run without a boot."""
    return run(tmp_path_factory.mktemp("plain"), PLAIN)


def effective(diary: Diary) -> dict[int, int]:
    """What the drive holds at the end beside its values after a boot."""
    delivered = {row.key: row.value for row in objects(VARIANTS["plain"], NODE)}
    held = {key: int.from_bytes(bytes.fromhex(data), "little") for key, data in diary.held().items()}
    orders = {0x604000, 0x607100}  # they are no settings
    return {key: value for key, value in held.items() if value != delivered[key] and key not in orders}


def requests(diary: Diary) -> int:
    """SDO requests until the drive was made operational."""
    return int(next(line["requests"] for line in diary.lines("nmt") if line["state"] == 5))


def test_the_list_is_complete(undisturbed: Result) -> None:
    assert undisturbed.outcome == "moves"
    assert 10 < requests(undisturbed.diary) <= LAST


@pytest.mark.parametrize("count", sample(POINTS, POINTS[::40]))
def test_it_is_fully_set_up_or_not_enabled(count: int, undisturbed: Result, tmp_path: Path) -> None:
    if count > requests(undisturbed.diary):
        pytest.skip("the set-up has fewer SDOs")
    result = run(tmp_path, PLAIN, "--reboot-after", str(count))
    assert unsafe(result.diary) == []
    if result.outcome != "refuses":
        assert effective(result.diary) == effective(undisturbed.diary), last_words(result.words)
