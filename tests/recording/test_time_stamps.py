"""Times that a log writes as dates or clock times: seconds since its first row, or an error that shows what may be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.problem import ProblemKind
from stagectl.recording.guess.importing import import_log
from stagectl.recording.hdf5 import RecordingError
from stagectl.recording.imports import read
from stagectl.recording.scales import Known
from stagectl.recording.time_stamps import ADMISSIBLE
from tests.problems import refused

WORDS = {"time": "1", "position": "2:mm"}


def _log(folder: Path, stamps: list[str], head: str = "timestamp,q", row: str = "{stamp},{k}") -> Path:
    lines = [row.format(stamp=stamp, k=k) for k, stamp in enumerate(stamps)]
    (folder / "log.csv").write_text("\n".join([head, *lines]) + "\n")
    return folder / "log.csv"


@pytest.mark.parametrize(
    ("stamps", "seconds"),
    [
        (["2024-03-05T09:12:00.000000", "2024-03-05T09:12:00.010000", "2024-03-05T09:12:01"], [0.0, 0.01, 1.0]),
        (["2024-12-31 23:59:59.999", "2025-01-01 00:00:00.001"], [0.0, 0.002]),
        (["2024-03-05T09:12:00Z", "2024-03-05T10:12:00.5+01:00", "2024-03-05T08:12:01-0100"], [0.0, 0.5, 1.0]),
        (["09:12:00.123", "09:12:00.133", "09:12:01"], [0.0, 0.01, 0.877]),
        (["23:59:59.5", "00:00:00.5", "00:00:01", "23:59:59", "00:00:00"], [0.0, 1.0, 1.5, 86399.5, 86400.5]),
        (["2024-03-05T09:12:00.000000001", "2024-03-05T09:12:00.000000003"], [0.0, 2e-9]),
        (["0", "0.25"], [0.0, 0.25]),
    ],
)
def test_stamps_are_seconds_since_the_first(tmp_path: Path, stamps: list[str], seconds: list[float]) -> None:
    (recording,) = read(_log(tmp_path, stamps), columns=WORDS)
    np.testing.assert_allclose(recording.column("time"), seconds, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(recording.column("measured"), 1e-3 * np.arange(len(stamps)))


@pytest.mark.parametrize("words", [None, {"time": "time", "position": "2"}, {"time": "1:ms", "position": "2"}])
def test_stamps_need_no_unit(tmp_path: Path, words: dict[str, str] | None) -> None:
    path = _log(tmp_path, ["2024-03-05T09:12:00.0", "2024-03-05T09:12:00.5"], "time,position_mm")
    (recording,) = read(path, columns=words)
    np.testing.assert_allclose(recording.column("time"), [0.0, 0.5])


def test_a_unit_in_the_name_of_a_stamp_is_not_applied(tmp_path: Path) -> None:
    (recording,) = read(_log(tmp_path, ["09:12:00.0", "09:12:00.5"], "time_ms,position_mm"))
    np.testing.assert_allclose(recording.column("time"), [0.0, 0.5])


@pytest.mark.parametrize("stamp", ["2024-03-05 09:12:0{k},5", "09:12:0{k},5", "2024-03-05T09:12:0{k}.5Z"])
def test_semicolons_and_decimal_commas(tmp_path: Path, stamp: str) -> None:
    """Title lines before the header, a second column that is text, and stamps with a comma or a point."""
    stamps = [stamp.format(k=k) for k in range(4)]
    path = _log(tmp_path, stamps, "Trace R2.1\nRobot: X\nZeit;Weg [mm]", "{stamp};{k},25")
    (recording,) = read(path, columns={"time": "Zeit", "position": "2"})
    np.testing.assert_allclose(recording.column("time"), [0.0, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(recording.column("measured"), 1e-3 * (np.arange(4) + 0.25))


def test_a_date_beside_the_time_is_left_alone(tmp_path: Path) -> None:
    path = _log(tmp_path, ["05.03.2024 09:12", "05.03.2024 09:12"], "date;t;q", "{stamp};0,{k};{k}")
    (recording,) = read(path, columns={"time": "t", "position": "q:mm"})
    np.testing.assert_allclose(recording.column("time"), [0.0, 0.1])


FIRST = "2024-03-05T09:12:00.5"


@pytest.mark.parametrize(
    ("stamps", "row", "value"),
    [
        ([FIRST, "2024-03-05T09:12:01.5Z", FIRST], 2, "'2024-03-05T09:12:01.5Z'"),
        ([FIRST, FIRST, "1.5", FIRST], 3, "'1.5'"),
        ([f"{FIRST}Z", FIRST, FIRST], 2, f"'{FIRST}'"),
        ([FIRST, "2024-02-30T09:12:00", FIRST], 2, "'2024-02-30T09:12:00'"),
        (["05.03.2024 09:12:00", "05.03.2024 09:12:01"], 1, "'05.03.2024 09:12:00'"),
        (["9:12:00.5", "9:12:01.5"], 1, "'9:12:00.5'"),
        (["2024-03-05 09:12", "2024-03-05 09:13"], 1, "'2024-03-05 09:12'"),
        (["09:12:00Z", "09:12:01Z"], 1, "'09:12:00Z'"),
        (["09:12:00", "25:12:01"], 2, "'25:12:01'"),
        (["0.5", FIRST, "1.5"], 2, f"'{FIRST}'"),
    ],
)
def test_a_wrong_stamp_is_shown_with_its_row(tmp_path: Path, stamps: list[str], row: int, value: str) -> None:
    path = _log(tmp_path, stamps)
    fields = {"kind": ProblemKind.VALUE, "file": path, "value": value, "choices": ADMISSIBLE}
    with refused(RecordingError, column="timestamp", row=row, **fields) as caught:
        read(path, columns=WORDS)
    assert value in str(caught.value) and "09:12:00.123" in str(caught.value)


def test_times_that_do_not_run_on_are_refused(tmp_path: Path) -> None:
    path = _log(tmp_path, ["09:12:00", "09:12:02", "09:12:01"])
    with refused(RecordingError, kind=ProblemKind.CONFLICT, column="timestamp", row=3):
        read(path, columns=WORDS)


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_a_row_without_its_stamp_is_left_out(tmp_path: Path, lost: int) -> None:
    stamps = ["09:12:00", "09:12:01", "09:12:02", "09:12:03"]
    stamps[lost] = ""
    (recording,) = read(_log(tmp_path, stamps), columns=WORDS)
    there = np.delete(np.arange(4.0), lost)
    np.testing.assert_allclose(recording.column("time"), there - there[0])
    np.testing.assert_allclose(recording.column("measured"), 1e-3 * there)


def test_no_other_quantity_is_a_date(tmp_path: Path) -> None:
    path = _log(tmp_path, ["09:12:00", "09:12:02"], row="{k},{stamp}")
    with refused(RecordingError, kind=ProblemKind.VALUE, column="q", row=1):
        read(path, columns=WORDS)


def test_a_time_in_the_last_column_may_be_cut_off(tmp_path: Path) -> None:
    path = _log(tmp_path, ["09:12:00", "09:12:01", "09:"], "q,timestamp", "{k},{stamp}")
    (recording,) = read(path, columns={"time": "2", "position": "1:mm"})
    assert len(recording.samples) == 2


def test_the_guess_knows_them(tmp_path: Path) -> None:
    rows = np.arange(200)
    stamps = [f"09:12:{0.05 * k:06.3f}" for k in rows]
    lines = [f"{stamp},{np.sin(0.1 * k):.6f}" for k, stamp in enumerate(stamps)]
    (tmp_path / "log.csv").write_text("\n".join(["when,x [rad]", *lines]) + "\n")
    ((recording, guess),) = import_log(tmp_path / "log.csv", None, None, Known(), unsure=True)
    assert guess is not None and guess.words["time"] == "1:s"
    np.testing.assert_allclose(recording.column("time"), 0.05 * rows, atol=1e-6)


def test_from_python(tmp_path: Path) -> None:
    stamps = [f"2024-03-05T09:12:00.{k:03d}" for k in range(5)]
    log = sc.load_log(_log(tmp_path, stamps), columns=WORDS)
    np.testing.assert_allclose(log["time"], 1e-3 * np.arange(5), atol=1e-12)
