"""A virtual drive and a service as processes, and what a test asks of them."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from stagectl.web.client import ask
from tests.conftest import CONFIG, ROOT, child_of, movable

STAGE = CONFIG / "ball-screw.yaml"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


def within(seconds: float, true: Callable[[], bool]) -> bool:
    """Whether something comes true in that time."""
    end = time.monotonic() + seconds
    while not (now := true()) and time.monotonic() < end:
        time.sleep(0.05)
    return now


def lasting(folder: Path, name: str = "stage", source: Path = STAGE, **changes: str) -> Path:
    """A stage file whose machine outlasts its service, with other `changes` of its text."""
    text = movable(source.read_text())
    text = text.replace("reset: node", "reset: none")  # a machine is not as new after each restart of its service
    for old, new in changes.items():
        text = re.sub(rf"(?m)^(  +{old}:) [^#\n]*", rf"\1 {new} ", text)
    path = folder / f"{name}.yaml"
    path.write_text(text)
    return path


class Served:
    """A service in `folder`, with its virtual drive."""

    def __init__(self, folder: Path, *arguments: str, stages: tuple[str, ...] = ()) -> None:
        self.folder, self.arguments = folder, arguments
        self.stage = lasting(folder)
        self.stages = stages or (str(self.stage),)
        self.socket = folder / "control.sock"
        self.temporary = folder / "temporary"  # its own: what it leaves there is not another's
        self.process: subprocess.Popen[str] | None = None
        self.drive: subprocess.Popen[str] | None = None

    def start_drive(self) -> None:
        words = ["virtual-drive", str(self.stage), "--channel", str(self.folder / "bus")]
        self._said = self.folder / f"drive-{time.monotonic_ns()}.log"
        with self._said.open("w") as log:
            self.drive = subprocess.Popen(
                [sys.executable, "-u", "-m", "stagectl", *words], cwd=ROOT, stdout=log, text=True
            )
        self._heard = 0
        assert self.drive_says().startswith("virtual drive")

    def kill_drive(self) -> None:
        assert self.drive is not None
        self.drive.kill()
        self.drive.wait(timeout=60)

    @property
    def command(self) -> list[str]:
        """What starts the service."""
        words = [sys.executable, "-m", "stagectl", "serve", *self.stages, "--socket", str(self.socket)]
        return [*words, "--state", str(self.folder / "state"), "--channel", str(self.folder / "bus"), *self.arguments]

    def start(self, woken: Callable[[], object] = lambda: None) -> None:
        """Start the service; `woken` is called until it answers."""
        self.temporary.mkdir(exist_ok=True)
        surroundings = {**os.environ, "TMPDIR": str(self.temporary)}
        with (self.folder / "log").open("a") as log:
            self.process = subprocess.Popen(
                self.command, cwd=ROOT, stderr=log, text=True, start_new_session=True, env=surroundings
            )
        end = time.monotonic() + 300.0  # the machine is shared
        while time.monotonic() < end:
            with contextlib.suppress(Exception):
                woken()
                self.axis()
                return
            assert self.process.poll() is None, self.log
            time.sleep(0.05)
        raise AssertionError(self.log)

    @property
    def log(self) -> str:
        return (self.folder / "log").read_text()

    def ask(self, method: str, what: str, **body: Any) -> Any:
        return ask(self.socket, method, f"/v1/{what}", body or None)

    def axis(self, name: str = "") -> dict[str, Any]:
        axes = self.ask("GET", "status")["axes"]
        row: dict[str, Any] = next(axis for axis in axes if name in ("", axis["axis"]))
        return row

    def heard(self, name: str = "") -> dict[str, Any]:
        """As `axis`, once its loop was heard: on a busy computer it is sometimes silent, and no figure is known."""
        return self.until(lambda axis: axis["position"] is not None, name=name)

    def faults(self) -> list[str]:
        return [entry["fault"] for entry in self.ask("GET", "faults")]

    def until(self, wanted: Callable[[dict[str, Any]], bool], seconds: float = 120.0, name: str = "") -> dict[str, Any]:
        end, axis = time.monotonic() + seconds, dict[str, Any]()
        while time.monotonic() < end:
            with contextlib.suppress(Exception):  # it may be starting again
                axis = self.axis(name)
                if wanted(axis):
                    return axis
            time.sleep(0.02)
        raise AssertionError((axis, self.log))

    def child(self, module: str) -> int:
        """Process id of the service's child that runs this module."""
        assert self.process is not None
        process = child_of(self.process.pid, module)
        assert process is not None, (module, self.log)
        return process

    def next_child(self, module: str, before: int) -> int:
        """Process id of the child that runs this module, once it is another than `before`."""
        assert self.process is not None
        parent = self.process.pid
        assert within(60.0, lambda: child_of(parent, module) not in (None, before)), self.log
        return self.child(module)

    def kill(self, module: str = "") -> None:
        """Signal 9 to a child, or to the service itself."""
        assert self.process is not None
        os.kill(self.child(module) if module else self.process.pid, signal.SIGKILL)
        if not module:
            self.process.wait(timeout=60)

    def descriptors(self) -> list[str]:
        """What the service holds open, but for those who ask and for files."""
        assert self.process is not None
        targets = []
        for path in Path(f"/proc/{self.process.pid}/fd").iterdir():
            with contextlib.suppress(FileNotFoundError):
                targets.append(os.readlink(path).partition(":")[0])
        return sorted(target for target in targets if target in ("pipe", "/memfd"))

    def holds_no_more_than(self, held: list[str]) -> bool:
        """Whether it comes back to that, within 10 s."""
        return within(10.0, lambda: self.descriptors() == held)

    def boxes(self) -> list[Path]:
        return sorted((self.folder / "state" / "blackbox").rglob("*.h5"))

    def begin_moving(self, speed: str = "5 mm/s") -> None:
        if self.axis()["state"] in ("fault", "offline"):
            self.ask("POST", "faults/reset")
        self.ask("POST", "enable")
        if not self.ask("GET", "status")["axes"][0]["homed"]:  # its drive was reset by an earlier test
            self.ask("POST", "home")
        self.ask("POST", "move", by={"axis": "20 mm"}, speed=speed, wait=False)
        self.until(lambda axis: axis["state"] == "moving" and axis["progress"] > 0.1)

    def drive_says(self, seconds: float = 300.0) -> str:
        """The virtual drive's next line; it must come within so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            *whole, _ = self._said.read_text().split("\n")
            if len(whole) > self._heard:
                self._heard += 1
                return whole[self._heard - 1]
            time.sleep(0.02)
        raise AssertionError((self._said.read_text(), self.log))

    def end(self) -> None:
        for process in (self.process, self.drive):
            if process is not None:
                process.terminate()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(timeout=60)
                process.kill()
                process.wait()


@contextlib.contextmanager
def served(folder: Path, *arguments: str) -> Iterator[Served]:
    """A drive and a service that has found it."""
    machine = Served(folder, *arguments)
    try:
        machine.start_drive()
        machine.start()
        yield machine
    finally:
        machine.end()
