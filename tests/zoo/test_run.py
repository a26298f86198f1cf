"""`stagectl run` against each foreign drive: it ends as the table says, and for the reason that is true."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.zoo import test_killed, test_serve
from tests.zoo.bench import last_words, objections, run
from tests.zoo.sample import sample
from tests.zoo.table import EVERY, ROWS

SLOW = ("slow-sdo", "drops-sdo", "slow-sdo-under-load", "mute-aborts", "other-node")  # 8 to 40 s
# The same check as in another row, of another value.
REPEATING = (
    *("fault-reset-hold", "fault-stays", "other-product", "clamp-blocks", "emergency-fault", "switched-on-in-motion"),
    *("gear-fixed", "torque-limit-one-side-fixed", "quick-stop-coasts", "reboot-in-setup-after-reset"),
)
SOME_LACKS = ("without:603F00", "without:605A00", "without:60C201")
# With a service, or killed in mid-motion, they are to end alike.
ELSEWHERE = [title for title in (*test_killed.FEW, *test_serve.FEW) if title != "plain" and not EVERY[title].served]
LEFT_OUT = {*SLOW, *REPEATING, *ELSEWHERE}
FEW = [title for title in (*(row.title for row in ROWS), *SOME_LACKS) if title not in LEFT_OUT]


@pytest.mark.parametrize("title", sample(EVERY, FEW))
def test_it_ends_as_the_table_says(title: str, tmp_path: Path) -> None:
    row = EVERY[title]
    result = run(tmp_path, row)
    assert objections(result, row) == [], last_words(result.words)


def test_power_that_is_found_is_taken_before_the_set_up(tmp_path: Path) -> None:
    """A drive that changes its mode under power would act on the torque that somebody left in it."""
    diary = run(tmp_path, EVERY["starts-enabled"]).diary
    off = next(line["t"] for line in diary.lines("state") if line["state"] == "switch on disabled")
    written = [line["t"] for line in diary.lines("sdo") if line["key"] != 0x604000]
    assert off < min(written)
