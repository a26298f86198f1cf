"""A fleet: a line for every machine, also for one that cannot be diagnosed; drift since the last time."""

import json
from pathlib import Path

import numpy as np
import pytest
from stagectl_studies.fleet import FleetMachine, diagnosed, drift, names_of
from typer.testing import CliRunner

from stagectl.cli.app import application
from stagectl.gap.result import result_json
from stagectl.gap.result.diagnosis import Gap
from stagectl.recording.exports import write_columns

GAP = Gap(2e-5, 1e-6, 5e-7, "rad", 0.99, 0.98, 1.0)


@pytest.fixture
def blind(tmp_path: Path) -> Path:
    """A machine that logs no force: nothing can be told, and quickly."""
    folder = tmp_path / "machine-1"
    folder.mkdir()
    time = np.arange(2000) * 5e-4
    write_columns(folder / "a.csv", {"time_s": time, "position_rad": np.sin(6.0 * time)})
    (folder / "captures.yaml").write_text("captures:\n- {file: a.csv, experiment: a, repeat: 1, use: diagnose}\n")
    stage = "stage: {kind: rotary, position_unit: rad, torque_unit: Nm, force_constant: 0.7, inertia: 0.01}\n"
    (folder / "nominal.yaml").write_text(stage)
    return folder


def test_drift() -> None:
    assert drift(GAP._replace(before=1e-5), GAP) == pytest.approx(1.0)
    assert drift(None, GAP) is None and drift(GAP._replace(unit="m"), GAP) is None
    assert drift(GAP._replace(before=float("nan")), GAP) is None


def test_names_that_tell_folders_apart() -> None:
    assert names_of([Path("/a/x/captures"), Path("/a/y/captures")]) == ["x/captures", "y/captures"]
    assert names_of([Path("/a/x"), Path("/b/y")]) == ["x", "y"]


def test_an_error_of_ours_takes_no_other_line(blind: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(result_json, "save", lambda *_: 1 / 0)
    line = diagnosed(FleetMachine(str(blind), "one"))
    assert (line.machine, line.verdict, line.words) == ("one", "", "ZeroDivisionError: division by zero")


def test_a_line_for_every_machine(blind: Path, tmp_path: Path) -> None:
    (tmp_path / "machine-2").mkdir()
    target = tmp_path / "fleet.json"
    done = CliRunner().invoke(
        application(), ["gap", "fleet", str(tmp_path / "machine-2"), str(blind), "--json", str(target)]
    )
    assert done.exit_code == 1
    first, second = json.loads(target.read_text())["machines"]
    assert (first["machine"], first["verdict"], first["gap"]) == ("machine-1", "not-identifiable", None)
    assert second["machine"] == "machine-2" and second["verdict"] == "" and "machine-2" in second["words"]


def test_the_answer_stays_in_the_folder(blind: Path) -> None:
    assert diagnosed(FleetMachine(str(blind), "one")).verdict == "not-identifiable"
    assert (blind / "diagnosis.json").exists()
