"""The verbs over recordings as a user types them: results on standard output, words on the other, exit codes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import stagectl as sc
from stagectl.design import DesignError
from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import RecordingError, open_recording, save
from stagectl.report.constants import ALL_ROWS
from stagectl.report.run import thinned
from tests.conftest import Command
from tests.problems import refused

ROOT = Path(__file__).parents[2]
STAGE = ROOT / "config" / "ball-screw.yaml"


Verb = Callable[..., SimpleNamespace]


@pytest.fixture
def stagectl(command: Command) -> Verb:
    """``stagectl("export", path, expect=2)``: what it says, where it ends with the exit code `expect`."""

    def run(*arguments: object, expect: int = 0) -> SimpleNamespace:
        code, out, err = command(*arguments)
        assert (code, "Traceback" in err) == (expect, False), err
        return SimpleNamespace(stdout=out, stderr=err)

    return run


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("records")
    trajectory = folder / "wave.yaml"
    trajectory.write_text("type: multisine\namplitude: 20 mm\nlow: 0.2 Hz\nhigh: 2 Hz\nbase: 8 s\nperiods: 1\n")
    return sc.simulate(STAGE, trajectory).save(folder / "wave.h5")


def test_export_writes_beside_the_recording(stagectl: Verb, recording: Path) -> None:
    for to in ("csv", "parquet", "mat"):
        assert f"wrote {recording.with_suffix(f'.{to}')}" in stagectl("export", recording, "--to", to).stderr
        assert recording.with_suffix(f".{to}").stat().st_size > 1000


def test_the_page_of_a_run(stagectl: Verb, recording: Path, tmp_path: Path) -> None:
    """The answer in words, the figures, and all that it takes to do it again: command, versions, configuration."""
    answer = json.loads(stagectl("report", recording, "-o", tmp_path / "page.html", "--json", "-").stdout)
    page = (tmp_path / "page.html").read_text().replace("\u00a0", " ")
    assert answer["answer"].startswith("The stage tracks within ") and answer["answer"] in page
    assert page.count("<img ") == 3 and "Simulated, on the stage model" in page
    assert f"stagectl replay {recording}" in page and "python-can" in page
    digest = hashlib.sha256(STAGE.read_bytes()).hexdigest()
    assert f"{STAGE.name}, SHA-256 {digest[:16]}" in page and "type: multisine" in page


def test_no_peak_of_a_curve_is_lost() -> None:
    values = np.zeros(100_000)
    values[[77, 5_000]] = 3.0, -2.0
    time, numbers = thinned(np.arange(100_000.0), values)
    assert len(time) == len(numbers) <= ALL_ROWS and numbers.max() == 3.0 and numbers.min() == -2.0


def test_two_recordings_go_into_one_folder_and_come_back(stagectl: Verb, recording: Path, tmp_path: Path) -> None:
    stagectl("export", recording, recording, "--to", "folder", "-o", tmp_path / "out")
    entries = yaml.safe_load((tmp_path / "out" / "captures.yaml").read_text())["captures"]
    assert [entry["repeat"] for entry in entries] == [1, 2]
    words = stagectl("import", tmp_path / "out", "-o", tmp_path / "back").stderr
    setpoints = "reference, target, feedforward, friction, velocity, learned, injection, closed"
    assert f"columns time, {setpoints}, command, measured, measured_current" in words
    for name in ("wave-1.h5", "wave-2.h5"):
        back = open_recording(tmp_path / "back" / name)
        np.testing.assert_array_equal(back.column("measured"), open_recording(recording).column("measured"))


def test_replay_is_exact_and_refuses_an_import(stagectl: Verb, recording: Path, tmp_path: Path) -> None:
    assert json.loads(stagectl("replay", recording, "--json", "-").stdout)["identical"] is True
    stagectl("export", recording, "--to", "csv", "-o", tmp_path / "a.csv")
    stagectl("import", tmp_path / "a.csv", "-o", tmp_path / "a.h5")
    assert "it holds no law to replay" in stagectl("replay", tmp_path / "a.h5", expect=2).stderr


def test_a_log_comes_in_whatever_the_loop_of_its_stage_file(stagectl: Verb, recording: Path, tmp_path: Path) -> None:
    """Of the stage file, an import needs the scales; that its loop must not run is no matter of the log's."""
    stage = tmp_path / "fast.yaml"
    stage.write_text(STAGE.read_text().replace("bandwidth: 40 Hz", "bandwidth: 80 Hz"))
    with pytest.raises(DesignError):
        sc.load_stage(stage)
    log = stagectl("export", recording, "--to", "csv", "-o", tmp_path / "a.csv") and tmp_path / "a.csv"
    stagectl("import", log, "--stage", stage, "-o", tmp_path / "a.h5")
    assert len(sc.load_log(log, stage=stage)) == len(open_recording(tmp_path / "a.h5").samples)


def test_identify_finds_the_model_that_was_simulated(stagectl: Verb, recording: Path, tmp_path: Path) -> None:
    """The ball screw's own figures; presliding, which the equation does not know, costs some per cent."""
    page = tmp_path / "page.html"
    arguments = ("--json", tmp_path / "found.json", "--report", page)
    result = stagectl("identify", "least-squares", STAGE, recording, *arguments)
    assert f"report: {page}" in result.stderr and "<img" in page.read_text()
    answer = json.loads((tmp_path / "found.json").read_text())
    assert answer["method"] == "least-squares" and "95 % interval" in result.stderr
    for name, value, within, unit in (
        ("inertia", 0.010, 0.03, "kg m^2"),
        ("viscous", 0.14, 0.03, "N m s/rad"),
        ("coulomb", 1.0, 0.10, "N m"),
    ):
        assert answer["parameters"][name]["value"] == pytest.approx(value, rel=within)
        assert answer["parameters"][name]["unit"] == unit
    assert answer["parameters"]["coulomb"]["value"] < 1.0  # presliding is softer than sign(v)
    assert abs(answer["parameters"]["offset"]["value"]) < 0.02
    assert answer["captures"][0]["current"] == "measured_current"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("export", "none.h5", "--to", "csv"), "none.h5: no such file or folder"),
        (("import", "none.csv"), "none.csv: no such file or folder"),
        (("import", STAGE), "cannot be imported"),
        (("import", "none.csv", "--stage", STAGE, "--counts", "4096"), "leave out one of the two"),
        (("export", STAGE, "--to", "csv"), "is a stage file, and --to csv takes recordings"),
        (("identify", "least-squares", STAGE, "none.h5"), "none.h5: no such file or folder"),
        (("identify", "guessing", STAGE, "none.h5"), "least-squares"),
        (("export", "none.h5", "--to", "xls"), "xls"),
    ],
)
def test_mistakes_end_in_words(stagectl: Verb, arguments: tuple[object, ...], words: str) -> None:
    assert words in stagectl(*arguments, expect=2).stderr


@pytest.mark.parametrize(
    "words",
    [
        ("report",),
        ("replay",),
        ("export", "--to", "csv"),
        ("export", "--to", "folder"),
        ("identify", "least-squares", STAGE),
        ("gap", "diagnose", "--stage", STAGE),
    ],
)
def test_a_recording_without_rows_is_said_to_hold_none(
    stagectl: Verb, recording: Path, tmp_path: Path, words: tuple[object, ...]
) -> None:
    """As a disk leaves it that is full from the first row on."""
    whole, path = open_recording(recording), tmp_path / "none.h5"
    save(path, whole.meta, whole.samples[:0], "the disk was full")
    done = stagectl(*words, path, expect=2)
    assert (done.stdout, f"{path} holds no rows" in done.stderr) == ("", True)
    with refused(RecordingError, kind=ProblemKind.MISSING):
        sc.load_log(path)
