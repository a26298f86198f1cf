"""Homing by the drive, in virtual time: our master, and the virtual drive's homing mode."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.drive import DriveError, Fault, Feedback, Power
from stagectl.drives.homing import Homing
from stagectl.drives.virtual.node import VirtualNode
from tests.drives.workbench import DT, STEP, Workbench, enabled

MARK = 2e-3  # m
SEARCH = Homing("drive", 0.02, 0.01, position=0.05, number=34)


class Homed:
    """A virtual drive with a mark, and our master, which is to let it home."""

    def __init__(self, bench: Workbench, homing: Homing = SEARCH) -> None:
        self.node, bus, self.time = bench.timed(mark=MARK)
        settings = bench.settings(reset="node")
        self.drive = CanopenDrive(Wishes(settings, STEP, DT, homing=homing), bus, clock=self.time)
        enabled(self.drive, self.time)

    def until(self, over: Callable[[Feedback], bool], most: float = 5.0) -> Feedback:
        end = self.time.now() + most
        while self.time.now() < end:
            now = self.period()
            if over(now):
                return now
        raise AssertionError(now)

    def period(self, current: float = 0.0) -> Feedback:
        now = self.drive.sample()
        self.drive.apply(current)
        self.time.sleep(DT)
        return now

    def home(self) -> Feedback:
        self.drive.ask(Power.HOME)
        return self.until(lambda now: not now.busy)


def place(node: VirtualNode) -> float:
    """Where the machine is (m), whatever the drive counts from."""
    return float(node.axis.plant.position)


@pytest.mark.parametrize(("number", "start"), [(34, 0.0), (33, 4e-3)])
def test_it_stands_beside_the_mark_and_counts_from_it(bench: Workbench, number: int, start: float) -> None:
    homed = Homed(bench, SEARCH._replace(number=number))
    homed.node.axis.plant.state = homed.node.axis.plant.state._replace(position=start)
    homed.period()
    end = homed.home()
    assert end.fault is Fault.NONE
    assert end.position == pytest.approx(place(homed.node) - MARK, abs=0.02 * DT)  # the speed times a period
    assert abs(end.position) < 3e-3  # 0.02 m/s and 0.2 m/s^2: 1 mm to brake in
    assert homed.node.axis.mode == cia402.CYCLIC_SYNCHRONOUS_TORQUE
    assert abs(homed.node.axis.plant.state.velocity) < 1e-4


def test_afterwards_the_current_acts_again_and_the_position_goes_on(bench: Workbench) -> None:
    homed = Homed(bench)
    before = homed.home().position
    for _ in range(100):
        after = homed.period(1.0)
        assert after.fault is Fault.NONE
        assert abs(after.position - before) < 1e-3  # no jump once it is homed
        before = after.position
    assert after.position > 1e-3
    assert after.statusword & cia402.FOLLOWS


@pytest.mark.parametrize("number", [35, 37])
def test_in_place_it_counts_from_where_it_stands(bench: Workbench, number: int) -> None:
    homed = Homed(bench, Homing("drive", position=0.05, number=number))
    homed.node.axis.plant.state = homed.node.axis.plant.state._replace(position=1e-3)
    homed.period()
    assert homed.home().position == pytest.approx(0.0, abs=1e-6)
    assert place(homed.node) == pytest.approx(1e-3, abs=1e-6)


def test_a_second_homing_is_not_taken_for_the_first(bench: Workbench) -> None:
    """Bits 10 and 12 still stand from the first: only what comes after the start counts."""
    homed = Homed(bench, SEARCH._replace(number=34))
    homed.home()
    homed.node.axis.plant.state = homed.node.axis.plant.state._replace(position=1e-3)
    homed.period()
    begun = homed.time.now()
    end = homed.home()
    assert homed.time.now() - begun > 1e-3 / 0.02  # it has gone there again
    assert end.position == pytest.approx(place(homed.node) - MARK, abs=0.02 * DT)


def test_a_method_that_the_drive_lacks_is_refused_by_name(bench: Workbench) -> None:
    with pytest.raises(DriveError) as error:
        Homed(bench, SEARCH._replace(number=17))
    assert error.value.object_key == cia402.HOMING_METHOD << 8


def test_an_error_of_the_homing_is_a_fault_of_its_own(bench: Workbench) -> None:
    homed = Homed(bench)
    homed.drive.ask(Power.HOME)
    homed.node.objects.node.data_store[cia402.HOMING_METHOD] = {0: b"\x01"}
    assert homed.until(lambda now: now.fault is not Fault.NONE).fault is Fault.HOMING
    assert "bit 13" in homed.drive.explain()


def test_a_stop_in_mid_search_brakes_and_power_brings_the_cyclic_mode_back(bench: Workbench) -> None:
    homed = Homed(bench)
    homed.drive.ask(Power.HOME)
    homed.until(lambda now: abs(homed.node.axis.plant.state.velocity) > 0.01)
    homed.drive.ask(Power.QUICK_STOP)
    homed.until(lambda now: not homed.node.axis.enabled)
    assert place(homed.node) < MARK
    homed.drive.ask(Power.ON)
    homed.until(lambda now: now.fault is Fault.NONE)
    assert homed.node.axis.mode == cia402.CYCLIC_SYNCHRONOUS_TORQUE


def test_a_drive_that_does_not_take_the_mode_under_power_is_a_fault(bench: Workbench) -> None:
    homed = Homed(bench)
    homed.node.objects.setters[cia402.MODE << 8] = lambda mode: None
    homed.drive.ask(Power.HOME)
    assert homed.until(lambda now: now.fault is not Fault.NONE).fault is Fault.HOMING
    assert "0x6060" in homed.drive.explain()
