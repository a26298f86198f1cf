"""`stagectl run` against each foreign drive: it ends as the table says, and for the reason that is true."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.zoo.bench import last_words, objections, run
from tests.zoo.sample import sample
from tests.zoo.table import EVERY, ROWS

SLOW = ("slow-sdo", "drops-sdo")  # 25 s and 8 s
SOME_LACKS = ("without:603F00", "without:605A00", "without:60C201")
FEW = [title for title in (*(row.title for row in ROWS), *SOME_LACKS) if title not in SLOW]


@pytest.mark.parametrize("title", sample(EVERY, FEW))
def test_it_ends_as_the_table_says(title: str, tmp_path: Path) -> None:
    row = EVERY[title]
    result = run(tmp_path, row)
    assert objections(result, row) == [], last_words(result.words)
