"""Imports: known quantities in any unit, the benchmark's file, and words for all that is missing."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from stagectl.config.source import ConfigError
from stagectl.config.stage_file import Setup, load_stage
from stagectl.problem import ProblemKind
from stagectl.recording.columns import split
from stagectl.recording.export_targets import SUFFIXES
from stagectl.recording.exports import export
from stagectl.recording.guess.importing import import_log
from stagectl.recording.hdf5 import Recording, RecordingError, open_recording
from stagectl.recording.imports import read, store
from stagectl.recording.replay import replay
from stagectl.recording.scales import Known
from stagectl.units import StageError
from tests.problems import refused

CONFIG = Path(__file__).parents[2] / "config"
EMPS = Path(__file__).resolve().parents[3] / "shared" / "data" / "emps" / "DATA_EMPS.mat"
NOMINAL = """
stage: {kind: ball-screw, position_unit: rad, torque_unit: Nm, force_constant: 0.5, travel_per_unit_mm: 2.0,
        encoder_step: 1e-3}
drive: {amplifier_A_per_V: 3.0}
"""


def one(folder: Path, text: str, nominal: str = "") -> Recording:
    (folder / "log.csv").write_text(text)
    if nominal:
        (folder / "nominal.yaml").write_text(nominal)
    (recording,) = read(folder / "log.csv")
    return recording


@pytest.mark.parametrize(
    ("header", "column", "value"),
    [
        ("position_rad", "measured", 2.0),
        ("position_mm", "measured", 1.0),  # 2 mm of travel a rad
        ("position_um", "measured", 1e-3),
        ("position_counts", "measured", 2e-3),
        ("position_deg", "measured", 2.0 * math.pi / 180.0),
        ("position_rad,reference_mm", "reference", 1.0),
        ("position_rad,current_command_A", "command", 2.0),
        ("position_rad,current_command_V", "command", 6.0),  # 3 A/V
        ("position_rad,current_command_Nm", "command", 4.0),  # 0.5 N m/A
        ("position_rad,torque_Nm", "measured_current", 4.0),
        ("position_rad,current_mA", "measured_current", 2e-3),
        ("position_rad,measured_current_A", "measured_current", 2.0),  # as the page's scope saves it
        ("measured_mm,measured_current_A", "measured", 1.0),
    ],
)
def test_units_become_ours(tmp_path: Path, header: str, column: str, value: float) -> None:
    row = ",2" * (1 + header.count(","))
    recording = one(tmp_path, f"time_s,{header}\n0{row}\n1{row}\n", NOMINAL)
    assert recording.column(column) == pytest.approx([value, value], rel=1e-12)


def test_forces_on_a_linear_axis(tmp_path: Path) -> None:
    nominal = "stage: {kind: linear, position_unit: m, force_constant: 20}"
    recording = one(tmp_path, "time_ms,position_mm,force_N\n0,1,10\n1,2,-10\n", nominal)
    assert recording.column("measured") == pytest.approx([1e-3, 2e-3])
    assert recording.column("measured_current") == pytest.approx([0.5, -0.5])
    assert recording.meta["dt"] == pytest.approx(1e-3)
    assert recording.meta["axis"]["kind"] == "linear"


def test_the_stage_file_gives_the_scales(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,position_counts,torque_Nm\n0,0,0.72\n1,1048576,1.44\n")
    (recording,) = read(tmp_path / "log.csv", load_stage(CONFIG / "ball-screw.yaml"))
    assert recording.column("measured") == pytest.approx([0.0, 2.0 * math.pi])
    assert recording.column("measured_current") == pytest.approx([1.0, 2.0])


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    recording = one(tmp_path, "time_s,position_mm,current_command_V,temperature_C\n5,1,0,20\n6,2,0,20\n8,3,0,20\n")
    assert recording.samples.dtype.names == ("time", "measured")
    np.testing.assert_array_equal(recording.column("time"), [0.0, 1.0, 3.0])
    notes = "\n".join(recording.meta["notes"])
    assert "current_command_V is left out: a voltage has no scale: write drive.amplifier_A_per_V" in notes
    assert "temperature_C is left out" in notes
    for words in ("no reference", "no command", "no measured current"):
        assert words in notes
    with refused(RecordingError, kind=ProblemKind.UNKNOWN, column="command"):
        recording.column("command")


def test_an_empty_cell_is_a_gap(tmp_path: Path) -> None:
    recording = one(tmp_path, "time_s,position_m,current_A\n0,0,1\n1,0,\n")
    np.testing.assert_array_equal(recording.column("measured_current"), [1.0, np.nan])


KIND = ProblemKind


@pytest.mark.parametrize(
    ("text", "kind", "column", "row"),
    [
        ("", KIND.MISSING, "", 0),
        (" \n\n", KIND.MISSING, "", 0),
        ("time_s,position_counts\n0,1\n1,2\n", KIND.UNIT, "", 0),
        ("time_s,speed_m\n0,1\n1,2\n", KIND.UNIT, "", 0),
        ("position_m\n0\n1\n", KIND.MISSING, "time", 0),
        ("time_s,position_m\n", KIND.SHAPE, "", 0),
        ("time_s,position_m\n0,1\n", KIND.SHAPE, "", 0),
        ("time_s,position_m\n0,1\n1,x\n", KIND.VALUE, "position_m", 2),
        ("time_s,position_m\n0,1\n1\n2,3\n", KIND.VALUE, "", 0),  # a last row that is cut off is left out
        ("time_s,position_m\n0,1\n1,\n", KIND.MISSING, "position_m", 2),
        ("time_s,position_m\n0,1\n0,2\n", KIND.CONFLICT, "time_s", 2),
        ("time_s,position_m,position_mm\n0,1,2\n1,1,2\n", KIND.REPEATED, "measured", 0),
        ("time_parsec,position_m\n0,1\n1,2\n", KIND.UNIT, "time_parsec", 0),
    ],
)
def test_a_broken_csv_is_refused(tmp_path: Path, text: str, kind: ProblemKind, column: str, row: int) -> None:
    with refused(RecordingError, file=tmp_path / "log.csv", kind=kind, column=column, row=row):
        one(tmp_path, text)


TITLED = "Axis1\nSampling time interval(ms),0.5\nTime,Analog 1,Torque\nms,r/min,A\n0,0,1\n0.5,12,2\n1,24,3\n"


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_header_further_down_is_shown(tmp_path: Path, separator: str) -> None:
    """Which row looks like it, what separates the columns, and that there is no position among them."""
    with pytest.raises(RecordingError) as refusal:
        one(tmp_path, TITLED.replace(",", separator))
    words = {",": "commas", ";": "semicolons", "\t": "tabs"}[separator]
    assert "no header in row 1: its numbers begin in row 5, and row 4 looks like the header (ms, r/min, A)" in str(
        refusal.value
    )
    assert f"separated by {words}; none of them is named as a position" in str(refusal.value)
    assert "of its 3 columns" in str(refusal.value)
    with pytest.raises(RecordingError) as refusal:
        one(tmp_path, TITLED.replace(",", separator).replace("Analog 1", "Position"))
    assert "named as a position" not in str(refusal.value)


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", ",")])
def test_rows_before_the_numbers_are_skipped(tmp_path: Path, separator: str, decimal: str) -> None:
    text = TITLED.replace(",", separator).replace("0.5", f"0{decimal}5")
    (tmp_path / "log.csv").write_text(text)
    words = {"time": "1:ms", "position": "2:mm", "current": "3:A"}
    (recording,) = read(tmp_path / "log.csv", load_stage(CONFIG / "ball-screw.yaml"), words)
    np.testing.assert_allclose(recording.column("time"), [0.0, 0.5e-3, 1e-3])
    np.testing.assert_allclose(recording.column("measured"), [0.0, 2.0 * math.pi, 4.0 * math.pi])
    np.testing.assert_allclose(recording.column("measured_current"), [1.0, 2.0, 3.0])
    assert "its first 4 rows are no numbers and are skipped" in recording.meta["notes"]


def test_semicolons_and_decimal_commas_are_read(tmp_path: Path) -> None:
    recording = one(tmp_path, "time_s;position_m;current_A\n0,0;0,25;1,5\n0,5;0,5;-1e-1\n")
    np.testing.assert_array_equal(recording.column("measured"), [0.25, 0.5])
    np.testing.assert_array_equal(recording.column("measured_current"), [1.5, -0.1])


@pytest.mark.parametrize(
    ("nominal", "kind", "column"),
    [
        ("[1, 2]", KIND.SHAPE, ""),
        ("stage: 3", KIND.SHAPE, "stage"),
        ("stage: {position_unit: furlong}", KIND.VALUE, ""),
        ("stage: {encoder_step: many}", KIND.RANGE, "encoder_step"),
        ("stage: {force_constant: -1}", KIND.RANGE, "force_constant"),
        ("stage: !!python/object:os.system {}", KIND.VALUE, ""),
    ],
)
def test_a_broken_nominal_is_refused(tmp_path: Path, nominal: str, kind: ProblemKind, column: str) -> None:
    with refused(RecordingError, file=tmp_path / "nominal.yaml", kind=kind, column=column):
        one(tmp_path, "time_s,position_rad\n0,1\n1,2\n", nominal)


def test_a_nominal_that_does_not_fit_its_log_is_refused(tmp_path: Path) -> None:
    with refused(RecordingError, file=tmp_path / "log.csv", kind=KIND.UNIT, column="position_rad"):
        one(tmp_path, "time_s,position_rad\n0,1\n1,2\n", "stage: {position_unit: m}")
    with refused(ConfigError, file=tmp_path / "nominal.yaml", kind=KIND.SYNTAX):
        one(tmp_path, "time_s,position_rad\n0,1\n1,2\n", "stage: [")


@pytest.mark.parametrize(
    ("text", "kind", "file"),
    [
        ("captures: []", KIND.SHAPE, "captures.yaml"),
        ("captures: [{experiment: a}]", KIND.MISSING, "captures.yaml"),
        ("captures: [{file: a.csv}]", KIND.FILE, "a.csv"),
    ],
)
def test_a_broken_folder_is_refused(tmp_path: Path, text: str, kind: ProblemKind, file: str) -> None:
    (tmp_path / "captures.yaml").write_text(text)
    with refused(RecordingError, kind=kind, file=tmp_path / file):
        read(tmp_path)


def test_a_folder_needs_its_list(tmp_path: Path) -> None:
    with refused(StageError, kind=KIND.MISSING, file=tmp_path):
        read(tmp_path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("")
    (tmp_path / "bad.mat").write_bytes(b"\x00" * 200)
    (tmp_path / "empty.mat").write_bytes(b"")
    savemat(tmp_path / "other.mat", {"x": [1.0]})
    savemat(tmp_path / "ragged.mat", {"t": [0.0, 1.0], "qm": [0.0], "vir": [0.0, 0.0], "gtau": 35.0})
    for name, kind in (
        ("a.txt", KIND.MISSING),
        ("none.csv", KIND.FILE),
        ("bad.mat", KIND.SYNTAX),
        ("empty.mat", KIND.SYNTAX),
        ("other.mat", KIND.MISSING),
        ("ragged.mat", KIND.SHAPE),
    ):
        with refused(RecordingError, kind=kind, file=tmp_path / name):
            read(tmp_path / name)


def test_an_import_is_a_recording(tmp_path: Path) -> None:
    """It is stored, opened, exported in every format and read back; only a replay it refuses."""
    recording = one(tmp_path, "time_s,position_m,reference_m\n0,0.125,0\n1,0.25,1\n2,0.5,2\n3,1,3\n4,1,4\n5,1,5\n")
    (path,) = store([recording], recording.path, tmp_path / "new" / "log.h5")
    stored = open_recording(path)
    assert stored.complete and stored.ended == "imported from log.csv"
    assert stored.meta["source"]["sha256"] == hashlib.sha256((tmp_path / "log.csv").read_bytes()).hexdigest()
    np.testing.assert_array_equal(stored.samples, recording.samples)
    for to in ("csv", "parquet", "mat", "trajectory", "folder"):
        export([stored], to, tmp_path / to / f"log{SUFFIXES.get(to, '.csv')}")
    (back,) = read(tmp_path / "csv" / "log.csv")
    np.testing.assert_array_equal(back.samples, recording.samples)
    (back,) = read(tmp_path / "folder" / "log.csv")  # a folder of this name
    np.testing.assert_array_equal(back.samples, recording.samples)
    with refused(RecordingError, kind=KIND.MISSING, file=stored.path):
        replay(stored)


def test_a_log_of_time_and_position_is_a_recording(tmp_path: Path, ball_screw: Setup) -> None:
    """Both columns are counted, so neither stands for itself."""
    (tmp_path / "log.csv").write_text("time_s,position_rad\n0,0\n0.0005,0.25\n0.001,0.5\n")
    (recording,) = read(tmp_path / "log.csv", ball_screw)
    (path,) = store([recording], recording.path, tmp_path / "log.h5")
    np.testing.assert_array_equal(open_recording(path).samples, recording.samples)


def test_the_session_clock_survives(tmp_path: Path) -> None:
    entry = "{file: a.csv, experiment: ../warm, repeat: 4, use: held-out, start_s: 12.5, injection: d.csv}"
    (tmp_path / "captures.yaml").write_text(f"captures: [{entry}]")
    (tmp_path / "a.csv").write_text("time_s,position_m\n0,1\n1,2\n")
    (tmp_path / "d.csv").write_text("time_s,injection_A\n0,0.25\n1,-0.5\n")
    (recording,) = read(tmp_path)
    np.testing.assert_array_equal(recording.column("injection"), [0.25, -0.5])
    text = (export([recording], "folder", tmp_path / "out")[0].path / "captures.yaml").read_text()
    for words in (
        "repeat: 4",
        "use: held-out",
        "start_s: 12.5",
        "file: .._warm-1.csv",
        "injection: .._warm-1-injection.csv",
    ):
        assert words in text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("injection_mA\n1\n2\n3\n4\n", [1e-3, 2e-3, 3e-3, 4e-3]),  # row by row
        ("time_s,current_A\n0.2,1\n0.4,2\n", [0.0, 0.0, 1.0, 1.0]),  # none before it begins
        ("time_s,dither_A\n0,1\n0.2,3\n", [1.0, 1.0, 3.0, 3.0]),  # a value holds until the next one, the last as long
        ("time_s,injection_A,current_A\n0.0001,1,9\n0.1001,2,9\n", [1.0, 2.0, 0.0, 0.0]),  # stamps of another clock
    ],
)
def test_an_injection_finds_its_rows(tmp_path: Path, text: str, expected: list[float]) -> None:
    (tmp_path / "captures.yaml").write_text("captures: [{file: a.csv, injection: d.csv}]")
    (tmp_path / "a.csv").write_text("time_s,position_m\n0,1\n0.1,2\n0.2,2\n0.3,2\n")
    (tmp_path / "d.csv").write_text(text)
    (recording,) = read(tmp_path)
    assert recording.column("injection") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "kind", "column", "row"),
    [
        ("injection_A\n1\n", KIND.CONFLICT, "", 0),
        ("time_s,amount\n0,1\n1,2\n", KIND.MISSING, "injection_A", 0),
        ("time_s,injection_A\n0,1\n0,2\n", KIND.CONFLICT, "time_s", 0),
        ("time_s,injection_A\n5,1\n6,2\n", KIND.CONFLICT, "time_s", 0),
        ("time_s,injection_A\n0,1\n1,\n", KIND.MISSING, "injection_A", 2),
        ("time_s,injection_A\n0,1\n1,much\n", KIND.VALUE, "injection_A", 0),
        ("", KIND.FILE, "", 0),
    ],
)
def test_an_injection_that_cannot_be_used(tmp_path: Path, text: str, kind: ProblemKind, column: str, row: int) -> None:
    (tmp_path / "captures.yaml").write_text("captures: [{file: a.csv, injection: d.csv}]")
    (tmp_path / "a.csv").write_text("time_s,position_m\n0,1\n1,2\n")
    (tmp_path / "d.csv").write_text(text)
    with refused(RecordingError, file=tmp_path / "d.csv", kind=kind, column=column, row=row):
        read(tmp_path)


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS record is not beside this repository (../shared/data/emps)")
def test_the_benchmark_comes_in(tmp_path: Path) -> None:
    """24 841 samples of 1 ms; gtau 35.1507 N/V; 5e-8 m a count."""
    (recording,) = read(EMPS)
    assert recording.samples.dtype.names == ("time", "reference", "command", "measured")
    assert len(recording.samples) == 24841
    assert recording.meta["dt"] == pytest.approx(1e-3, rel=1e-4)
    assert recording.meta["nominal"]["stage"]["force_constant"] == pytest.approx(35.1507, abs=5e-5)
    assert "an amplifier of 1 A/V" in recording.meta["notes"][0]
    error = recording.column("reference") - recording.column("measured")
    assert 1e-4 < np.abs(error).max() < 1e-2
    # The published control law holds between the columns (0.0037 V rms of 1.54 V).
    kp, kv = (recording.meta["nominal"]["controller"][name] for name in ("kp", "kv"))
    smooth = 0.5 * (recording.column("measured")[1:] + recording.column("measured")[:-1])
    law = kv * (kp * error[2:] - np.diff(smooth) / 1e-3)
    assert np.std(law - recording.column("command")[2:]) == pytest.approx(0.0037, rel=0.2)


def test_columns_by_name_and_number(tmp_path: Path) -> None:
    """With a header or without; a unit follows the colon, none is SI."""
    setup = load_stage(CONFIG / "ball-screw.yaml")
    (tmp_path / "named.csv").write_text("t,q,i\n0,0,1\n0.5,12,2\n")
    (tmp_path / "bare.csv").write_text("7,0,0,1000\n8,500,12,2000\n")
    for name, words, current in (
        ("named.csv", {"time": "t", "position": "q:mm", "current": "i"}, "measured_current"),
        ("named.csv", {"time": "1:s", "position": "2:mm", "command": "3"}, "command"),
        ("bare.csv", {"time": "2:ms", "position": "3:mm", "current": "4:mA"}, "measured_current"),
    ):
        (recording,) = read(tmp_path / name, setup, words)
        np.testing.assert_allclose(recording.column("time"), [0.0, 0.5])
        np.testing.assert_allclose(recording.column("measured"), [0.0, 2.0 * math.pi])
        np.testing.assert_allclose(recording.column(current), [1.0, 2.0])


@pytest.mark.parametrize("unit", ["", ":deg"])
def test_a_header_with_brackets_is_named_as_it_stands(tmp_path: Path, unit: str) -> None:
    """A unit in brackets is part of the name; a number in brackets is, where a table has such a header."""
    (tmp_path / "log.csv").write_text("time [s],q[1] [deg],q[2],i [A]\n0,0,9,1\n0.5,180,9,2\n")
    words = {"time": "time [s]", "position": f"q[1] [deg]{unit}", "current": "i [A]"}
    (recording,) = read(tmp_path / "log.csv", columns=words)
    np.testing.assert_allclose(recording.column("measured"), [0.0, math.pi])
    np.testing.assert_allclose(recording.column("measured_current"), [1.0, 2.0])
    (other,) = read(tmp_path / "log.csv", columns={**words, "position": "-q[2]:rad"})
    np.testing.assert_allclose(other.column("measured"), [-9.0, -9.0])
    with refused(RecordingError, kind=KIND.UNKNOWN, column="q[3]"):
        read(tmp_path / "log.csv", columns={**words, "position": "q[3]:rad"})


def test_variables_of_a_mat_file(tmp_path: Path) -> None:
    """Names that tell themselves, in a struct or not, and names that the user tells."""
    time, angle, current = np.arange(3.0), np.array([0.0, 0.5, 1.0]), np.array([1.0, 2.0, 3.0])
    savemat(tmp_path / "told.mat", {"log": {"time_ms": 1e3 * time, "position_rad": angle, "current": current}})
    savemat(tmp_path / "table.mat", {"X": np.column_stack([time, angle]), "u": current, "s": "text"})
    (recording,) = read(tmp_path / "told.mat")
    assert "log.current has no unit: it is taken as the current in A" in recording.meta["notes"]
    words = {"time": "X[1]", "position": "X[2]:rad", "current": "u"}
    (named,) = read(tmp_path / "table.mat", columns=words)
    for imported in (recording, named):
        np.testing.assert_allclose(imported.column("time"), time)
        np.testing.assert_allclose(imported.column("measured"), angle)
        np.testing.assert_allclose(imported.column("measured_current"), current)
    for wrong, kind, column in (
        ({"position": "X[3]:rad"}, KIND.UNKNOWN, "X"),
        ({"position": "X:rad"}, KIND.SHAPE, "X"),
        ({"current": "v"}, KIND.UNKNOWN, "v"),
        ({"current": "s"}, KIND.VALUE, "s"),
        ({"current": "u:mm"}, KIND.UNIT, "u"),
        ({"speed": "u"}, KIND.SYNTAX, "speed"),
    ):
        with refused(RecordingError, kind=kind, column=column):
            read(tmp_path / "table.mat", columns={**words, **wrong})
    with refused(RecordingError, kind=KIND.MISSING, column="measured"):
        read(tmp_path / "table.mat", load_stage(CONFIG / "ball-screw.yaml"), {"time": "X[1]", "current": "u"})


def test_our_own_mat_export_comes_back(tmp_path: Path) -> None:
    recording = one(tmp_path, "time_s,position_rad,current_A\n0,0.125,0\n1,0.25,1\n2,0.5,2\n", NOMINAL)
    export([recording], "mat", tmp_path / "log.mat")
    (back,) = read(tmp_path / "log.mat")
    np.testing.assert_array_equal(back.samples, recording.samples)
    assert back.meta["axis"] == recording.meta["axis"]


@pytest.mark.parametrize(
    ("name", "words", "kind", "column"),
    [
        ("bare.csv", None, KIND.MISSING, ""),
        ("bare.csv", {"time": "t", "position": "2:rad"}, KIND.UNKNOWN, "t"),
        ("bare.csv", {"time": "0", "position": "2:rad"}, KIND.UNKNOWN, "0"),
        ("bare.csv", {"time": "1", "position": "4:rad"}, KIND.UNKNOWN, "4"),
        ("named.csv", {"time": "t", "position": "p:rad"}, KIND.UNKNOWN, "p"),
        ("named.csv", None, KIND.UNIT, ""),
        ("named.csv", {"time": "t", "position": "q"}, KIND.UNIT, ""),
        ("named.csv", {"time": "t", "position": "q:rad", "command": "2:A"}, KIND.REPEATED, "column 2"),
        ("bare.csv", {"time": "1", "position": "2:rad", "command": "-2:A"}, KIND.REPEATED, "column 2"),
    ],
)
def test_columns_that_are_not_there(
    tmp_path: Path, name: str, words: dict[str, str] | None, kind: ProblemKind, column: str
) -> None:
    (tmp_path / "named.csv").write_text("t,q,i\n0,0,1\n0.5,12,2\n")
    (tmp_path / "bare.csv").write_text("0,0,1\n1,12,2\n")
    with refused(RecordingError, file=tmp_path / name, kind=kind, column=column):
        read(tmp_path / name, None, words)
    with refused(StageError, kind=KIND.SYNTAX):
        split("time=1,position")


@pytest.mark.parametrize("name", ["log.txt", "log.TXT", "log.dat", "log.t", "log"])
@pytest.mark.parametrize("space", [",", ", ", ";", "\t", " ", "   ", " \t "])
def test_a_text_table_is_one_whatever_its_ending(tmp_path: Path, name: str, space: str) -> None:
    """With a header behind the mark of a comment, and numbers that are padded to columns."""
    k = np.arange(99)
    columns = np.column_stack([k / 1000, np.rint(20.0 * np.sin(0.1 * k)), -k])
    rows = [["# time_s", "position_mm", "current_A"], *([f"{value:8.6g}" for value in row] for row in columns)]
    (tmp_path / name).write_text("".join(f"{space.join(row)}\n" for row in rows))
    (recording,) = read(tmp_path / name)
    for own, column in zip(("time", "measured", "measured_current"), columns.T * [[1.0], [1e-3], [1.0]], strict=True):
        np.testing.assert_allclose(recording.column(own), column, atol=1e-12)


def test_text_without_numbers_is_no_table(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("What was tried:\n1. a sine\n2. a chirp, of 3 A\n")
    with refused(RecordingError, kind=KIND.SHAPE, file=tmp_path / "notes.txt"):
        read(tmp_path / "notes.txt")


def test_logs_in_a_folder_are_told_from_notes(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("What was tried:\n1. a sine\n2. a chirp, of 3 A\n")
    for name in ("a.txt", "b.csv"):
        (tmp_path / name).write_text("time_s,position_mm\n0,0\n0.001,1\n0.002,3\n")
    assert [log.recording.path.name for log in import_log(tmp_path, None, None, Known(), unsure=False)] == [
        "a.txt",
        "b.csv",
    ]
