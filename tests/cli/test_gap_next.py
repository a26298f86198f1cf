"""`gap next`: the proposed trajectory as a file, and how to run it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import typer

from stagectl.cli import gap_apply
from stagectl.gap.result.diagnosis import NextExperiment
from stagectl.gap.result.result_json import save
from stagectl.units import StageError
from tests.gap.examples import found

TEXT = "type: sine\namplitude: 5 mm\nfrequency: 2 Hz\nperiods: 3\n"
MOTION = NextExperiment("micro-sweep", "micro-sweep.yaml", ("backlash", "presliding"), 31.4, 18.2, "Micro-sines.", TEXT)
HAND = NextExperiment("added mass", "", ("inertia", "force_constant"), 0.0, 900.0, "Weigh a mass.")


def following(folder: Path, proposed: NextExperiment | None, *options: str) -> int:
    folder.mkdir(exist_ok=True)
    save(found("effects", next_experiment=proposed), folder)
    app = typer.Typer()
    app.command("next")(gap_apply.following)
    app.callback()(lambda: None)
    return int(app(["next", str(folder), *options], standalone_mode=False) or 0)


def test_the_file_and_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "slow-1.h5").touch()
    assert following(tmp_path, MOTION) == 0
    assert (tmp_path / "micro-sweep.yaml").read_text() == TEXT
    message = capsys.readouterr().err
    assert "separates backlash from presliding friction by 31.4 sigma, and takes 18 s" in message
    path = tmp_path / "micro-sweep.yaml"
    assert f"stagectl run STAGE.yaml {path} --output {tmp_path / 'micro-sweep-1.h5'}" in message
    assert f"stagectl gap diagnose {tmp_path}" in message
    assert following(tmp_path, MOTION) == 0  # again: the file is the same


def test_logs_of_another_program_do_not_mix_with_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The answer lies in a folder without logs: the recording goes into another one, and the answer stays."""
    assert following(tmp_path / "answer", MOTION) == 0
    message = capsys.readouterr().err
    folder = tmp_path / "answer-micro-sweep"
    assert f"--output {folder / 'micro-sweep-1.h5'}" in message and f"stagectl gap diagnose {folder}" in message


def test_a_folder_from_elsewhere_gets_a_capture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "captures.yaml").write_text("captures: []\n")
    assert following(tmp_path, MOTION, "-o", str(tmp_path / "other.yaml")) == 0
    assert (tmp_path / "other.yaml").read_text() == TEXT and not (tmp_path / "micro-sweep.yaml").exists()
    assert f"add the log to {tmp_path / 'captures.yaml'}" in capsys.readouterr().err


def test_nothing_of_the_user_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "micro-sweep.yaml").write_text("mine\n")
    with pytest.raises(StageError, match=r"micro-sweep.yaml exists and holds something else: .* with -o"):
        following(tmp_path, MOTION)
    assert (tmp_path / "micro-sweep.yaml").read_text() == "mine\n"


def test_by_hand_and_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert following(tmp_path, HAND) == 0
    message = capsys.readouterr().err
    assert "separates inertia from force constant, and takes 15 min" in message and "Weigh a mass." in message
    assert following(tmp_path, HAND, "-o", str(tmp_path / "a.yaml")) == 1
    assert not (tmp_path / "a.yaml").exists()
    assert following(tmp_path, None) == 0
    assert "no experiment is proposed" in capsys.readouterr().err


def test_row_by_row_for_another_controller(tmp_path: Path) -> None:
    """The sine at 1 kHz in axis units: 5 mm of travel over the travel of one radian; it begins and ends at rest."""
    table, per_unit = tmp_path / "rows.csv", found("effects").travel_per_unit
    assert following(tmp_path, MOTION, "--samples", str(table), "--rate", "1000") == 0
    assert table.read_text().split("\n", 1)[0] == "time_s,reference_rad,injection_A"
    time, reference, injection = np.loadtxt(table, delimiter=",", skiprows=1, unpack=True)
    assert np.abs(np.diff(time) - 0.001).max() < 1e-12 and not injection.any()
    assert np.abs(reference).max() == pytest.approx(0.005 / per_unit, rel=0.01)
    assert reference[0] == 0.0 and np.ptp(reference[-100:]) < 1e-12


def test_what_is_injected_stands_in_the_rows(tmp_path: Path) -> None:
    text = """type: excited
motion: {type: dwell, duration: 2 s}
current: {type: current_sine, amplitude: 0.5 A, frequency: 10 Hz, periods: 8}
start: 0.5 s
"""
    assert following(tmp_path, MOTION._replace(text=text), "--samples", str(tmp_path / "rows.csv")) == 0
    time, _, injection = np.loadtxt(tmp_path / "rows.csv", delimiter=",", skiprows=1, unpack=True)
    assert np.abs(np.diff(time) - 0.0005).max() < 1e-12
    assert not injection[time < 0.5].any() and not injection[time > 1.5005].any()
    assert np.abs(injection).max() == pytest.approx(0.5, rel=0.01)


def test_by_hand_there_are_no_rows(tmp_path: Path) -> None:
    assert following(tmp_path, HAND, "--samples", str(tmp_path / "rows.csv")) == 1
    assert not (tmp_path / "rows.csv").exists()
