"""A drive that falls silent while it gets power: each period is as long as its time-out, the patience is not."""

from __future__ import annotations

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives import faults
from stagectl.realtime.states import State
from stagectl.selftest import matrix
from stagectl.selftest.case import Case


@pytest.mark.parametrize("name", ["cable-out", "feedback-lost"])
def test_enabling_is_given_up_after_its_five_seconds(ball_screw: Setup, name: str) -> None:
    bench = matrix.virtual(ball_screw, frozenset({name}))
    case = Case(*bench.rig(), faults.FAULT_TYPES[name], State.ENABLING)
    case.run()
    assert (case.reason, case.wrong) == ("DRIVE_FAULT", "")
    took = case.rig.time.now() - case.begun
    assert 5.0 < took < 8.0  # by its periods it would be 10,000 time-outs of 500 ms
