"""Fixtures of the drive tests: a bus in a folder of the test, virtual drives on it, and byte scripts."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.drives.drive import Simulation
from stagectl.drives.simulated import Plant
from tests.drives.workbench import DT, Script, Workbench, linear_stage


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """Kernels compile before any test runs against the wall clock."""
    plant = Plant(linear_stage(), Simulation(substeps=4), DT)
    plant.advance(0.0)
    assert plant.position_counts == 0


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Workbench]:
    with contextlib.ExitStack() as stack:
        yield Workbench(tmp_path / "bus", stack)


@pytest.fixture
def runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user's folder for sockets, with a name as short as systemd gives it."""
    with tempfile.TemporaryDirectory(prefix="run-") as name:
        monkeypatch.setenv("XDG_RUNTIME_DIR", name)
        yield Path(name)


@pytest.fixture
def script() -> Script:
    return Script()
