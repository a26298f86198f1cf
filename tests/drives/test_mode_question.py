"""The question for the mode (0x6061) by SDO: it must not delay SYNC, which latches the position of a moving axis."""

from __future__ import annotations

import itertools

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives.canopen.operation_watch import MODE_REQUEST
from stagectl.drives.cycle_time import has_room_for_sdo
from stagectl.realtime.states import State
from tests.single_motion import SingleMotion

PERIODS = 450  # of 0.5 ms: two questions, where they are asked


def heard(setup: Setup, moving: bool) -> tuple[list[float], int]:
    """When SYNC reached the drive (s), and how often it was asked for its mode."""
    motion, frames = SingleMotion(setup, moving), list[tuple[float, bytes]]()
    rig, loop, axis = motion.rig, motion.loop, motion.axis
    while axis.state is not State.MOVING:
        loop.period()
    drive = rig.ours._wire.ends[1]
    plain = drive.take

    def take(frame: bytes) -> None:
        frames.append((rig.time.now(), frame))
        plain(frame)

    drive.take = take  # type: ignore[method-assign]
    for _ in range(PERIODS):
        loop.period()
    loop.leave()
    synced = [time for time, raw in frames if raw[:4] == b"\x80\x00\x00\x00"]
    return synced, sum(raw[8:16] == MODE_REQUEST for _, raw in frames)


def test_a_moving_axis_is_latched_on_time_and_a_standing_one_is_asked(slow_screw: Setup) -> None:
    synced, asked = heard(slow_screw, moving=True)
    assert asked == 0
    for before, after in itertools.pairwise(synced[:PERIODS]):
        assert after - before == pytest.approx(5e-4, abs=1e-9)
    assert heard(slow_screw, moving=False)[1] >= 2


@pytest.mark.parametrize(("dt", "bitrate", "fits"), [(5e-4, 1e6, False), (1e-3, 1e6, True), (1e-3, 5e5, False)])
def test_room_in_a_period(dt: float, bitrate: float, fits: bool) -> None:
    """55 + 2 x 135 bits of the cycle, 65 of a heartbeat, 2 x 135 of question and answer: 660 bits."""
    assert has_room_for_sdo(dt, bitrate) == fits
