"""No peak is lost, wherever it lies; and the trigger is where it must be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stagectl.recording.extremes import extremes


@given(st.integers(1, 40), st.integers(1, 300), st.integers(0, 2**31))
def test_every_row_lies_within_its_bucket_and_both_ends_are_rows(size: int, count: int, seed: int) -> None:
    rows = np.random.default_rng(seed).normal(size=(count, 3))
    buckets = extremes(rows, 7, size)
    assert buckets.low.shape == buckets.high.shape == (3, -(-count // size))
    for bucket in range(buckets.low.shape[1]):
        part = rows[bucket * size : (bucket + 1) * size]
        assert np.array_equal(buckets.low[:, bucket], part.min(axis=0))
        assert np.array_equal(buckets.high[:, bucket], part.max(axis=0))


def test_a_row_without_an_answer_hides_no_peak() -> None:
    rows = np.array([[1.0], [np.nan], [9.0], [np.nan], [np.nan]])
    buckets = extremes(rows, 0, 3)
    assert (buckets.low[0, 0], buckets.high[0, 0]) == (1.0, 9.0)
    assert np.isnan(buckets.low[0, 1])


@pytest.mark.parametrize("place", range(10))
def test_one_row_of_ten_thousand_is_seen(place: int) -> None:
    rows = np.zeros((10_000, 1))
    rows[1000 * place + 37] = 1.0
    buckets = extremes(rows, 0, 250)
    assert buckets.high.max() == 1.0
    assert int(np.argmax(buckets.high[0])) == (1000 * place + 37) // 250
