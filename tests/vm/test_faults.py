"""Each fault of the table on a moving axis, with the installed service, in the guest's time: how soon it stands.

The self-test asserts the same limits in virtual time and in all states; here a real bus, real processes and a clock
that nobody can stop take part.
"""

from __future__ import annotations

import signal
import subprocess
import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup, load_stage
from stagectl.drives import faults
from stagectl.drives.faults import FaultType
from stagectl.selftest.limits import Limit, limit
from tests.vm.bench import CHANNEL, Traced, keep
from tests.vm.installed import LOOP, Installed

SPEED = 0.03  # m/s, a tenth of limits.speed
HUNG = 0.3  # s that the loop is stopped for, and the interface down
OVER = 0.02  # s: the drive's process looks each millisecond, and the loop has the processor first
GOES_ON = 0.3  # s that a motion which must go on is watched
MILDER = {"current-weak": {"factor": 0.7}}  # a 10 Hz loop does not hold the axis with a third of the current
STANDING = 1e-4  # s of the ramp: speed below which an axis stands, as in the self-test


@pytest.fixture(scope="module")
def setup(machine: Installed) -> Setup:
    return load_stage(machine.stage)


@pytest.mark.parametrize("row", faults.TABLE, ids=lambda row: str(row.name))
def test_the_axis_stops_in_time(machine: Installed, drive: Traced, setup: Setup, row: FaultType) -> None:
    speed = SPEED / setup.file.axis.travel_per_unit
    machine.moving(SPEED)
    drive.trace()
    began = _begin(machine, drive, row)
    bound = limit(setup, row, faults.default(row.name), speed)
    if row.required.category is None:
        time.sleep(GOES_ON)
        state = machine.axis()["state"]
        drive.clear()
        machine.ask("POST", "stop")
        assert state == "moving"
        return
    time.sleep(bound.time + 0.1)
    trace = drive.trace()
    drive.clear()
    _judge(row, setup, trace, began, bound)
    stopped = machine.until(lambda axis: axis["state"] in ("fault", "offline", "disabled"))
    said = machine.faults()[-1]
    if row.name == "controller-dead":
        assert said == "process_died"
    else:
        assert stopped["state"] != "disabled" and said == stopped["fault"]
        assert not row.required.reasons or said in [reason.name.lower() for reason in row.required.reasons]


def _begin(machine: Installed, drive: Traced, row: FaultType) -> float:
    """Let it happen; when it did (s, monotonic)."""
    if row.component != "controller":
        return drive.fault(faults.default(row.name)._replace(**MILDER.get(row.name, {})))
    if row.name == "controller-dead":
        return machine.kill(LOOP)
    began = time.monotonic()
    if row.name == "interface-down":
        subprocess.run(["ip", "link", "set", CHANNEL, "down"], check=True)
        time.sleep(HUNG)
        subprocess.run(["ip", "link", "set", CHANNEL, "up"], check=True)
    else:
        machine.kill(LOOP, signal.SIGSTOP)
        time.sleep(HUNG)
        machine.kill(LOOP, signal.SIGCONT)
    return began


def _judge(row: FaultType, setup: Setup, trace: NDArray[Any], began: float, bound: Limit) -> None:
    """It stands, in time, not too far away, and without power; before, it moved."""
    wire: Any = setup.file.drive.wire
    after, here = trace[trace["time"] >= began], np.interp(began, trace["time"], trace["position"])
    moves = after["time"][np.abs(after["velocity"]) > STANDING * wire.quick_stop_deceleration]
    stop_time = float(moves[-1] - began) if len(moves) else 0.0
    way = float(np.max(np.abs(after["position"] - here)))
    unit = setup.file.axis.travel_per_unit
    shown = {"ms": 1e3 * stop_time, "at most ms": 1e3 * bound.time, "mm": 1e3 * way * unit}
    keep(f"fault {row.name}", {**shown, "at most mm": 1e3 * bound.distance * unit})
    speed = np.abs(trace["velocity"][trace["time"] < began + 5e-3])  # its process may be held up then
    assert len(after) > 10 and np.max(speed) > 0.8 * SPEED / unit
    assert stop_time <= bound.time + OVER, shown
    assert way <= bound.distance + OVER * SPEED / unit, shown
    assert after["powered"][-1] == 0.0
    if row.required.category == 1 and row.required.brakes == "ramp":
        fast = np.abs(after["velocity"]) > 2.0 * STANDING * wire.quick_stop_deceleration
        assert not np.any(fast & (after["powered"] == 0.0)), "the power was cut in motion"
