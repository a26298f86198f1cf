"""`stagectl run` against each foreign drive: it ends as the table says, and for the reason that is true."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.zoo.bench import last_words, objections, run
from tests.zoo.table import EVERY


@pytest.mark.parametrize("title", EVERY)
def test_it_ends_as_the_table_says(title: str, tmp_path: Path) -> None:
    row = EVERY[title]
    result = run(tmp_path, row)
    assert objections(result, row) == [], last_words(result.words)
