"""Ctrl-C while a compiled kernel runs: an exception, as anywhere else in Python, and no crash of the process."""

from __future__ import annotations

import os
import subprocess
import sys

from tests.conftest import ROOT, SOURCES

INTERRUPTED = """
import signal
from stagectl.drives.drive import Simulation
from stagectl.drives.simulated import Plant
from tests.drives.workbench import linear_stage
plant = Plant(linear_stage(), Simulation(substeps=4), 1e-3)
plant.drift(1e-3)  # compiled, or read from disk
before = plant.state
signal.signal(signal.SIGALRM, signal.default_int_handler)
plant.simulation = plant.simulation._replace(substeps=5_000_000)
try:
    signal.setitimer(signal.ITIMER_REAL, 0.02)
    plant.drift(1e-3)
except KeyboardInterrupt:
    print("interrupted", plant.state is before)
"""


def test_it_is_raised_where_the_kernel_was_called() -> None:
    """It comes in the kernel, which takes some tenths of a second, and is raised as soon as Python goes on."""
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], cwd=ROOT, env={**os.environ, "PYTHONPATH": SOURCES},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "interrupted True\n"), done.stderr
