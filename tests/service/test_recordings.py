"""Recordings of an axis whose rows the test writes: where they begin, how they end, and what is refused."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from stagectl.config.stage_blocks import Retention
from stagectl.problem import ProblemKind
from stagectl.recording.file_lock import beginning, claimed
from stagectl.recording.hdf5 import Writer, open_recording
from stagectl.service.axis_controller import COLUMNS, AbsentError, AxisController, ServiceError
from stagectl.service.machine import machine
from stagectl.service.recordings import Recordings, about
from tests.conftest import CONFIG
from tests.problems import refused

PATIENCE = 60.0  # s: the machine is shared


@pytest.fixture
def axis() -> AxisController:
    return machine([str(CONFIG / "ball-screw.yaml")], None)["axis"]


def write(axis: AxisController, count: int) -> None:
    for _ in range(count):
        number = axis.ring.written
        axis.ring.write(((number + 1) * axis.setup.dt, *(float(number),) * (len(COLUMNS) - 1)))


def until_ended(recordings: Recordings, axis: AxisController) -> None:
    end = time.monotonic() + PATIENCE
    while recordings.status_json(axis) is not None and time.monotonic() < end:
        assert recordings.look() == []
        time.sleep(0.02)
    assert recordings.status_json(axis) is None


def test_it_begins_before_it_was_asked_for_and_ends_when_asked(axis: AxisController, tmp_path: Path) -> None:
    recordings = Recordings(tmp_path)
    write(axis, 1000)
    path = recordings.begin(axis, "one", 0.1, 3600.0)
    assert path == tmp_path / "recordings" / "axis" / "one.h5"
    with refused(ServiceError, kind=ProblemKind.CONFLICT):
        recordings.begin(axis, "two", 0.0, 1.0)
    write(axis, 600)
    status = recordings.status_json(axis)
    assert status is not None
    assert status["seconds"] == pytest.approx(0.4)
    assert recordings.end("axis") == path
    recording = open_recording(path)
    assert recording.complete
    assert recording.lost_rows == 0
    assert np.array_equal(recording.column("error"), np.arange(800.0, 1600.0))
    assert recording.meta["steady"] == pytest.approx([801 * 5e-4, 1601 * 5e-4])
    assert recording.meta["duration"] == pytest.approx(0.8)
    with pytest.raises(ServiceError, match="exists already"):
        recordings.begin(axis, "one", 0.0, 1.0)
    with pytest.raises(ServiceError, match="is not being recorded"):
        recordings.end("axis")
    (listed,) = recordings.files()
    assert (listed["kind"], listed["axis"], listed["file"], listed["going_on"]) == (
        "recordings",
        "axis",
        "one.h5",
        False,
    )
    assert recordings.path("recordings", "axis", "one.h5") == path


def test_it_ends_by_itself(axis: AxisController, tmp_path: Path) -> None:
    recordings = Recordings(tmp_path)
    write(axis, 10)
    path = recordings.begin(axis, "", 1.0, 0.01)
    time.sleep(0.05)
    until_ended(recordings, axis)
    assert len(open_recording(path).samples) == 10
    assert open_recording(path).complete


def test_two_without_a_name_in_one_second_have_two_names(
    axis: AxisController, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stagectl.service.recordings.time.strftime", lambda words: words.replace("%", ""))
    recordings, paths = Recordings(tmp_path), []
    for _ in range(3):
        write(axis, 10)
        paths.append(recordings.begin(axis, "", 1.0, 3600.0))
        recordings.end("axis")
    assert [path.name for path in paths] == ["Ymd-HMS.h5", "Ymd-HMS-2.h5", "Ymd-HMS-3.h5"]
    assert all(open_recording(path).complete for path in paths)


def test_the_end_of_the_real_time_process_is_written_down(axis: AxisController, tmp_path: Path) -> None:
    recordings = Recordings(tmp_path)
    write(axis, 10)
    path = recordings.begin(axis, "cut", 1.0, 3600.0)
    for child, patience in recordings.cut():
        assert child.wait(patience) == 0
    recording = open_recording(path)
    assert not recording.complete
    assert recording.ended == "the loop process died"
    assert len(recording.samples) == 10


def test_what_killed_processes_have_left_is_cleared_away_or_kept(axis: AxisController, tmp_path: Path) -> None:
    recordings, folder = Recordings(tmp_path), tmp_path / "blackbox" / "axis"
    folder.mkdir(parents=True)
    beginning(folder / "one.unfinished").write_bytes(bytes(100))
    rows = np.zeros(3, dtype=[(name, "<f8") for name in COLUMNS])
    going_on = Writer(folder / "two.unfinished", about(axis, "black box"), COLUMNS)
    going_on.append(rows.tobytes())
    writing = claimed(folder / "three.unfinished")
    assert list(recordings.tidy()) == []
    assert sorted(path.name for path in folder.iterdir()) == ["three.unfinished.begun", "two.unfinished"]
    going_on._held.close()  # as the kernel does when it is killed
    writing.close()
    assert list(recordings.tidy()) == ["two.h5"]
    assert [path.name for path in folder.iterdir()] == ["two.h5"]
    recording = open_recording(folder / "two.h5")
    assert len(recording.samples) == 3 and not recording.complete


def test_a_recorder_killed_before_its_file_can_be_read(axis: AxisController, tmp_path: Path) -> None:
    recordings = Recordings(tmp_path)
    path = recordings.begin(axis, "early", 0.0, 3600.0)
    running = recordings._running["axis"]
    running.child.signal(signal.SIGKILL)
    while running.child.ended is None:
        time.sleep(0.01)
    with claimed(path):  # what it leaves where it was killed over it
        pass
    assert recordings.look() == ["axis"]
    assert list(path.parent.iterdir()) == [] == recordings.files()


def test_an_axis_that_gives_no_rows(axis: AxisController, tmp_path: Path) -> None:
    """Its file goes as it came: until then it is listed as going on, afterwards not at all."""
    recordings = Recordings(tmp_path)
    recordings.begin(axis, "none", 0.0, 0.01)
    (listed,) = recordings.files()
    assert (listed["kind"], listed["axis"], listed["file"], listed["going_on"]) == (
        "recordings",
        "axis",
        "none.h5",
        True,
    )
    time.sleep(0.05)
    until_ended(recordings, axis)
    assert recordings.files() == []
    recordings.begin(axis, "none", 0.0, 3600.0)
    with pytest.raises(ServiceError, match="nothing was recorded"):
        recordings.end("axis")


@pytest.mark.parametrize("name", ["../one", "a/b", ".hidden", "x" * 81, "a\x00", "ü"])
def test_names_that_will_not_do(axis: AxisController, tmp_path: Path, name: str) -> None:
    with pytest.raises(ServiceError, match="must be letters, digits"):
        Recordings(tmp_path).begin(axis, name, 0.0, 1.0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "place", [("recordings", "..", "token"), ("..", "state", "key"), ("blackbox", "axis", "none.h5")]
)
def test_nothing_else_can_be_had(tmp_path: Path, place: tuple[str, str, str]) -> None:
    (tmp_path / "token").write_text("secret")
    with pytest.raises(AbsentError):
        Recordings(tmp_path).path(*place)


def test_what_is_too_old_or_too_much_goes_and_the_newest_stays(axis: AxisController, tmp_path: Path) -> None:
    """By age and by size over both kinds; files of another axis stay."""
    days = {"recordings/axis/a.h5": 1.0, "blackbox/axis/b.h5": 2.0, "recordings/axis/c.h5": 9.0, "blackbox/y/d.h5": 9.0}
    for name, age in days.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes(1 << 20))
        os.utime(path, (time.time() - age * 86400.0,) * 2)
    there = lambda: {name for name in days if (tmp_path / name).exists()}  # noqa: E731
    limits = {Retention(): set(), Retention(5.0): {"c"}, Retention(keep_gib=1.5 / 1024): {"b"}, Retention(0.1): set()}
    for limit, gone in limits.items():
        axis.setup = axis.setup.having(recordings=limit)
        before = there()
        words = list(Recordings(tmp_path).expire([axis]))
        assert {Path(name).stem for name in before - there()} == gone
        assert all(word.startswith("removed ") for word in words) and len(words) == len(gone)
