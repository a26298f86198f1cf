"""A drive that falls silent: while it gets power, where each period is as long as its time-out, and in mid stop."""

from __future__ import annotations

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives import faults
from stagectl.drives.drive import Fault, Power
from stagectl.realtime.states import State
from stagectl.selftest import matrix
from stagectl.selftest.case import Case
from tests.realtime.test_axis import Bench


@pytest.mark.parametrize("name", ["cable-out", "feedback-lost"])
def test_enabling_is_given_up_after_its_five_seconds(ball_screw: Setup, name: str) -> None:
    bench = matrix.virtual(ball_screw, frozenset({name}))
    case = Case(*bench.rig(), faults.FAULT_TYPES[name], State.ENABLING)
    case.run()
    assert (case.reason, case.wrong) == ("DRIVE_FAULT", "")
    took = case.rig.time.now() - case.begun
    assert 5.0 < took < 8.0  # by its periods it would be 10,000 time-outs of 500 ms


def test_two_answers_lost_a_second_apart_do_not_end_a_stop(ball_screw: Setup) -> None:
    """A drive counts as lost after a second of silence; power is not cut in mid ramp because of two single frames."""
    bench = Bench(ball_screw)
    bench.to(State.QUICK_STOPPING)
    now, place = 0.0, 0.0
    bench.axis.now = lambda: now
    bench.axis.entered = now
    for period in range(3000):
        now, place = now + bench.axis.dt, place + 1e-3  # it brakes for longer than a second
        bench.drive.frozen = place
        bench.drive.fault = Fault.FEEDBACK_LOST if period in (100, 2500) else Fault.NONE
        bench.run(1)
    assert bench.axis.state is State.QUICK_STOPPING
    assert bench.drive.power is Power.QUICK_STOP
    bench.drive.fault = Fault.FEEDBACK_LOST
    now += 2.0
    bench.run(1)
    now += 1.1
    bench.run(1)
    assert bench.axis.state is State.DISABLED
