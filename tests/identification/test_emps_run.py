"""The real machine's record: in, identified, and its reference run again on the stage file of that machine."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from stagectl.cli.app import application
from stagectl.config.stage_file import load_stage
from stagectl.identification.capture import IdentificationError, Refusal
from stagectl.identification.captures import opened, prepared
from stagectl.identification.methods import identify
from stagectl.recording.hdf5 import Recording, open_recording
from stagectl.recording.imports import read
from tests.gap.measured import DATA

CONFIG = Path(__file__).parents[2] / "config"
STAGE = CONFIG / "emps.yaml"
EMPS = DATA / "emps" / "DATA_EMPS.mat"


def stagectl(*arguments: object) -> str:
    """A command as a user types it; it must succeed."""
    result = CliRunner().invoke(application(), [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages go into a folder of the test."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def emps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not EMPS.exists():
        pytest.skip("the EMPS record is not beside this repository (../shared/data/emps/DATA_EMPS.mat)")
    path = tmp_path_factory.mktemp("emps") / "emps.h5"
    stagectl("import", EMPS, "-o", path)
    return path


def test_identify_reproduces_the_published_values(emps: Path) -> None:
    """A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019."""
    answer: dict[str, Any] = json.loads(stagectl("identify", "least-squares", STAGE, emps, "--json", "-"))
    for name, value, within, unit in (
        ("inertia", 95.1089, 1e-3, "kg"),
        ("viscous", 203.5034, 5e-3, "N s/m"),
        ("coulomb", 20.3935, 5e-3, "N"),
        ("offset", -3.1648, 2e-2, "N"),
    ):
        parameter = answer["parameters"][name]
        assert parameter["value"] == pytest.approx(value, rel=within)
        assert parameter["low"] < value < parameter["high"]
        assert parameter["unit"] == unit
    assert 4.0 <= answer["force_residual_percent"] <= 4.1
    assert np.diag(answer["correlation"]) == pytest.approx(np.ones(4))
    assert answer["captures"][0]["current"] == "command"


def test_twice_the_data_is_surer_by_the_root_of_two(emps: Path) -> None:
    """A statistical fact, of a file and of the same record exported as a folder."""
    setup, folder = load_stage(STAGE), emps.with_name("folder")
    stagectl("export", emps, "--to", "folder", "-o", folder)
    once, twice = (
        identify("least-squares", prepared(opened(paths, setup), setup), setup.file, silent, {}).parameters
        for paths in ([emps], [emps, folder])
    )
    for name in once:
        assert twice[name].value == pytest.approx(once[name].value, rel=1e-9)
        width = (twice[name].high - twice[name].low) / (once[name].high - once[name].low)
        assert width == pytest.approx(0.5**0.5, rel=1e-9)


def test_its_reference_runs_in_simulation(emps: Path) -> None:
    """All 24.84 s, with a run-up and a run-out, as the record begins and ends in motion."""
    trajectory, out = emps.with_name("reference.yaml"), emps.with_name("simulated.h5")
    stagectl("export", emps, "--to", "trajectory", "-o", trajectory)
    result = json.loads(stagectl("simulate", STAGE, trajectory, "-o", out, "--json", "-"))
    assert result["steady"] == pytest.approx([0.3, 25.14], abs=1e-3)
    assert result["in_position"] and result["saturated_cycles"] == 0
    assert 4e-8 < result["tracking_error"]["peak"] < 1.5e-7  # one to three counts of the encoder
    samples, record = open_recording(out).samples, open_recording(emps)
    inside = slice(300, 300 + 24840)
    moved = samples["reference"][inside] - samples["reference"][300]
    np.testing.assert_allclose(moved, record.column("reference")[:24840] - record.column("reference")[0], atol=2e-6)


def test_its_reference_runs_on_the_bus(emps: Path) -> None:
    """A second of it, over CAN with a virtual drive in its own process, as in simulation."""
    trajectory = emps.with_name("second.yaml")
    stagectl("export", emps, "--to", "trajectory", "-o", trajectory)
    trajectory.write_text(trajectory.read_text() + "part: [0 s, 1 s]\n")
    arguments = ("--channel", emps.parent / "bus", "-o", emps.with_name("run.h5"), "--json", "-")
    command = [
        sys.executable,
        "-m",
        "stagectl",
        "run",
        *map(str, (STAGE, trajectory, *arguments)),
    ]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode == 0, run.stderr
    result = json.loads(run.stdout)
    assert result["in_position"] and result["fault"] == ""
    assert 4e-8 < result["tracking_error"]["peak"] < 1.5e-7


def test_the_wrong_captures_are_refused(tmp_path: Path) -> None:
    setup = load_stage(STAGE)
    (tmp_path / "turns.csv").write_text("time_s,position_rad\n0,1\n1,2\n")
    with pytest.raises(IdentificationError) as caught:
        prepared(read(tmp_path / "turns.csv"), setup)
    error = caught.value
    assert (error.reason, error.value, error.admissible) == (Refusal.WRONG_AXIS, "rotary", "linear")
    assert error.capture.endswith("turns.csv")
    (tmp_path / "bare.csv").write_text("time_s,position_m\n0,1\n1,2\n")
    bare = read(tmp_path / "bare.csv")
    with pytest.raises(IdentificationError) as caught:
        prepared(bare, setup)
    assert (caught.value.reason, caught.value.value) == (Refusal.MISSING_COLUMN, "time, measured")
    with pytest.raises(IdentificationError) as caught:
        prepared([held_out(recording) for recording in bare], setup)
    assert caught.value.reason is Refusal.HELD_OUT
    (tmp_path / "short.csv").write_text("time_s,position_m,current_A\n0,1,0\n1,2,0\n")
    with pytest.raises(IdentificationError) as caught:
        prepared(read(tmp_path / "short.csv"), setup)
    assert (caught.value.reason, caught.value.value) == (Refusal.TOO_SHORT, 2)


def silent(_done: int, _total: int) -> None:
    """Nobody watches."""


def held_out(recording: Recording) -> Recording:
    return recording._replace(meta={**recording.meta, "capture": {"use": "held-out"}})
