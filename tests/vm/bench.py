"""A stage on vcan0 for the tests: its file, its drive, and what they ask of both."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.drives.drive import Canopen
from stagectl.drives.virtual.inject import ask as inject
from stagectl.drives.virtual.inject import socket_path
from tests.vm.traced import FIELDS

ROOT = Path(__file__).parents[2]  # the guest does without tests/conftest.py, which takes long to import there
CONFIG = ROOT / "config"
GUEST = os.environ.get("STAGECTL_VM") == "1"  # set by tools/vm
INTERFACE, CHANNEL, NODE = "socketcan", "vcan0", 5
# Of a real drive, at 500 Hz: its time-outs a few periods long, ten late cycles, a machine that is not as new each time.
REAL = {
    "interface": INTERFACE,
    "channel": CHANNEL,
    "period": "2 ms",
    "bandwidth": "10 Hz",
    "acceleration": "1 m/s^2",  # 5 would be over in three periods
    "heartbeat": "20 ms",
    "heartbeat_timeout": "100 ms",
    "rpdo_timeout": "20 ms",
    "feedback_timeout": "10 ms",
    "following_error": "0.5 mm",  # a quarter of the bandwidth lets it go farther
    "late_limit": "10",
    "reset": "none",
    "clock": "wall",
    "substeps": "2",
}
NOTICED = 0.1  # s, the longest of these time-outs


def stage_file(folder: Path, name: str = "stage", **changes: str) -> Path:
    """Stage A on vcan0 with the figures of a real drive, and other `changes`."""
    text = (CONFIG / "ball-screw.yaml").read_text()
    for key, value in {**REAL, **changes}.items():
        text, count = re.subn(rf"(?m)^(  +{key}:) [^#\n]*", rf"\1 {value} ", text)
        if not count:  # the shipped file leaves it to its default, or to the free distance
            block, indent = ("realtime:", "  ") if key == "late_limit" else ("    kind: canopen", "    ")
            text, count = re.subn(rf"(?m)^{block}$", f"{block}\n{indent}{key}: {value}", text)
        assert count == 1, key
    path = folder / f"{name}.yaml"
    path.write_text(text.replace("eds: drives/", f"eds: {CONFIG / 'drives'}/"))
    return path


class Traced:
    """The drive of `tests.vm.traced` as a process."""

    def __init__(self, stage: Path, folder: Path) -> None:
        self.door, self._folder = socket_path(INTERFACE, CHANNEL, NODE), folder
        self.log = folder / "drive.txt"
        with self.log.open("w") as log:
            command = [sys.executable, "-m", "tests.vm.traced", str(stage)]
            self.process = subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=log)
        wait(lambda: "process" in self.log.read_text() or self.process.poll() is not None, 60.0)
        assert self.process.poll() is None, self.log.read_text()

    def fault(self, block: Any) -> float:
        """Let a fault begin; when it began (s, monotonic)."""
        begun: float = inject(self.door, {"do": "add", "fault": block._asdict()})["begun"]
        return begun

    def clear(self) -> None:
        inject(self.door, {"do": "clear"})

    def trace(self) -> NDArray[Any]:
        """What the axis did since the last time, fields of `FIELDS`."""
        path = self._folder / "trace"
        inject(self.door, {"do": "trace", "file": str(path)})
        rows: NDArray[Any] = np.fromfile(path, dtype=[(name, "<f8") for name in FIELDS])
        return rows

    def end(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@contextlib.contextmanager
def traced(stage: Path, folder: Path) -> Iterator[Traced]:
    """The drive while the test lasts."""
    drive = Traced(stage, folder)
    try:
        yield drive
    finally:
        drive.end()


def wait(wanted: Any, seconds: float, step: float = 0.02) -> None:
    """Until `wanted()` is true."""
    end = time.monotonic() + seconds
    while not wanted():
        assert time.monotonic() < end, "waited too long"
        time.sleep(step)


def settings(setup: Any) -> Canopen:
    """Of the stage's wire."""
    wire = setup.file.drive.wire
    assert isinstance(wire, Canopen)
    return wire


def keep(name: str, figures: dict[str, float]) -> None:
    """A line of figures for whoever reads the results."""
    line = f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in figures.items())
    print(line)
    if GUEST:
        with open("/var/tmp/results/figures.txt", "a") as file:
            file.write(line + "\n")
