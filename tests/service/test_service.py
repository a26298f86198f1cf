"""The service as processes: orders over its socket, and what happens when one of the processes is killed."""

from __future__ import annotations

import http.client
import os
import re
import signal
import stat
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from stagectl.drives.bus.embedded import Embedded
from stagectl.drives.bus.frames import frame
from stagectl.drives.virtual import inject
from stagectl.realtime.states import State
from stagectl.recording.hdf5 import open_recording
from stagectl.service.virtual_timeouts import HELD_UP
from stagectl.web.client import ControlError, RefusedError, ask, stop
from tests.conftest import CONFIG, ROOT, Command
from tests.service.serving import Served, free_port, served, within

PORT = free_port()
MOST_MEMORY = 80 * 1024  # KiB, of the real-time process


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("served"), "--tcp", f"127.0.0.1:{PORT}") as service:
        yield service


@pytest.fixture(autouse=True)
def disabled(machine: Served) -> None:
    """Each test begins without power."""
    machine.until(lambda axis: axis["state"] != "connecting")
    if machine.axis()["state"] in ("fault", "offline"):
        machine.ask("POST", "faults/reset")
    if machine.axis()["state"] != "disabled":
        machine.ask("POST", "disable")


def test_from_power_to_a_position_and_back(machine: Served, command: Command) -> None:
    assert machine.heard()["state"] == "disabled"
    with pytest.raises(RefusedError, match="state disabled"):
        machine.ask("POST", "move", to={"axis": "2 mm"})
    assert command("enable", "--socket", machine.socket)[0] == 0
    code, out, err = command("move", "2 mm", "--socket", machine.socket, "--json", "-")
    assert code == 0, err
    assert '"state": "standing"' in out
    axis = machine.heard()
    assert axis["position"] == pytest.approx(2e-3, abs=3e-7)
    assert axis["in_position"]
    assert command("move", "--by", "--socket", machine.socket, "--", "-1 mm")[0] == 0
    assert machine.heard()["position"] == pytest.approx(1e-3, abs=3e-7)
    code, _, err = command("move", "60 mm", "--socket", machine.socket)
    assert code in (1, 2)
    assert "limits.travel" in err
    code, _, err = command("move", "2 kg", "--socket", machine.socket)
    assert code == 1
    assert "does not measure" in err
    assert command("follow", CONFIG / "trajectories" / "sine-2um.yaml", "--socket", machine.socket)[0] == 0
    assert command("disable", "--socket", machine.socket)[0] == 0
    assert command("status", "--socket", machine.socket)[0] == 0


def test_a_stop_comes_through_while_it_moves_and_gains_change_meanwhile(machine: Served) -> None:
    machine.begin_moving()
    machine.ask("PATCH", "parameters", control={"bandwidth": "30 Hz"})
    assert machine.ask("GET", "parameters")["axis"]["bandwidth"] == 30.0
    with pytest.raises(RefusedError, match=r"(?s)margin"):
        machine.ask("PATCH", "parameters", control={"bandwidth": "300 Hz"})
    with pytest.raises(RefusedError, match="cannot be changed"):
        machine.ask("PATCH", "parameters", control={"period": "1 ms"})
    assert machine.ask("POST", "stop")["axes"][0]["state"] == "standing"
    assert machine.axis()["fault"] == ""


def test_who_may_do_what(machine: Served, tmp_path: Path) -> None:
    assert stat.S_IMODE(machine.socket.stat().st_mode) == 0o660
    token = machine.folder / "state" / "token"
    assert stat.S_IMODE(token.stat().st_mode) == 0o600

    def asked(method: str, header: dict[str, str]) -> int:
        link = http.client.HTTPConnection("127.0.0.1", PORT, timeout=10)
        link.request(method, "/v1/status" if method == "GET" else "/v1/enable", headers=header)
        status = link.getresponse().status
        link.close()
        return status

    right = {"Authorization": f"Bearer {token.read_text().strip()}"}
    assert asked("GET", {}) == 401
    assert asked("GET", {"Authorization": "Bearer " + "x" * 43}) == 401
    assert asked("GET", right) == 200
    assert asked("POST", right) == 403
    assert machine.heard()["state"] == "disabled"
    with pytest.raises(ControlError, match="no service answers"):
        ask(tmp_path / "nowhere.sock", "GET", "/v1/status")


def test_the_interface_describes_itself_and_refuses_what_it_does_not_know(machine: Served) -> None:
    document = ask(machine.socket, "GET", "/openapi.json")
    verbs = {
        "enable",
        "disable",
        "home",
        "stop",
        "quick-stop",
        "faults/reset",
        "move",
        "trajectory",
        "status",
        "faults",
    }
    assert {f"/v1/{verb}" for verb in verbs} <= set(document["paths"])
    for what, body in (("move", {"to": {"axis": 3}}), ("move", {"speed": "1"}), ("trajectory", {"yaml": "type: none"})):
        with pytest.raises(RefusedError):
            ask(machine.socket, "POST", f"/v1/{what}", body)
    with pytest.raises(RefusedError, match="axis q;"):
        machine.ask("POST", "enable?axis=q")


def test_the_real_time_process_is_small_and_alone(machine: Served) -> None:
    status = Path(f"/proc/{machine.child('stagectl.realtime.axes')}/status").read_text()
    fields = dict(re.findall(r"(?m)^(\w+):\s+(\d+)", status))
    assert int(fields["VmRSS"]) < MOST_MEMORY
    assert fields["Threads"] == "1"
    mapped = Path(f"/proc/{machine.child('stagectl.realtime.axes')}/maps").read_text()
    assert not [heavy for heavy in ("numba", "llvmlite", "scipy", "numpy", "h5py") if f"/{heavy}/" in mapped]


def test_the_real_time_process_killed(machine: Served) -> None:
    """The drive stops by itself; the service comes back without power, says why, and has the black box."""
    machine.begin_moving()
    boxes, held = machine.boxes(), machine.descriptors()
    machine.kill("stagectl.realtime.axes")
    began = time.monotonic()
    assert machine.until(lambda axis: axis["state"] != "moving")["state"] == "connecting"
    assert time.monotonic() - began < HELD_UP  # nothing pretends to move until the new one is there
    with pytest.raises(ControlError, match=r"time-outs.*press the emergency stop"):  # a stop finds nobody meanwhile
        stop(machine.socket, quick=False, axis="")
    # By its time-out, or sooner: the new process configures it, and takes it out of operation for that.
    assert re.match(r"no (heartbeat|cyclic command)|taken out of operation", machine.drive_says())
    assert machine.drive_says().startswith("stands after ")
    machine.until(lambda axis: axis["state"] == "disabled")
    assert machine.faults()[-1] == "process_died"
    (kept,) = sorted(set(machine.boxes()) - set(boxes))
    rows = open_recording(kept).samples
    assert rows["state"][-1] == State.MOVING
    assert np.all(np.diff(rows["time"]) > 0.0)
    assert machine.holds_no_more_than(held)  # months of that must not use up the descriptors
    with pytest.raises(RefusedError, match="without power"):
        machine.ask("POST", "move", by={"axis": "1 mm"})


def test_nothing_begins_before_a_stop_is_taken_again(machine: Served) -> None:
    """An order waits for the stop path of the new real-time process, so a stop from before does not end its motion."""
    before = machine.child("stagectl.service.stop_path")  # it ends with the loop
    machine.kill("stagectl.realtime.axes")
    late = machine.next_child("stagectl.service.stop_path", before)
    os.kill(late, signal.SIGSTOP)
    try:
        came = machine.until(lambda axis: axis["state"] != "connecting")["state"]
        with pytest.raises(ControlError):
            stop(machine.socket, quick=False, axis="")
        moving = threading.Thread(target=machine.begin_moving)
        moving.start()
        moving.join(1.0)
        assert machine.axis()["state"] == came
    finally:
        os.kill(late, signal.SIGCONT)
    moving.join(60.0)
    assert machine.heard()["state"] == "moving"


def test_a_stop_path_that_dies_before_it_is_ready_is_replaced(machine: Served) -> None:
    before = machine.child("stagectl.service.stop_path")
    machine.kill("stagectl.realtime.axes")
    late = machine.next_child("stagectl.service.stop_path", before)
    os.kill(late, signal.SIGKILL)
    again = machine.next_child("stagectl.service.stop_path", late)
    machine.until(lambda axis: axis["state"] != "connecting")
    os.kill(again, signal.SIGKILL)
    machine.kill("stagectl.realtime.axes")
    machine.next_child("stagectl.service.stop_path", again)
    machine.until(lambda axis: axis["state"] != "connecting")
    machine.begin_moving()
    assert "stop_path_died" in machine.faults()
    assert stop(machine.socket, quick=False, axis="")["axes"][0]["state"] == "standing"


def test_the_black_box_killed(machine: Served) -> None:
    machine.begin_moving("1 mm/s")  # 20 s: a busy computer may take long to miss the black box
    held = machine.descriptors()
    machine.kill("stagectl.service.black_box")
    within(20.0, lambda: "blackbox_died" in machine.faults())
    assert machine.faults()[-1] == "blackbox_died"
    assert machine.heard()["state"] == "moving"  # the axis goes its way
    assert machine.child("stagectl.service.black_box")
    assert machine.holds_no_more_than(held)


def test_the_service_killed_in_mid_motion(machine: Served) -> None:
    """Its real-time process stops the axis; the next service begins without power and says why."""
    machine.begin_moving()
    boxes = machine.boxes()
    machine.kill()
    machine.start()
    assert machine.heard()["state"] == "disabled"
    assert machine.faults()[0] == "service_died"
    within(60.0, lambda: machine.boxes() != boxes)  # the dead service's black box may still be writing
    (kept,) = [path for path in machine.boxes() if path not in boxes]
    assert "unattended" in kept.name
    recording = open_recording(kept)
    assert recording.meta["blackbox"]["words"].startswith("the service that gives the orders is gone")
    states = recording.samples["state"]
    assert states[recording.meta["blackbox"]["fault_row"] - 400] == State.MOVING
    assert states[-1] in (State.QUICK_STOPPING, State.DISABLED, State.FAULT)


def test_the_drive_killed_and_back(machine: Served) -> None:
    """Feedback is lost, nothing pretends to move; reset finds the new drive; power comes only when it is asked for."""
    machine.begin_moving()
    machine.kill_drive()
    machine.until(lambda axis: axis["state"] == "fault")
    assert machine.faults()[-1] == "feedback_lost"
    assert "Check the wiring" in machine.ask("GET", "faults")[-1]["words"]
    with pytest.raises(RefusedError, match="does not answer"):
        machine.ask("POST", "faults/reset")
    assert machine.axis()["state"] == "offline"
    machine.start_drive()
    assert machine.ask("POST", "faults/reset")["axes"][0]["state"] == "disabled"
    with pytest.raises(RefusedError):
        machine.ask("POST", "move", by={"axis": "1 mm"})
    assert machine.ask("POST", "enable")["axes"][0]["state"] == "standing"


def test_a_drive_that_boots_again_is_configured_anew(machine: Served) -> None:
    machine.begin_moving()
    reboot = {"do": "add", "fault": {"fault": "node-reboot", "duration": 0.1}}
    inject.ask(inject.socket_path("embedded", str(machine.folder / "bus"), 5), reboot)  # as after a dip of its supply
    machine.until(lambda axis: axis["state"] == "fault")
    assert machine.faults()[-1] == "rebooted"
    machine.ask("POST", "faults/reset")  # with a reset of the node: its position begins anew
    machine.ask("POST", "enable")
    machine.ask("POST", "home")
    machine.ask("POST", "move", by={"axis": "1 mm"})


def test_the_nmt_command_of_another_controller_ends_the_motion(machine: Served) -> None:
    """The drive begins at another position then, which is not homed until somebody homes it."""
    machine.begin_moving()
    bus = Embedded(str(machine.folder / "bus"))
    bus.send(frame(0, bytes([0x81, 5])))  # NMT: reset node
    bus.close()
    machine.until(lambda axis: axis["state"] == "fault")
    machine.ask("POST", "faults/reset")
    machine.until(lambda axis: axis["state"] == "disabled" and not axis["homed"])
    machine.ask("POST", "enable")
    machine.ask("POST", "home")
    machine.ask("POST", "move", by={"axis": "1 mm"})


def test_a_second_service_is_refused(machine: Served) -> None:
    before = machine.axis()["cycles"]
    done = subprocess.run(machine.command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "a service listens on" in done.stderr and "Traceback" not in done.stderr
    assert machine.axis()["state"] == "disabled" and machine.axis()["cycles"] > before
