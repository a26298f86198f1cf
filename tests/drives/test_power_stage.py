"""Power stage and own stop of the virtual drive, without a bus."""

from __future__ import annotations

import math

import pytest

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.drive import Simulation
from stagectl.drives.simulated import Plant
from stagectl.drives.virtual.power_stage import PowerStage, StopOptions, StopReport
from stagectl.kernels import stage
from tests.drives.workbench import DT, GAIN, STEP, linear_stage

OPTIONS = StopOptions(quick_stop=6, fault_reaction=2, abort_connection=3, deceleration=2.0, current_limit=3.0)


def an_axis(reports: list[StopReport] | None = None, p: stage.Stage | None = None, gain: float = GAIN) -> PowerStage:
    """In Operation enabled and cyclic synchronous torque mode."""
    axis = PowerStage(
        Plant(p or linear_stage(), Simulation(substeps=4), DT), gain, ([] if reports is None else reports).append
    )
    axis.options, axis.mode = OPTIONS, cia402.CYCLIC_SYNCHRONOUS_TORQUE
    for controlword in (6, 7, 15):
        axis.control(controlword)
    assert axis.state is DriveState.OPERATION_ENABLED
    return axis


def pushed(axis: PowerStage, current: float, periods: int) -> None:
    axis.target = current
    axis.latch()
    for _ in range(periods):
        axis.advance(DT)


@pytest.mark.parametrize(("asked", "applied"), [(2.5, 2.5), (-2.5, -2.5), (7.0, 3.0), (-7.0, -3.0)])
def test_current_is_limited_and_only_flows_when_enabled(asked: float, applied: float) -> None:
    axis = an_axis()
    axis.target = asked
    axis.latch()
    assert axis.applied == applied
    axis.mode = 0
    axis.latch()
    assert axis.applied == 0.0


def test_an_old_target_does_not_come_back() -> None:
    axis = an_axis()
    pushed(axis, 1.0, 1)
    for controlword in (7, 15):
        axis.control(controlword)
    axis.latch()
    assert (axis.state, axis.applied) == (DriveState.OPERATION_ENABLED, 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_stop_is_told_as_it_went(sign: float) -> None:
    """Duration until the axis stands for good (0.1 mm/s and the encoder's share), distance, either way."""
    reports: list[StopReport] = []
    axis = an_axis(reports)
    pushed(axis, sign * 1.0, 60)
    began, speed = axis.plant.state.position, axis.plant.state.velocity
    assert abs(speed) == pytest.approx(0.27, rel=0.02)
    axis.quick_stop()
    speeds = []
    while not reports:
        axis.advance(DT)
        speeds.append(abs(axis.plant.state.velocity))
    standing = 1e-4 * 2.0 + STEP / 0.01
    moving = max(k for k, v in enumerate(speeds) if v >= standing) + 1
    (stop,) = reports
    assert stop == (pytest.approx(moving * DT), axis.plant.state.position - began, True)
    assert len(speeds) == pytest.approx(moving + 10, abs=1)  # it must stand for 10 ms
    # The velocity lags the ramp by J/(gain Kt) = 10 ms: 20 mm/s at its end, which then decay to 0.2 mm/s.
    assert moving * DT == pytest.approx(abs(speed) / 2.0 + 0.010 * math.log(100.0), abs=0.010)
    assert (axis.state, axis.stopping) == (DriveState.QUICK_STOP_ACTIVE, False)


def test_an_axis_that_cannot_be_stopped_loses_its_power_and_says_so() -> None:
    """A vertical axis heavier than the drive's gain can hold: after the ramp and two seconds it is given up."""
    reports: list[StopReport] = []
    p = linear_stage()
    axis = an_axis(reports, p._replace(mechanics=p.mechanics._replace(bias=20.0)), gain=0.1)
    axis.options = OPTIONS._replace(quick_stop=2)
    pushed(axis, 0.0, 100)
    speed = axis.plant.state.velocity
    axis.quick_stop()
    periods = 0
    while not reports and periods < 10_000:
        axis.advance(DT)
        periods += 1
    assert periods * DT == pytest.approx(speed / 2.0 + 2.0, abs=2 * DT)
    assert not reports[0].stands
    assert (axis.state, axis.plant.powered) == (DriveState.SWITCH_ON_DISABLED, False)


def test_it_is_not_enabled_again_before_it_stands() -> None:
    axis = an_axis()
    pushed(axis, 1.0, 60)
    axis.control(2)
    axis.advance(DT)
    axis.control(15)
    assert (axis.state, axis.stopping) == (DriveState.QUICK_STOP_ACTIVE, True)
    while axis.stopping:
        axis.advance(DT)
    axis.control(15)
    assert axis.state is DriveState.OPERATION_ENABLED


def test_a_fault_is_reset_by_an_edge_only() -> None:
    axis = an_axis()
    axis.control(0x8F)  # the bit is set before the fault
    axis.trip()
    while axis.stopping:
        axis.advance(DT)
    axis.control(0x8F)
    assert axis.state is DriveState.FAULT
    axis.control(0x0F)
    assert axis.state is DriveState.FAULT
    axis.control(0x80)
    assert axis.state is DriveState.SWITCH_ON_DISABLED


def test_a_second_error_does_not_begin_the_stop_again() -> None:
    reports: list[StopReport] = []
    axis = an_axis(reports)
    pushed(axis, 1.0, 60)
    speed = axis.plant.state.velocity
    axis.trip()
    while axis.stopping:
        axis.advance(DT)
        axis.trip()
    assert axis.state is DriveState.FAULT
    assert len(reports) == 1
    assert reports[0].duration > 0.9 * speed / 2.0
    axis.trip()
    assert axis.state is DriveState.FAULT


def test_an_axis_that_cannot_be_held_is_cut_whatever_the_option() -> None:
    """Option 6 stays in Quick stop active when it stands; what never stands must not stay powered."""
    p = linear_stage()
    plant = Plant(p._replace(mechanics=p.mechanics._replace(bias=20.0)), Simulation(substeps=4), DT)
    reports: list[StopReport] = []
    axis = PowerStage(plant, 0.1, reports.append)
    axis.options = axis.options._replace(quick_stop=6)
    axis.mode, axis.state, plant.powered = 10, DriveState.OPERATION_ENABLED, True
    axis.quick_stop()
    for _ in range(round(5.0 / DT)):
        axis.advance(DT)
    assert [stop.stands for stop in reports] == [False]
    assert axis.state is DriveState.SWITCH_ON_DISABLED
    assert not plant.powered
    assert abs(plant.state.current) < 1e-9
