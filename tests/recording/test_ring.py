"""The ring: one writer that never waits, readers that know what they missed."""

from __future__ import annotations

import errno
import os
import resource

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stagectl.recording.ring import Ring
from tests.conftest import endlessly


def rows(data: bytes, width: int) -> list[list[float]]:
    return np.frombuffer(data).reshape(-1, width).tolist()


def test_rows_come_out_as_they_went_in_even_through_another_mapping() -> None:
    ring = Ring.create(3, capacity=8)
    other = Ring(os.dup(ring.descriptor), 3, 8)
    for k in range(5):
        ring.write((k, 0.1 * k, -0.0))
    assert other.written == 5
    first, data = other.read(1, 100)
    assert first == 1
    assert rows(data, 3) == [[k, 0.1 * k, -0.0] for k in range(1, 5)]
    assert not other.closed
    ring.close()
    assert other.closed


def test_memory_beyond_the_limit_of_files_is_named() -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, limits[1]))
    try:
        with pytest.raises(OSError, match="shared memory") as caught:
            Ring.create(3)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert caught.value.errno == errno.EFBIG


def test_a_reader_that_is_too_slow_knows_how_many_rows_it_lost() -> None:
    ring = Ring.create(1, capacity=8)
    for k in range(20):
        ring.write((k,))
    first, data = ring.read(3, 100)
    assert first == 12
    assert rows(data, 1) == [[k] for k in range(12, 20)]


def test_its_count_never_goes_back_while_another_process_writes() -> None:
    ring = Ring.create(1, capacity=8)
    ring.write((0.0,))
    writer = "from stagectl.recording.ring import Ring; ring = Ring(int(sys.argv[1]), 1, 8)\nring.write((0.0,))"
    with endlessly(writer, ring.descriptor):
        seen = [ring.written for _ in range(300_000)]
    assert seen == sorted(seen)
    assert seen[-1] > seen[0] >= 1


@given(st.lists(st.tuples(st.integers(1, 12), st.integers(1, 12)), max_size=30))
def test_any_interleaving_loses_only_what_was_overwritten(turns: list[tuple[int, int]]) -> None:
    ring = Ring.create(2, capacity=10)
    written, done, seen, lost = 0, 0, [], 0
    for writes, most in turns:
        for _ in range(writes):
            ring.write((written, -written))
            written += 1
        first, data = ring.read(done, most)
        lost += first - done
        got = rows(data, 2)
        assert got == [[n, -n] for n in range(first, first + len(got))]
        seen += got
        done = first + len(got)
    assert len(seen) + lost == done <= written
