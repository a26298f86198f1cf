"""The service under a real systemd: installed, watched, killed, explained in the journal, removed."""

from __future__ import annotations

import contextlib
import http.client
import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from stagectl.recording.hdf5 import open_recording
from stagectl.service.install import PLACES, QUEUE, SOCKET
from stagectl.web.client import SYSTEM, RefusedError
from tests.vm.bench import CHANNEL, NOTICED, Traced, keep
from tests.vm.installed import BOX, LOOP, PORT, UNIT, Installed, said

MOST_EXPOSED = 1.5  # what `systemd-analyze security` may say of a unit for SocketCAN with a TCP port (issue 19)
WATCHDOG = 5.0  # s, of the unit
SPEED = 0.03  # m/s


def test_one_command_installs_a_service_that_runs(machine: Installed) -> None:
    machine.ready()  # whatever other tests have done to it
    assert machine.shows("ActiveState") == "active"
    assert machine.shows("Type") == "notify"
    assert machine.shows("UnitFileState") == "enabled"
    assert "axis" in machine.shows("StatusText")
    assert machine.axis()["state"] == "disabled"
    status = Path(f"/proc/{machine.process(LOOP)}/status").read_text()
    assert re.search(r"(?m)^Uid:\s+[1-9]", status)  # not root
    assert re.search(r"(?m)^CapEff:\s+0+$", status)
    assert re.search(r"(?m)^NoNewPrivs:\s+1$", status)
    assert int(re.findall(r"(?m)^VmLck:\s+(\d+)", status)[0]) > 10_000  # kB: mlockall
    assert "policy: SCHED_FIFO" in said("chrt", "--pid", str(machine.process(LOOP))).replace("scheduling ", "")
    assert SYSTEM.stat().st_mode & 0o777 == 0o660 and SYSTEM.group() == "stagectl"


def test_systemd_rates_the_running_unit_as_hardened(machine: Installed) -> None:
    match = re.search(r"Overall exposure level for \S+: ([\d.]+)", said("systemd-analyze", "security", UNIT))
    assert match is not None
    keep("exposure", {"systemd-analyze security": float(match[1])})
    assert 0.5 < float(match[1]) <= MOST_EXPOSED
    for unit in (UNIT, SOCKET):
        said("systemd-analyze", "verify", f"/{PLACES[unit]}")


def test_the_interface_has_our_network_file_and_queue(machine: Installed) -> None:
    """vcan has no bit rate and no bus-off; that our files are the ones taken, and the queue, can be seen on it."""
    shown = said("networkctl", "status", CHANNEL, "--no-pager")
    assert f"/{PLACES['80-stagectl-can.network']}" in shown, shown
    assert "Type: can" in shown
    link = said("udevadm", "test-builtin", "net_setup_link", f"/sys/class/net/{CHANNEL}")
    assert f"ID_NET_LINK_FILE=/{PLACES['80-stagectl-can.link']}" in link, link
    assert Path(f"/sys/class/net/{CHANNEL}/tx_queue_len").read_text().strip() == str(QUEUE)
    assert machine.axis()["state"] != "offline"


def test_the_latency_request_belongs_to_the_group(machine: Installed) -> None:
    device = Path("/dev/cpu_dma_latency")
    assert device.group() == "stagectl" and device.stat().st_mode & 0o777 == 0o660
    assert not [line for line in machine.journal() if "cpu_dma_latency" in line]


def test_it_moves(machine: Installed, drive: Traced) -> None:
    machine.ready()
    machine.verb("enable")
    machine.confirm_home()
    late = machine.axis()["late_cycles"]  # those of the start
    machine.ask("POST", "move", by={"axis": "2 mm"}, speed="20 mm/s")
    machine.until(lambda axis: axis["in_position"])
    before = drive.trace()["position"][-1]
    machine.ask("POST", "move", by={"axis": "-2 mm"}, speed="20 mm/s")
    after = drive.trace()["position"][-1]
    assert (before - after) * 12e-3 / (2.0 * np.pi) == pytest.approx(2e-3, abs=1e-6)
    assert machine.axis()["late_cycles"] == late
    machine.ask("POST", "disable")


def _stop_time(drive: Traced, began: float) -> float:
    """From then to standstill (s); the axis must have moved, and be without power at the end."""
    trace = drive.trace()
    after = trace[trace["time"] >= began]
    moves = after["time"][np.abs(after["velocity"]) > 0.3]
    assert len(moves) and after["powered"][-1] == 0.0
    return float(moves[-1] - began)


@pytest.mark.parametrize(("victim", "fault", "least"), [(LOOP, "process_died", 0.01), ("", "service_died", 0.0)])
def test_killed_in_mid_motion(machine: Installed, drive: Traced, victim: str, fault: str, least: float) -> None:
    """The drive stops by its own time-out, or by the loop that sees its parent die; power comes back only on demand."""
    machine.moving(SPEED)
    drive.trace()
    boxes, process = machine.boxes(), machine.process(victim)
    began = machine.kill(victim)
    time.sleep(NOTICED + 0.2)
    took = _stop_time(drive, began)
    keep(f"killed {victim or 'service'}", {"ms": 1e3 * took})
    assert least < took <= NOTICED + 0.1
    machine.until(lambda axis: axis["state"] == "disabled" and fault in machine.faults())
    assert machine.process(victim) != process
    assert [line for line in machine.journal() if "died" in line]
    (kept,) = machine.boxes() - boxes
    assert np.all(np.diff(open_recording(kept).samples["time"]) > 0.0)
    with pytest.raises(RefusedError, match="without power"):
        machine.ask("POST", "move", by={"axis": "1 mm"})


def test_the_black_box_killed(machine: Installed) -> None:
    machine.moving(SPEED)
    machine.kill(BOX)
    machine.until(lambda axis: "blackbox_died" in machine.faults())
    assert machine.axis()["state"] == "moving"  # the axis goes its way
    machine.ask("POST", "stop")


def test_the_drive_stops_by_its_own_time_out_and_says_so(machine: Installed, drive: Traced) -> None:
    assert re.search(r"no (heartbeat|cyclic command).*time-out", drive.log.read_text())


def test_a_hung_loop_is_restarted_by_the_watchdog(machine: Installed, drive: Traced) -> None:
    """The service itself is lively all the while: what counts is the loop's sign of life."""
    machine.moving(SPEED)
    drive.trace()
    restarts, process = int(machine.shows("NRestarts")), machine.process()
    began = machine.kill(LOOP, signal.SIGSTOP)
    time.sleep(NOTICED + 0.2)
    assert _stop_time(drive, began) <= NOTICED + 0.1
    end = time.monotonic() + 6.0 * WATCHDOG
    while int(machine.shows("NRestarts")) == restarts and time.monotonic() < end:
        time.sleep(0.2)
    took = time.monotonic() - began
    keep("watchdog", {"s from the hang to the restart": took})
    assert int(machine.shows("NRestarts")) == restarts + 1
    assert 0.5 * WATCHDOG < took < 4.0 * WATCHDOG
    machine.until(lambda axis: axis["state"] == "disabled")
    assert machine.process() != process
    said_by_systemd = said("journalctl", "--no-pager", "-o", "cat", "_PID=1", "--unit", UNIT)
    assert "Watchdog timeout" in said_by_systemd, said_by_systemd[-500:]


@pytest.mark.parametrize("jump", ["+400 days", "-400 days"])
def test_a_jump_of_the_clock_moves_nothing(machine: Installed, jump: str) -> None:
    """Everything that waits or watches goes by the monotonic clock; the time of day is only shown."""
    machine.moving(SPEED)
    before, known, process = machine.axis(), len(machine.faults()), machine.process(LOOP)
    now = time.time()
    said("date", "--set", f"now {jump}")
    try:
        time.sleep(0.3)
        after = machine.axis()
        assert after["state"] == "moving" and after["progress"] > before["progress"]
        machine.ask("POST", "stop")
        machine.until(lambda axis: axis["state"] == "standing")
        assert len(machine.faults()) == known and machine.process(LOOP) == process
    finally:
        said("date", "--set", f"@{now:.0f}")
    machine.ask("POST", "disable")


def test_what_happened_is_in_the_journal_in_words(machine: Installed, drive: Traced) -> None:
    from stagectl.drives.faults import default

    machine.moving(SPEED)
    drive.fault(default("drive-fault"))
    machine.until(lambda axis: axis["state"] == "fault")
    drive.clear()
    words = machine.ask("GET", "faults")[-1]["words"]
    assert len(words) > 20
    assert [line for line in machine.journal() if words.split(";")[0] in line], (words, machine.journal()[-5:])
    assert not [line for line in machine.journal() if "Traceback" in line]
    machine.ask("POST", "faults/reset")  # by a person alone: a service that starts again finds it


def test_systemd_opens_the_port_and_closes_it_with_the_service(machine: Installed) -> None:
    def answers() -> bool:
        with contextlib.closing(http.client.HTTPConnection(PORT, timeout=30)) as link:
            with contextlib.suppress(ConnectionError):  # refused, or reset where the port closes just then
                link.request("GET", "/v1/status")
                return link.getresponse().status == 401
            return False

    assert answers()
    said("systemctl", "stop", UNIT)
    assert not answers()
    said("systemctl", "start", UNIT)
    assert answers()
    machine.until(lambda axis: axis["state"] == "disabled")


def test_one_command_removes_it_and_leaves_the_recordings(machine: Installed) -> None:
    boxes = machine.boxes()
    assert boxes
    machine.verb("service", "remove")
    assert machine.shows("LoadState") == "not-found"
    assert not [place for place in PLACES.values() if Path(f"/{place}").exists()]
    assert not SYSTEM.exists()
    assert boxes <= machine.boxes()  # one may have been written meanwhile
