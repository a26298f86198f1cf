"""Logs with a mistake that their reader can see: a unit that is missing, another kind of axis, a damaged text."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from stagectl.config.stage_file import load_stage
from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import RecordingError, open_recording
from stagectl.recording.imports import read
from tests.conftest import CONFIG
from tests.problems import refused

KIND = ProblemKind


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("time_s,position_rad\n0,0\n1,1\n".encode("utf-16"), "UTF-16"),
        (b"time_s,position_rad\n0,0\n1,1" + bytes(4096), "4096 zero bytes"),
        ("time_s,L\u00e4ge_rad\n0,0\n1,1\n".encode("latin-1"), "saved as UTF-8"),
    ],
)
def test_a_text_of_16_bits_or_with_zeros_says_so(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "log.csv").write_bytes(content)
    with pytest.raises(RecordingError, match=words) as caught:
        read(tmp_path / "log.csv")
    assert caught.value.problems[0].kind is KIND.SYNTAX and "\0" not in str(caught.value)


def test_one_row_is_told_how_many_are_needed(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,position_rad\n0,0\n")
    with pytest.raises(RecordingError, match=r"has 1 row; .* 2 .* 100 ") as caught:
        read(tmp_path / "log.csv")
    assert caught.value.problems[0].kind is KIND.SHAPE


@pytest.mark.parametrize(("step", "doubtful"), [(0.5, True), (5e-4, False), (1e-3, False), (0.1, False)])
def test_rows_a_thousand_times_too_far_apart_are_noted_first(tmp_path: Path, step: float, doubtful: bool) -> None:
    """The stage runs every 0.5 ms: rows every 0.5 s are ms under a header in s."""
    lines = "".join(f"{k * step},{k}\n" for k in range(5))
    (tmp_path / "log.csv").write_text(f"time_s,position_rad\n{lines}")
    (recording,) = read(tmp_path / "log.csv", load_stage(CONFIG / "ball-screw.yaml"))
    assert ("in ms where s is named" in recording.meta["notes"][0]) is doubtful


@pytest.mark.parametrize("words", [{"position": "q"}, {"position": "-2"}, {"position": "q:mm", "reference": "3"}])
def test_the_unit_of_a_position_is_never_taken_as_known(tmp_path: Path, words: dict[str, str]) -> None:
    """A screw's position may be in mm or in rad: the refusal lists what the axis admits, the header may say it."""
    setup = load_stage(CONFIG / "ball-screw.yaml")
    (tmp_path / "log.csv").write_text("t,q,r,position_mm\n0,0,1,0\n0.5,12,2,12\n")
    with pytest.raises(RecordingError, match="rad, deg, rev") as caught:
        read(tmp_path / "log.csv", setup, {"time": "t", **words})
    assert caught.value.problems[0].kind is KIND.UNIT
    for place in ("position_mm", "4", "4:mm"):
        (named,) = read(tmp_path / "log.csv", setup, {"time": "t", "position": place})
        np.testing.assert_allclose(named.column("measured"), [0.0, 2.0 * math.pi])


def test_a_unit_of_another_quantity_is_told_which_there_are(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,q\n0,0\n0.5,12\n")
    with pytest.raises(RecordingError, match="mm, m, um, nm, rad, deg, rev, counts") as caught:
        read(tmp_path / "log.csv", load_stage(CONFIG / "ball-screw.yaml"), {"time": "t", "position": "2:A"})
    assert caught.value.problems[0].kind is KIND.UNIT


def test_a_linear_record_is_not_of_a_rotary_stage(tmp_path: Path) -> None:
    """The benchmark's layout, and our own export, say the kind of their axis."""
    setup, rows = load_stage(CONFIG / "ball-screw.yaml"), np.arange(3.0)
    savemat(tmp_path / "emps.mat", {"t": rows, "qm": rows, "qg": rows, "vir": rows, "gtau": 35.0})
    axis = json.dumps({"axis": {"kind": "linear", "travel_per_unit": 1.0, "travel_unit": "m"}})
    savemat(tmp_path / "own.mat", {"samples": {"time": rows, "measured": rows}, "meta": axis})
    for name in ("emps.mat", "own.mat"):
        assert len(read(tmp_path / name)) == 1
        with refused(RecordingError, file=tmp_path / name, kind=KIND.CONFLICT):
            read(tmp_path / name, setup)


@pytest.mark.parametrize(
    ("content", "token"),
    [
        (b"PK\x03\x04\x14\0" + bytes(40), "Excel"),
        (b"\xd0\xcf\x11\xe0" + bytes(40), "Excel"),
        (b"\x1f\x8b\x08" + bytes(40), "gunzip"),
        (b"\n<!DOCTYPE html>\n<html><table></table></html>", "HTML"),
    ],
)
@pytest.mark.parametrize("name", ["log.csv", "log.xlsx", "log.h5"])
def test_a_file_of_an_office_program_is_named(tmp_path: Path, name: str, content: bytes, token: str) -> None:
    """Whatever its name: as a log and as a recording."""
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=token) as caught:
        read(path)
    assert "zero bytes" not in str(caught.value) and caught.value.problems[0].file == path


@pytest.mark.parametrize("name", ["log.csv", "log.mat"])
def test_a_log_in_the_place_of_a_recording_is_imported_first(tmp_path: Path, name: str) -> None:
    """The remedy is a command and no name, as the log has the right one."""
    path = tmp_path / name
    path.write_text("time_s,position_rad\n0,0\n1,1\n")
    with refused(RecordingError, kind=KIND.SYNTAX, file=path) as caught:
        open_recording(path)
    assert f"stagectl import {path} -o {tmp_path / 'log.h5'}" in str(caught.value)


def test_a_header_below_other_rows_that_says_all_is_read(tmp_path: Path) -> None:
    """No guess is made, and the rows above are noted."""
    (tmp_path / "log.csv").write_text("# a\n# b\ntime_s,current_command_A,position_rad\n0,2,0\n1,2,1\n")
    (recording,) = read(tmp_path / "log.csv")
    assert recording.samples.dtype.names == ("time", "command", "measured")
    assert "first 3 rows" in recording.meta["notes"][0]


def test_a_header_may_have_a_separator_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,position_rad,current_A\n0\t0\t1\n1\t1\t2\n")
    (recording,) = read(tmp_path / "log.csv")
    np.testing.assert_array_equal(recording.column("measured_current"), [1.0, 2.0])


def test_another_unit_than_the_header_s_is_noted(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,q [rad]\n0,0\n1,1\n")
    for unit, noted in (("mm", True), ("rad", False)):
        (recording,) = read(tmp_path / "log.csv", columns={"time": "time_s", "position": f"2:{unit}"})
        assert any("its header says rad" in note for note in recording.meta["notes"]) is noted


@pytest.mark.parametrize(("end", "noted"), [("", True), ("25\n", False), ("25", False)])
def test_a_last_row_that_ends_early_is_noted(tmp_path: Path, end: str, noted: bool) -> None:
    (tmp_path / "log.csv").write_text(f"time_s,position_rad\n0.5,0.125\n0.7,0.1{end}")
    (recording,) = read(tmp_path / "log.csv")
    assert any("may be cut off" in note for note in recording.meta["notes"]) is noted


def foreign_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["pos"] = np.arange(3.0), np.arange(3.0)


CONTENTS: dict[str, Callable[[Path], object]] = {
    "foreign.h5": foreign_hdf5,
    "text.h5": lambda path: path.write_text("time_s,position_rad\n0,0\n1,1\n"),
    "bytes.h5": lambda path: path.write_bytes(bytes(range(256)) * 8),
    "renamed.csv": foreign_hdf5,
}


@pytest.mark.parametrize("name", CONTENTS)
def test_a_name_that_is_wrong_is_not_believed(tmp_path: Path, name: str) -> None:
    """Whoever reads it says what the file holds; none sends the user to the other."""
    path = tmp_path / name
    CONTENTS[name](path)
    said = set()
    for reader in (read, open_recording) if path.suffix == ".h5" else (read,):
        with refused(RecordingError, kind=KIND.SYNTAX, file=path) as caught:
            reader(path)
        said.add(str(caught.value))
    assert len(said) == 1 and "already" not in said.pop()


@pytest.mark.parametrize(("name", "word"), [("ball-screw", "stage"), ("trajectories/sine-1.6hz", "trajectory")])
def test_a_yaml_file_in_the_place_of_a_log_is_told_by_its_entries(name: str, word: str) -> None:
    path = CONFIG / f"{name}.yaml"
    with refused(RecordingError, kind=KIND.SHAPE, file=path) as caught:
        read(path)
    assert f"is a {word}" in str(caught.value)


def test_time_and_position_alone_are_not_the_benchmark(tmp_path: Path) -> None:
    """Its layout has vir and gtau; a vector that is a row short is named, not dropped."""
    rows = np.arange(1000.0)
    savemat(tmp_path / "own.mat", {"t": rows, "qm": np.sin(rows), "i": rows})
    with refused(RecordingError, kind=KIND.MISSING):
        read(tmp_path / "own.mat")
    savemat(tmp_path / "short.mat", {"t": rows, "qm": np.sin(rows), "i": rows[1:]})
    with refused(RecordingError, kind=KIND.SHAPE, column="i"):
        read(tmp_path / "short.mat")
    savemat(tmp_path / "parameter.mat", {"time_s": rows, "position_rad": np.sin(rows), "poles": [1.0, 2.0, 3.0]})
    assert len(read(tmp_path / "parameter.mat")[0].samples) == 1000


def test_a_command_that_is_not_there_is_not_said_to_be_used(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,position_rad\n0,0\n1,1\n2,2\n")
    assert not [note for note in read(tmp_path / "log.csv")[0].meta["notes"] if "is used" in note]
