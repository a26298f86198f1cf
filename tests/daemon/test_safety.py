"""When the loop stops: a table of every reason, and that a drive's own fault comes first."""

from __future__ import annotations

import math

import pytest

from stagectl.daemon.safety import Envelope, judge, words
from stagectl.drives.drive import Fault

P = Envelope(low=-1.0, high=2.0, speed=10.0, following_error=0.1, late_limit=5)


@pytest.mark.parametrize(
    ("position", "speed", "error", "expected"),
    [
        (0.0, 0.0, 0.0, Fault.NONE),
        (-1.0, -10.0, -0.1, Fault.NONE),
        (2.0, 10.0, 0.1, Fault.NONE),
        (2.0000001, 0.0, 0.0, Fault.TRAVEL),
        (-1.0000001, 0.0, 0.0, Fault.TRAVEL),
        (0.0, 10.000001, 0.0, Fault.SPEED),
        (0.0, -10.000001, 0.0, Fault.SPEED),
        (0.0, 0.0, 0.1000001, Fault.FOLLOWING_ERROR),
        (0.0, 0.0, -0.1000001, Fault.FOLLOWING_ERROR),
        (math.nan, 0.0, math.nan, Fault.FOLLOWING_ERROR),
        (math.nan, 0.0, 0.0, Fault.TRAVEL),
        (0.0, math.nan, 0.0, Fault.SPEED),
    ],
)
def test_each_limit(position: float, speed: float, error: float, expected: Fault) -> None:
    assert judge(P, Fault.NONE, position, speed, error) is expected


@pytest.mark.parametrize("fault", [f for f in Fault if f is not Fault.NONE])
def test_the_drives_own_fault_comes_first(fault: Fault) -> None:
    assert judge(P, fault, 99.0, 99.0, 99.0) is fault


def test_every_fault_has_words_of_its_own() -> None:
    said = [words(fault) for fault in Fault if fault is not Fault.NONE]
    assert all(said)
    assert len(set(said)) == len(said)
