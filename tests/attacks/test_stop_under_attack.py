"""A service under attack, in turn and by all at once, while its axis moves: a stop gets through; nothing is left."""

from __future__ import annotations

import contextlib
import http.client
import os
import resource
import signal
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.service.stop_link import QUICK_STOP, STOP, StopLink, beside
from tests.attacks.attackers import KINDS, attacked
from tests.service.serving import Served, free_port, served, within

PORT = free_port()
ANSWER = 5.0  # s: generous, as the machine is shared; `tools/bench/stops.py` measures
STOPS = 3  # under each attack
PATIENCE = 60.0  # s for what an attack began to be over
RESTING = [
    "stagectl.realtime.axes",
    "stagectl.service.black_box",
    "stagectl.service.planning_process",
    "stagectl.service.stop_path",
]


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("attacked"), "--tcp", f"127.0.0.1:{PORT}") as target:
        target.ask("POST", "recordings", name="prey", before=0.0, seconds=3600.0)
        time.sleep(1.0)
        target.ask("POST", "recordings/end")
        assert within(300.0, lambda: planners(target) == [True]), "the compiled planner has not taken over"
        yield target


@pytest.fixture(scope="module")
def held(machine: Served) -> Counter[str]:
    """What the service holds open before the first attack; between two attacks a planner may be starting anew."""
    return Counter(machine.descriptors())


def _processes(machine: Served) -> Iterator[tuple[Path, str]]:
    """Those of the service in /proc, with the modules that they run."""
    assert machine.process is not None
    (listed,) = Path(f"/proc/{machine.process.pid}/task/{machine.process.pid}").glob("children")
    for child in listed.read_text().split():
        line = _bytes_of(Path(f"/proc/{child}/cmdline")).split(b"\0")
        if len(line) > 3:
            yield Path("/proc", child), line[3].decode()


def planners(machine: Served) -> list[bool]:
    """Of each process that plans, whether its kernels are compiled."""
    there = [place for place, module in _processes(machine) if module == "stagectl.service.planning_process"]
    return [b"STAGECTL_KERNELS=compiled" in _bytes_of(place / "environ") for place in there]


def _bytes_of(path: Path) -> bytes:
    """What /proc says of a process; nothing of one that has ended meanwhile."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return path.read_bytes()
    return b""


def children(machine: Served) -> list[str]:
    """The service's processes by their modules, which do not differ from start to start."""
    return sorted(module for _, module in _processes(machine))


def left_behind(machine: Served) -> list[Path]:
    return sorted(machine.temporary.glob("stagectl-export-*"))


def stopped(machine: Served, what: str) -> float:
    """Give the order as the command line does; time (s) until its answer, which says that the loop has taken it."""
    link = StopLink(beside(machine.socket))
    try:
        began = time.monotonic()
        answer = link.ask(what, "", ANSWER)
        while not answer["heeded"]:
            assert time.monotonic() - began < ANSWER, answer
            answer = link.ask("status", "", ANSWER)
        return time.monotonic() - began
    finally:
        link.close()


def on_the_way(machine: Served) -> None:
    """Moving; the owner's orders go over the control socket, and get through, too."""
    to = "10 mm" if (machine.until(lambda axis: True)["position"] or 0.0) < 0.005 else "0 mm"
    machine.ask("POST", "enable")
    machine.ask("POST", "move", to={"axis": to}, speed="2 mm/s", wait=False)
    machine.until(lambda axis: axis["state"] == "moving")


@pytest.mark.parametrize("kinds", [*((kind,) for kind in KINDS), tuple(KINDS)], ids="-".join)
def test_a_stop_gets_through(machine: Served, held: Counter[str], kinds: tuple[str, ...]) -> None:
    files = left_behind(machine)
    with attacked(machine.folder, PORT, *kinds):
        for number in range(STOPS):
            on_the_way(machine)
            stopped(machine, QUICK_STOP if number % 2 else STOP)
            machine.until(lambda axis: axis["state"] in ("standing", "disabled"))
        assert owner_reads(machine)  # at once with all who have no key
    assert within(PATIENCE, lambda: children(machine) == RESTING), children(machine)
    assert within(PATIENCE, lambda: Counter(machine.descriptors()) == held), (Counter(machine.descriptors()), held)
    assert within(PATIENCE, lambda: left_behind(machine) == files), left_behind(machine)
    assert machine.axis()["faults"] == 0
    assert "Traceback" not in machine.log


def owner_reads(machine: Served) -> bool:
    """Whether the owner gets in over TCP with the key."""

    def answered() -> bool:
        link = http.client.HTTPConnection("127.0.0.1", PORT, timeout=10.0)
        with contextlib.suppress(OSError, http.client.HTTPException), contextlib.closing(link):
            link.request("GET", "/v1/status", headers={"Authorization": f"Bearer {key}"})
            with link.getresponse() as answer:
                return answer.status == 200
        return False

    key = (machine.folder / "state" / "key").read_text().strip()
    return within(PATIENCE, answered)


def test_a_service_that_does_nothing_more_is_no_obstacle(machine: Served) -> None:
    """Stopped by a signal, it answers nobody: the stop path does."""
    assert machine.process is not None
    on_the_way(machine)
    os.kill(machine.process.pid, signal.SIGSTOP)
    try:
        stopped(machine, STOP)
        link = StopLink(beside(machine.socket))
        assert within(30.0, lambda: link.ask("status", "", ANSWER)["axes"][0]["state"] == "standing")
        link.close()
    finally:
        os.kill(machine.process.pid, signal.SIGCONT)


def test_a_loop_that_does_not_answer_is_shown_as_such(machine: Served) -> None:
    on_the_way(machine)
    loop = machine.child("stagectl.realtime.axes")
    os.kill(loop, signal.SIGSTOP)
    try:
        silent = machine.until(lambda axis: axis["state"] == "no_answer", 10.0)
        assert silent["position"] is None and silent["progress"] is None
    finally:
        os.kill(loop, signal.SIGCONT)
    machine.until(lambda axis: axis["state"] != "no_answer")
    stopped(machine, QUICK_STOP)
    machine.until(lambda axis: axis["state"] in ("disabled", "fault"))


def test_a_black_box_waits_for_room_on_the_disk(machine: Served) -> None:
    """Its process may write no file of 64 KiB, and a packed box is larger: as on a disk that is full."""
    box = machine.child("stagectl.service.black_box")
    before, boxes = len(machine.faults()), machine.boxes()
    _, most = resource.prlimit(box, resource.RLIMIT_FSIZE)
    resource.prlimit(box, resource.RLIMIT_FSIZE, (1 << 16, most))
    if machine.axis()["state"] == "fault":
        machine.ask("POST", "faults/reset")
    on_the_way(machine)
    machine.kill_drive()
    assert within(PATIENCE, lambda: "blackbox_waits" in machine.faults()[before:])
    assert machine.boxes() == boxes
    assert within(PATIENCE, lambda: machine.axis()["state"] in ("offline", "fault"))
    resource.prlimit(box, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, most))
    assert within(PATIENCE, lambda: "blackbox_written" in machine.faults()[before:])
    assert len(machine.boxes()) == len(boxes) + 1
    assert "Traceback" not in machine.log
