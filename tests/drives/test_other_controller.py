"""Another controller that comes to the bus after ours: its first frame ends the power, or keeps it from coming."""

from __future__ import annotations

import pytest

from stagectl.drives.bus.frames import frame
from stagectl.drives.drive import DriveError, Fault
from tests.drives.test_setup import Scene
from tests.drives.workbench import DT, SYNC, Workbench, enabled

FRAMES = {
    "sync": SYNC,
    "rpdo": frame(0x205, bytes(6)),
    "nmt": frame(0, b"\x80\x05"),
    "nmt for all": frame(0, b"\x80\x00"),
}
OTHERS = {
    "sdo answer": frame(0x585, bytes(8)),
    "rpdo of another": frame(0x206, bytes(6)),
    "nmt for another": frame(0, b"\x80\x06"),
    "heartbeat": frame(0x706, b"\x05"),
}


class Disturbed(Scene):
    """Frames of a third party come to us alone, before anything else."""

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self.foreign: list[bytes] = []
        receive = self.ours.receive
        heard = lambda timeout: self.foreign.pop(0) if self.foreign else receive(timeout)  # noqa: E731
        self.ours.receive = heard  # type: ignore[method-assign]


@pytest.mark.parametrize("kind", FRAMES)
def test_it_is_told_in_the_period_in_which_it_is_heard(bench: Workbench, kind: str) -> None:
    scene = Disturbed(bench)
    drive = scene.drive()
    enabled(drive, scene.time)
    scene.foreign.append(FRAMES[kind])
    assert drive.sample().fault is Fault.DRIVE_FAULT
    assert "another controller is on the bus" in drive.explain()


@pytest.mark.parametrize("kind", FRAMES)
def test_no_axis_may_move_beside_it(bench: Workbench, kind: str) -> None:
    scene = Disturbed(bench)
    drive = scene.drive()
    again = lambda: scene.foreign.append(FRAMES[kind])  # noqa: E731
    scene.time.every(DT, again)
    with pytest.raises(DriveError, match="another controller is on the bus"):
        enabled(drive, scene.time)


@pytest.mark.parametrize("kind", OTHERS)
def test_other_traffic_is_nobodys_command(bench: Workbench, kind: str) -> None:
    scene = Disturbed(bench)
    drive = scene.drive()
    scene.foreign.append(OTHERS[kind])
    enabled(drive, scene.time)
    scene.foreign.append(OTHERS[kind])
    assert drive.sample().fault is Fault.NONE
