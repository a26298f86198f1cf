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
_GATE = """
import os, sys
if "stagectl.realtime.axes" in sys.orig_argv and os.path.exists({gate!r}):
    open({gate!r}).close()  # a pipe: it waits for whoever opens the other end
"""


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


@pytest.mark.parametrize(("moment", "number"), [*zip(MOMENTS, (signal.SIGINT, signal.SIGTERM) * 2, strict=True)])
def test_a_signal_that_comes_early(tmp_path: Path, moment: str, number: int) -> None:
    """It has no drive on its bus: it starts one, which has to leave with it.

    The signals are held back and let through as one: each moment sees one of them, and each of them two moments.
    """
    with begun(tmp_path, moment) as (machine, process):
        process.send_signal(number)
        assert process.wait(PATIENCE) == 0, machine.log
    assert "stopped: all processes have ended" in machine.log and "Traceback" not in machine.log
    assert not machine.socket.exists() and not (tmp_path / "state" / "running").exists()
    assert within(PATIENCE, lambda: processes(tmp_path) == []), processes(tmp_path)


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a pipe stops each real-time process before its first line, however fast the machine is."""
    early, pipe = tmp_path / "early", tmp_path / "gate"
    early.mkdir()
    (early / "sitecustomize.py").write_text(_GATE.format(gate=str(pipe)))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(early), os.environ.get("PYTHONPATH", "")]))
    return pipe


@pytest.fixture
def machine(tmp_path: Path, gate: Path) -> Iterator[Served]:
    with served(tmp_path) as service:
        yield service


def test_it_answers_while_its_real_time_process_is_restarted(machine: Served, gate: Path) -> None:
    """The new process is stopped at its start: who asks is answered before it goes on, then it comes up."""
    machine.begin_moving()
    dead = loop_of(machine)
    os.mkfifo(gate)
    machine.kill("stagectl.realtime.axes")
    machine.until(lambda axis: axis["state"] == "connecting")
    assert within(PATIENCE, lambda: loop_of(machine) not in (None, dead))
    for _ in range(10):
        status = machine.ask("GET", "status")
        (axis,) = status["axes"]
        assert axis["state"] == "connecting" and not status["alive"]
        assert axis["state_words"].startswith("restarting") and axis["speed"] is None
    with pytest.raises(RefusedError, match="is starting"):
        machine.ask("POST", "enable")
    gate.open("w").close()
    gate.unlink()
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
