"""A virtual plant that waits for SYNC gives everybody time; any other keeps to its file."""

from __future__ import annotations

from typing import Any

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Canopen
from stagectl.realtime.envelope import envelope
from stagectl.service.axis_controller import AxisController
from stagectl.service.virtual_timeouts import HELD_UP, patient, waits_for_sync


def wired(setup: Setup, clock: Any = "sync", **changes: Any) -> Setup:
    return setup.with_wire(**changes).having(simulation=setup.file.simulation._replace(clock=clock))


def test_silence_counts_late_where_the_plant_stands_still_meanwhile(ball_screw: Setup) -> None:
    orders = AxisController("axis", ball_screw).orders()
    assert isinstance(orders.wire, Canopen) and not orders.by_clock
    waits = orders.wire.heartbeat_timeout, orders.wire.rpdo_timeout, orders.wire.feedback_timeout
    assert waits == (HELD_UP,) * 3
    assert orders.envelope.late_limit == 1_000_000


def test_longer_ones_and_one_that_is_off_stay(ball_screw: Setup) -> None:
    wire = patient(wired(ball_screw, feedback_timeout=9.0, rpdo_timeout=0.0)).file.drive.wire
    assert isinstance(wire, Canopen)
    assert (wire.heartbeat_timeout, wire.rpdo_timeout, wire.feedback_timeout) == (HELD_UP, 0.0, 9.0)


@pytest.mark.parametrize("change", [{"clock": "wall"}, {"interface": "socketcan", "channel": "can0"}])
def test_a_plant_in_real_time_is_taken_at_its_word(ball_screw: Setup, change: dict[str, Any]) -> None:
    setup = wired(ball_screw, **change)
    assert not waits_for_sync(setup)
    assert patient(setup) is setup
    orders = AxisController("axis", setup).orders()
    assert orders.by_clock and orders.wire == setup.file.drive.wire
    assert orders.envelope == envelope(setup)
