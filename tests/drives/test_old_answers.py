"""A drive whose answer to SYNC n holds the data of period n - 1: no old statusword is taken for the new one."""

from __future__ import annotations

import pytest

from stagectl.drives.bus.virtual_time import End, Timeline, Wire
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.drive import Fault, Feedback, Power
from stagectl.drives.virtual.node import VirtualNode
from tests.drives.workbench import DT, STEP, Workbench, enabled

_ANSWER = (0x185).to_bytes(4, "little")


class LateAnswers:
    """The drive's end of the bus; each cyclic answer waits for the next SYNC, `age` times."""

    def __init__(self, end: End, age: int) -> None:
        self._end, self._age = end, age
        self._kept: list[bytes] = []

    def send(self, frame: bytes) -> None:
        if frame[:4] != _ANSWER:
            self._end.send(frame)
            return
        self._kept = [*self._kept, frame][-self._age - 1 :]
        self._end.send(self._kept[0])

    def receive(self, timeout: float) -> bytes | None:
        return self._end.receive(timeout)

    def close(self) -> None:
        self._end.close()


class Scene:
    """The drive with old answers, and our master."""

    def __init__(self, bench: Workbench, age: int) -> None:
        self.time = Timeline()
        ours, theirs = Wire(self.time, 1e6).ends
        self.node: VirtualNode = bench.node(LateAnswers(theirs, age), "sync", self.time)
        theirs.wakes = self.node.turn
        self.node.boot()
        self.time.every(0.001, self.node.turn)
        self.drive = CanopenDrive(Wishes(bench.settings(reset="node"), STEP, DT), ours, clock=self.time)

    def period(self) -> Feedback:
        now = self.drive.sample()
        self.drive.apply(0.0)
        self.time.sleep(DT)
        return now

    @property
    def runs(self) -> bool:
        return self.node.axis.state is DriveState.OPERATION_ENABLED


@pytest.mark.parametrize("age", [0, 1, 2])
def test_it_is_enabled_when_it_says_so(bench: Workbench, age: int) -> None:
    scene = Scene(bench, age)
    enabled(scene.drive, scene.time)
    assert scene.runs
    assert all(scene.period().fault is Fault.NONE for _ in range(200))


@pytest.mark.parametrize("age", [0, 1, 2])
@pytest.mark.parametrize("pause", [0, 1, 2, 3])
def test_power_that_was_just_cut_is_not_taken_for_the_new_one(bench: Workbench, age: int, pause: int) -> None:
    """Off, and on again some periods later: the answers still show Operation enabled of before."""
    scene = Scene(bench, age)
    enabled(scene.drive, scene.time)
    for _ in range(20):
        scene.period()
    scene.drive.ask(Power.OFF)
    scene.drive.apply(0.0)
    for _ in range(pause):
        scene.period()
    scene.drive.ask(Power.ON)
    after: list[tuple[Fault, bool]] = []
    for _ in range(100):
        fault = scene.period().fault
        after.append((fault, scene.runs))
    first = next(k for k, (fault, _) in enumerate(after) if fault is Fault.NONE)
    assert all(now == (Fault.NONE, True) for now in after[first:])


@pytest.mark.parametrize("age", [0, 1])
def test_a_quick_stop_ends_without_power_and_a_fault_is_reset(bench: Workbench, age: int) -> None:
    scene = Scene(bench, age)
    enabled(scene.drive, scene.time)
    scene.drive.ask(Power.QUICK_STOP)
    for _ in range(300):
        scene.period()
    assert scene.node.axis.state is DriveState.SWITCH_ON_DISABLED
    scene.node.trip(0x2310)
    scene.period()
    scene.drive.reset_fault()
    scene.period()
    assert scene.node.axis.state is DriveState.SWITCH_ON_DISABLED
    assert scene.drive.pending_fault() == ""
