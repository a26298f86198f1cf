"""Rings side by side: lined up by period, whichever axis was just writing; what has been overwritten is left out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stagectl.recording.joined_rings import Joined, ahead
from stagectl.recording.ring import Ring


class Moment:
    """A ring that is looked at again and again, and has written so many rows each time."""

    def __init__(self, *written: int) -> None:
        self._written = list(written)

    @property
    def written(self) -> int:
        return self._written.pop(0) if len(self._written) > 1 else self._written[0]


@pytest.mark.parametrize(
    ("leader", "other"),
    [
        ((10, 10, 10, 10), (6,)),
        ((10, 10, 11, 11, 11, 11), (6, 6, 7)),  # between: x has written, y has not
        ((10, 11, 11, 11, 12, 12), (7, 7, 8)),  # a period began while it was looked: that look does not count
    ],
)
def test_how_far_one_is_ahead(leader: tuple[int, ...], other: tuple[int, ...]) -> None:
    moments: Any = (Moment(*leader), Moment(*other))
    assert ahead(*moments) == 4


def filled(rows: int, capacity: int, base: float) -> Ring:
    ring = Ring.create(2, capacity)
    for number in range(rows):
        ring.write((base + number, -base))
    return ring


def test_a_row_is_what_both_wrote_in_the_same_period() -> None:
    joined = Joined([filled(30, 100, 0.0), filled(20, 100, 10.0)])
    first, raw = joined.read(5, 100)
    rows = np.frombuffer(raw).reshape(-1, 4)
    assert first == 10  # the second had not begun
    assert (rows[:, 0] == rows[:, 2]).all()
    assert rows[:, 0].tolist() == [float(number) for number in range(10, 30)]


def test_what_one_of_them_has_lost_is_left_out() -> None:
    joined = Joined([filled(30, 100, 0.0), filled(30, 8, 0.0)])
    assert (joined.capacity, joined.width, joined.written) == (8, 4, 30)
    first, raw = joined.read(0, 30)
    assert first == 22
    assert np.frombuffer(raw).reshape(-1, 4)[:, 2].tolist() == [float(number) for number in range(22, 30)]
