"""A drive that is gone is reported within its consumer time, and nothing pretends to move; in virtual time."""

from __future__ import annotations

from typing import Any

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives import faults
from stagectl.drives.drive import Canopen, Fault
from stagectl.realtime.shared_memory import Order
from stagectl.realtime.states import Event, State
from stagectl.selftest.rig import Rig, motions


@pytest.mark.parametrize(
    ("name", "silence"),
    [("cable-out", "feedback_timeout"), ("feedback-lost", "feedback_timeout"), ("power-off", "feedback_timeout"),
     ("drive-heartbeat-lost", "heartbeat_timeout")],
)  # fmt: skip
@pytest.mark.parametrize("timeout", [0.02, 0.1])
def test_it_is_reported_within_its_time(ball_screw: Setup, name: str, silence: str, timeout: float) -> None:
    wire, simulation = ball_screw.file.drive.wire, ball_screw.file.simulation._replace(substeps=1)
    assert isinstance(wire, Canopen)
    changes: dict[str, Any] = {"heartbeat": 0.01, silence: timeout}
    wire = wire._replace(**changes)
    file = ball_screw.file._replace(drive=ball_screw.file.drive._replace(wire=wire), simulation=simulation)
    setup = ball_screw._replace(file=file)
    laid_out = motions(setup)
    rig = Rig(setup, laid_out)
    loop = rig.loop()
    (axis,) = loop.axes
    loop.connect()
    laid_out.board.order(Order(Event.ENABLE))
    laid_out.board.order(laid_out.moving)
    loop.begin()
    while rig.seen.velocity < 0.5 * laid_out.speed:
        loop.period()
        assert axis.state in (State.ENABLING, State.MOVING)
    began = rig.time.now()
    rig.begin(faults.default(name)._replace(duration=0.0))
    while axis.state is State.MOVING:
        loop.period()
        assert rig.time.now() < began + 1.0
    assert axis.fault is Fault.FEEDBACK_LOST
    assert rig.time.now() - began <= timeout + 3.0 * setup.dt
    assert rig.time.now() - began >= timeout - wire.heartbeat - 3.0 * setup.dt  # and not before: it may be held up
    assert axis.current == 0.0  # nothing is asked of a drive that is not there
    unanswered, mute = "no answer to SYNC" in axis.reason, "its heartbeat was not heard for " in axis.reason
    assert (unanswered, mute) == (silence == "feedback_timeout", silence == "heartbeat_timeout")
