"""A stage, one short run of it, and a folder of one's own."""

from __future__ import annotations

from pathlib import Path

import pytest

import stagectl as sc
from stagectl.api.record import MotionRecord
from stagectl.api.stage import DesignedStage
from tests.conftest import CONFIG

STAGE, SINE = CONFIG / "ball-screw.yaml", CONFIG / "trajectories" / "sine-3.2hz.yaml"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def stage() -> DesignedStage:
    """Stage A, designed."""
    return sc.load_stage(STAGE)


@pytest.fixture(scope="session")
def run(stage: DesignedStage) -> MotionRecord:
    """Stage A follows a sine, simulated."""
    return sc.simulate(stage, SINE)
