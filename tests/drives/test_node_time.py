"""The virtual drive under a clock that only the script moves: silence, patience, slip and what is still queued."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from stagectl.drives.bus.frames import frame
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.clock import WALL
from stagectl.drives.virtual.node import VirtualNode
from tests.drives.test_node import RESET, START, answers, enabled, rpdo, tpdos, write
from tests.drives.workbench import DT, STEP, SYNC, Script, Workbench

HEARTBEAT = frame(0x77F, b"\x05")
RAMP = write(0x6085, 0, round(2.0 / STEP), 4)


class Timed(Script):
    """A script whose steps may be floats: seconds in which nothing comes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__()
        self.steps: list[Any] = []
        self.now = 1000.0
        monkeypatch.setattr(time, "monotonic", lambda: self.now)
        monkeypatch.setattr(WALL, "now", lambda: self.now, raising=False)

    def receive(self, timeout: float) -> bytes | None:
        while self.steps:
            if isinstance(self.steps[0], float):
                if timeout > 0.0:  # a look into the queue costs no time, and finds nothing behind a pause
                    self.now += self.steps.pop(0)
                return None
            step = self.steps.pop(0)
            if isinstance(step, bytes):
                return step
            step()
        return None


@pytest.fixture
def timed(monkeypatch: pytest.MonkeyPatch) -> Timed:
    return Timed(monkeypatch)


Step = bytes | float | Callable[[], Any]


def play(bench: Workbench, timed: Timed, *steps: Step, clock: str = "sync") -> VirtualNode:
    node = bench.node(timed, clock)
    continue_with(node, timed, *steps)
    return node


def continue_with(node: VirtualNode, timed: Timed, *steps: Step) -> None:
    """To run is to boot, which takes the node out of operation; its state, time and machine stay."""
    timed.steps.extend(steps)
    node.run(timed.done)


def moving() -> list[bytes]:
    """Enabled, and after 60 periods at about 0.27 m/s."""
    return [RAMP, *enabled(), *[rpdo(15, 100_000), SYNC] * 60]


def test_silence_counts_from_the_last_sign_of_life(bench: Workbench, timed: Timed) -> None:
    watch = write(0x1016, 1, 0x7F_0000 | 64, 4)  # ms, and the pauses are sums of powers of two
    node = play(bench, timed, watch, *enabled(), HEARTBEAT, 0.0625, HEARTBEAT, 0.0625, HEARTBEAT)
    assert (node.axis.state, bench.reports) == (DriveState.OPERATION_ENABLED, [])
    continue_with(node, timed, 0.0625, 0.001953125, 0.0)
    assert bench.reports[0] == "no heartbeat from the controller for 64 ms (time-out 64 ms): quick stop"
    assert node.axis.state is not DriveState.OPERATION_ENABLED


def test_a_heartbeat_of_somebody_else_is_none(bench: Workbench, timed: Timed) -> None:
    watch = write(0x1016, 1, 0x20_0000 | 60, 4)  # node 32 is the controller
    ours, other = frame(0x720, b"\x05"), HEARTBEAT
    steps: list[Any] = [0.05, ours, other] * 4
    node = play(bench, timed, watch, *enabled(), ours, *steps)
    assert (node.axis.state, bench.reports) == (DriveState.OPERATION_ENABLED, [])
    continue_with(node, timed, 0.05, other, 0.05, other, 0.0)
    assert bench.reports[0].startswith("no heartbeat from the controller for 100 ms")
    assert node.axis.state is not DriveState.OPERATION_ENABLED


def test_what_is_still_queued_is_heard_before_silence_is_declared(bench: Workbench, timed: Timed) -> None:
    """A drive that was not scheduled for a while must not take its own sleep for the controller's."""
    watch = [write(0x1016, 1, 0x7F_0000 | 60, 4), write(0x1400, 5, 60, 2)]
    node = play(bench, timed, *watch, *enabled(), rpdo(15), HEARTBEAT, 0.2, rpdo(15), HEARTBEAT, 0.0)
    assert (node.axis.state, bench.reports) == (DriveState.OPERATION_ENABLED, [])


def test_in_fault_a_returning_controller_does_not_clear_the_error(bench: Workbench, timed: Timed) -> None:
    watch = [write(0x1016, 1, 0x7F_0000 | 60, 4), write(0x6007, 0, 1, 2)]  # abort connection: fault
    node = play(bench, timed, *watch, *enabled(), HEARTBEAT, 0.1, 0.1, HEARTBEAT, 0.0)
    assert node.axis.state is DriveState.FAULT
    assert node.objects.error_code == 0x8130
    assert answers(timed, 0x085) == ["30 81 10 00 00 00 00 00"]
    continue_with(node, timed, START, rpdo(0), SYNC, rpdo(0x80), SYNC, SYNC)
    assert (node.axis.state, node.objects.error_code) == (DriveState.SWITCH_ON_DISABLED, 0)


def test_while_syncs_come_a_stop_takes_its_time_from_them(bench: Workbench, timed: Timed) -> None:
    """With the clock `sync`, 10 ms between two SYNCs are one period; after 20 ms without any, the wall clock counts."""
    seen: list[tuple[float, float]] = []
    node = bench.node(timed)

    def look() -> None:
        seen.append((node.axis._elapsed, node.axis._reference))

    slow = [step for _ in range(30) for step in (0.010, SYNC)]
    continue_with(node, timed, *moving(), rpdo(2), SYNC, look, *slow, look, 0.0255, 0.0, look)
    (_, began), during, after = seen
    assert during == pytest.approx((30 * DT, began - 2.0 * 30 * DT))
    assert after == pytest.approx((55 * DT, began - 2.0 * 55 * DT))


def test_the_wall_clock_moves_the_plant_and_never_catches_up_more_than_a_second(bench: Workbench, timed: Timed) -> None:
    node = play(bench, timed, *enabled(), clock="wall")
    drift, drifted = node.axis.plant.drift, list[float]()

    def watched(seconds: float) -> None:
        drifted.append(seconds)
        drift(seconds)

    node.axis.plant.drift = watched  # type: ignore[method-assign]
    continue_with(node, timed, 0.0123)
    assert sum(drifted) == pytest.approx(0.0123, abs=1e-9)
    assert max(drifted) == pytest.approx(DT)
    continue_with(node, timed, 5.0)
    assert sum(drifted) == pytest.approx(1.0123, abs=1e-6)
    assert bench.reports == ["the plant's clock slipped by 4.0 s: this machine is too busy"]


def test_a_pending_command_does_not_outlive_operational(bench: Workbench, timed: Timed) -> None:
    """An RPDO that waits for its SYNC is void once the node is taken out of operation."""
    pre_operational = frame(0, bytes([0x80, 5]))
    switched_on = enabled()[:-2]
    node = play(bench, timed, *switched_on, rpdo(15), pre_operational, START, SYNC, SYNC)
    assert node.axis.state is DriveState.SWITCHED_ON


def test_a_command_is_obeyed_once(bench: Workbench, timed: Timed) -> None:
    shutdown = write(0x6040, 0, 6, 2)
    node = play(bench, timed, *enabled(), rpdo(7), SYNC, shutdown, SYNC, SYNC)
    assert node.axis.state is DriveState.READY


def test_a_longer_command_is_taken(bench: Workbench, timed: Timed) -> None:
    """CiA 301: the bytes beyond the mapping are ignored."""
    longer = frame(0x205, b"\x0f\x00\xa0\x86\x01\x00\xff\xff")
    node = play(bench, timed, *enabled(), longer, SYNC, SYNC)
    assert node.axis.applied == pytest.approx(1.0)
    assert answers(timed, 0x085) == []


def test_a_reset_of_the_communication_leaves_the_machine_where_it_is(bench: Workbench, timed: Timed) -> None:
    communication = frame(0, bytes([0x82, 5]))
    node = play(bench, timed, write(0x605A, 0, 6, 2), *moving(), communication)
    assert node.axis.plant.position_counts == tpdos(timed)[-1][1] != 0
    assert node.objects.number(0x605A) == 6  # an object of the profile
    assert node.objects.number(0x1600, 2) != 0x2071_0020  # one of the communication
    continue_with(node, timed, RESET)
    assert node.axis.plant.position_counts == 0
