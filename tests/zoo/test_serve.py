"""A service with each foreign drive: it ends as the table says, and for the reason that is true."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.zoo.bench import last_words, objections
from tests.zoo.sample import sample
from tests.zoo.service import serve
from tests.zoo.table import ROWS

SERVED = {row.title: row for row in ROWS}
FEW = (
    *("plain", "vertical", "near-wrap", "fault-at-start", "remote-lost"),
    *("unsupervised", "abort-connection-0-fixed", "other-vendor"),
)


@pytest.mark.parametrize("title", sample(SERVED, FEW))
def test_it_ends_as_the_table_says(title: str, tmp_path: Path) -> None:
    row = SERVED[title]
    result = serve(tmp_path, row)
    assert objections(result, row, served=True) == [], last_words(result.words)
