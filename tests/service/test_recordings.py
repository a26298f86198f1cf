"""Recordings of an axis whose rows the test writes: where they begin, how they end, and what is refused."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
import pytest

from stagectl.recording.file_lock import beginning, claimed
from stagectl.recording.hdf5 import Writer, open_recording
from stagectl.service.axis_controller import COLUMNS, AxisController, ServiceError
from stagectl.service.machine import machine
from stagectl.service.recordings import Recordings, about
from tests.conftest import CONFIG

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
    with pytest.raises(ServiceError, match=r"axis is being recorded: one\.h5"):
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
    with pytest.raises(ServiceError, match="no recording"):
        Recordings(tmp_path).path(*place)
