"""A drive that is gone is reported within its consumer time, and nothing pretends to move; in virtual time."""

from __future__ import annotations

from typing import Any

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives import faults
from stagectl.drives.drive import Fault
from stagectl.realtime.states import State
from tests.single_motion import SingleMotion


@pytest.mark.parametrize(
    ("name", "silence"),
    [("cable-out", "feedback_timeout"), ("feedback-lost", "feedback_timeout"), ("power-off", "feedback_timeout"),
     ("drive-heartbeat-lost", "heartbeat_timeout")],
)  # fmt: skip
@pytest.mark.parametrize("timeout", [0.02, 0.1])
def test_it_is_reported_within_its_time(ball_screw: Setup, name: str, silence: str, timeout: float) -> None:
    changes: dict[str, Any] = {"heartbeat": 0.01, silence: timeout}
    setup = ball_screw.with_wire(**changes).having(simulation=ball_screw.file.simulation._replace(substeps=1))
    motion = SingleMotion(setup, moving=True)
    rig, loop, axis = motion.rig, motion.loop, motion.axis
    while rig.seen.velocity < 0.5 * motion.pace.speed:
        loop.period()
        assert axis.state in (State.ENABLING, State.MOVING)
    began = rig.time.now()
    rig.begin(faults.default(name)._replace(duration=0.0))
    while axis.state is State.MOVING:
        loop.period()
        assert rig.time.now() < began + 1.0
    assert axis.fault is Fault.FEEDBACK_LOST
    assert rig.time.now() - began <= timeout + 3.0 * setup.dt
    held_up = timeout - setup.canopen.heartbeat - 3.0 * setup.dt
    assert rig.time.now() - began >= held_up  # and not before
    assert axis.current == 0.0  # nothing is asked of a drive that is not there
    unanswered, mute = "no answer to SYNC" in axis.reason, "its heartbeat was not heard for " in axis.reason
    assert (unanswered, mute) == (silence == "feedback_timeout", silence == "heartbeat_timeout")
