"""The installed service, as its user, systemd and the journal see it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stagectl.web.client import SYSTEM, ask
from tests.vm.bench import ROOT

UNIT = "stagectl.service"
STATE = Path("/var/lib/stagectl")
PORT = "127.0.0.1:8402"
LOOP, BOX = "stagectl.realtime.axes", "stagectl.service.black_box"


def said(*command: str) -> str:
    """Standard output of a command that must succeed."""
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, (command, done.stdout, done.stderr)
    return done.stdout


class Installed:
    """The unit on this machine."""

    def __init__(self, stage: Path) -> None:
        self.stage = stage

    def verb(self, *words: str) -> str:
        """A verb of ours, as its user types it."""
        return said(sys.executable, "-m", "stagectl", *words)

    def ask(self, method: str, what: str, **body: Any) -> Any:
        return ask(SYSTEM, method, f"/v1/{what}", body or None)

    def axis(self) -> dict[str, Any]:
        (shown,) = self.ask("GET", "status")["axes"]
        return dict(shown)

    def faults(self) -> list[str]:
        return [entry["fault"] for entry in self.ask("GET", "faults")]

    def until(self, wanted: Callable[[dict[str, Any]], bool], seconds: float = 60.0) -> dict[str, Any]:
        """Wait for the axis to be as `wanted`; the service may be starting meanwhile."""
        end, axis = time.monotonic() + seconds, dict[str, Any]()
        while time.monotonic() < end:
            with contextlib.suppress(Exception):
                axis = self.axis()
                if wanted(axis):
                    return axis
            time.sleep(0.05)
        raise AssertionError((axis, self.journal()[-20:]))

    def ready(self) -> None:
        """Without power, whatever was before."""
        self.until(lambda axis: axis["state"] not in ("connecting", "quick stopping", "coasting"))
        if self.axis()["state"] in ("fault", "offline"):
            self.ask("POST", "faults/reset")
        if self.axis()["state"] != "disabled":
            self.ask("POST", "disable")

    def moving(self, speed: float) -> None:
        """On its way to the farther end of the travel, at `speed` (m/s)."""
        self.ready()
        self.ask("POST", "enable")
        self.confirm_home()
        end = -40 if self.axis()["position"] > 0.0 else 40
        self.ask("POST", "move", to={"axis": f"{end} mm"}, speed=f"{speed * 1e3:g} mm/s", wait=False)
        self.until(lambda axis: axis["state"] == "moving")
        time.sleep(0.15)  # past the acceleration

    def confirm_home(self) -> None:
        """An axis that went on while nobody looked has lost its home: confirm where it stands, as a person would."""
        if not self.axis()["homed"]:
            self.ask("POST", "home")

    def shows(self, name: str) -> str:
        """A property of the unit."""
        return said("systemctl", "show", "--property", name, "--value", UNIT).strip()

    def journal(self) -> list[str]:
        """Messages of the unit."""
        lines = said("journalctl", "--unit", UNIT, "--no-pager", "-o", "json").splitlines()
        return [str(json.loads(line)["MESSAGE"]) for line in lines]

    def process(self, module: str = "") -> int:
        """Process id of the service, or of its child that runs this module."""
        main = int(self.shows("MainPID"))
        if not module:
            return main
        tasks = Path(f"/proc/{main}/task")
        children = [int(path) for task in tasks.iterdir() for path in (task / "children").read_text().split()]
        return next(pid for pid in children if module.encode() in Path(f"/proc/{pid}/cmdline").read_bytes())

    def kill(self, module: str = "", number: int = signal.SIGKILL) -> float:
        """Send a signal; when (s, monotonic)."""
        process = self.process(module)
        began = time.monotonic()
        os.kill(process, number)
        return began

    def boxes(self) -> set[Path]:
        return set((STATE / "blackbox").rglob("*.h5"))
