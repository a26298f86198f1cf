"""A service that is told to leave before it is there, and one that is asked while it restarts its real-time process."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from stagectl.web.client import RefusedError
from tests.conftest import ROOT, child_of
from tests.service.serving import Served, served, within

PATIENCE = 300.0  # s: the machine is shared
ANSWER = 5.0  # s for a status, on a machine that is busy; a new process is held up for as long as it takes


def processes(folder: Path) -> list[str]:
    """Command lines of all processes that have to do with this folder."""
    pids = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            pids.append(path.read_bytes().replace(b"\0", b" ").decode())
    return [words for words in pids if str(folder) in words]


def held_back(machine: Served) -> bool:
    """Whether a signal to leave would wait: from then on no end is but the orderly one."""
    assert machine.process is not None
    status = Path(f"/proc/{machine.process.pid}/status").read_text()
    blocked = int(status.split("SigBlk:")[1].split()[0], 16)
    return bool(blocked >> (signal.SIGTERM - 1) & 1)


def loop_of(machine: Served) -> int | None:
    assert machine.process is not None
    return child_of(machine.process.pid, "stagectl.realtime.axes")


MOMENTS: dict[str, Callable[[Served], bool]] = {
    "it loads": held_back,
    "it has its socket": lambda machine: machine.socket.exists(),
    "it has started a drive": lambda machine: "starting a virtual one" in machine.log,
    "its processes start": lambda machine: loop_of(machine) is not None,
}


@contextlib.contextmanager
def begun(folder: Path, moment: str) -> Iterator[tuple[Served, subprocess.Popen[str]]]:
    """A service that has come to this moment of its start."""
    machine = Served(folder)
    command = machine.command
    with (folder / "log").open("w") as log, subprocess.Popen(command, cwd=ROOT, stderr=log, text=True) as process:
        machine.process = process
        end = time.monotonic() + PATIENCE
        try:
            while not MOMENTS[moment](machine):
                assert process.poll() is None and time.monotonic() < end, machine.log
                time.sleep(0.001)
            yield machine, process
        finally:
            process.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_signal_that_comes_early(tmp_path: Path, moment: str, number: int) -> None:
    """It has no drive on its bus: it starts one, which has to leave with it."""
    with begun(tmp_path, moment) as (machine, process):
        process.send_signal(number)
        assert process.wait(PATIENCE) == 0, machine.log
    assert "stopped: all processes have ended" in machine.log and "Traceback" not in machine.log
    assert not machine.socket.exists() and not (tmp_path / "state" / "running").exists()
    assert within(PATIENCE, lambda: processes(tmp_path) == []), processes(tmp_path)


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Served]:
    with served(tmp_path) as service:
        yield service


def test_it_answers_while_its_real_time_process_is_restarted(machine: Served) -> None:
    """The new process is stopped over its start: who asks is answered all the same, then it comes up."""
    machine.begin_moving()
    dead = loop_of(machine)
    machine.kill("stagectl.realtime.axes")
    machine.until(lambda axis: axis["state"] == "connecting")
    assert within(PATIENCE, lambda: loop_of(machine) not in (None, dead))
    new = machine.child("stagectl.realtime.axes")
    os.kill(new, signal.SIGSTOP)
    try:
        for _ in range(10):
            began = time.monotonic()
            status = machine.ask("GET", "status")
            assert time.monotonic() - began < ANSWER
            (axis,) = status["axes"]
            assert axis["state"] == "connecting" and not status["alive"]
            assert axis["state_words"].startswith("restarting") and axis["speed"] == 0.0
        with pytest.raises(RefusedError, match="is starting"):
            machine.ask("POST", "enable")
    finally:
        os.kill(new, signal.SIGCONT)
    assert machine.until(lambda axis: axis["state"] == "disabled")["state_words"] == "without power"
    assert machine.faults() == ["process_died"]
    machine.begin_moving()
    assert machine.process is not None
    machine.process.send_signal(signal.SIGTERM)
    assert machine.process.wait(PATIENCE) == 0, machine.log


@pytest.mark.parametrize("moment", ["it has started a drive", "its processes start"])
def test_killed_while_its_processes_start(tmp_path: Path, moment: str) -> None:
    """None of them outlives it, though the kernel tells only those that have asked it to by then."""
    with begun(tmp_path, moment):
        pass  # leaving it kills it
    assert within(PATIENCE, lambda: processes(tmp_path) == []), processes(tmp_path)
