"""What a person wrote by hand is never replaced by a result; what stagectl wrote is, by a result of the same kind."""

from __future__ import annotations

import errno
import json
import os
import resource
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import stagectl as sc
from stagectl.extras import arrow
from stagectl.interchange.export import write_texts
from stagectl.problem import ProblemKind
from stagectl.recording import learned_current
from stagectl.recording.export_targets import SUFFIXES
from stagectl.recording.exports import WRITERS, export, write_columns
from stagectl.recording.hdf5 import open_recording, save
from stagectl.recording.learned_current import Learned
from stagectl.replacing import JSON, PAGE, check_folder_to_be, check_replaceable, replaced, write_text
from stagectl.units import StageError
from tests.conftest import CONFIG, Command
from tests.problems import refused

BY_HAND = "# mine\n"


@pytest.fixture
def recording(tmp_path: Path, command: Command) -> Path:
    (tmp_path / "sine.yaml").write_text("{type: sine, amplitude: 1 mm, frequency: 2 Hz, periods: 2}")
    assert command("simulate", CONFIG / "ball-screw.yaml", tmp_path / "sine.yaml", "-o", tmp_path / "a.h5")[0] == 0
    return tmp_path / "a.h5"


@pytest.mark.parametrize(
    ("drive", "kept"),
    [
        ("CANopen node 5 on socketcand can0@host:29536", True),
        ("ODrive 0 on /dev/ttyACM0 at 115200 baud", True),
        ("CANopen node 5 on embedded stage", False),
        ("simulated, compiled", False),
    ],
)
def test_what_a_machine_has_done_is_left(recording: Path, command: Command, drive: str, kept: bool) -> None:
    """A repeat gives back a simulation, and nothing else."""
    measured = open_recording(recording)
    save(recording, {**measured.meta, "drive": {"drive": drive}}, measured.samples, "done")
    before = recording.read_bytes()
    code, _, error = command("simulate", CONFIG / "ball-screw.yaml", recording.with_name("sine.yaml"), "-o", recording)
    assert (code, recording.read_bytes() == before) == ((2, True) if kept else (0, False)), error


@pytest.mark.parametrize("mark", [JSON, PAGE])
def test_another_kind_of_file_is_left(tmp_path: Path, mark: str) -> None:
    path = tmp_path / "there.html"
    check_replaceable(path, mark)
    for content in ("", f"<!doctype html>\n{mark}"):
        path.write_text(content)
        check_replaceable(path, mark)
    path.write_text(BY_HAND)
    with refused(StageError, kind=ProblemKind.CONFLICT, file=path):
        check_replaceable(path, mark)


def test_a_self_test_refuses_its_page_before_it_takes_its_minutes(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stagectl.selftest.matrix.run", lambda *_: pytest.fail("it has begun"))
    page = tmp_path / "mine.html"
    page.write_text(BY_HAND)
    code, _, error = command("selftest", CONFIG / "ball-screw.yaml", "--report", page)
    assert code == 2 and f"{page} exists" in error
    assert page.read_text() == BY_HAND


def test_the_export_of_another_stage_is_said_to_be_that(tmp_path: Path) -> None:
    """It is of the kind that is written, but of another name."""
    write_texts({tmp_path / "m.xml": '<mujoco model="one">\n'})
    with refused(StageError, kind=ProblemKind.CONFLICT, file=tmp_path / "m.xml") as caught:
        write_texts({tmp_path / "m.xml": '<mujoco model="two">\n'})
    assert "kind" not in str(caught.value)


@pytest.mark.parametrize("to", WRITERS)
def test_an_export_replaces_an_export_whose_name_was_typed(recording: Path, to: str) -> None:
    loaded = [open_recording(recording)]
    (written,) = export(loaded, to, None)
    with refused(StageError, kind=ProblemKind.CONFLICT, file=written.path):  # it may have been edited
        export(loaded, to, None)
    export(loaded, to, written.path)
    written.path.write_text(BY_HAND)
    with refused(StageError, kind=ProblemKind.CONFLICT, file=written.path):
        export(loaded, to, written.path)
    assert written.path.read_text() == BY_HAND


def test_a_page_and_an_answer_replace_their_like(recording: Path, command: Command) -> None:
    page, answer = recording.with_suffix(".html"), recording.with_suffix(".json")
    for _ in range(2):
        assert command("report", recording, "--json", answer)[0] == 0
    for mine in (page, answer):
        before = mine.read_text()
        mine.write_text(BY_HAND)
        code, _, err = command("report", recording, "--json", answer)
        assert (code, mine.read_text(), str(mine) in err) == (2, BY_HAND, True)
        mine.write_text(before)


def test_models_of_a_stage_have_pages_of_their_own(tmp_path: Path, command: Command) -> None:
    stage, model = CONFIG / "ball-screw.yaml", tmp_path / "b.py"
    (tmp_path / "b.html").write_text(BY_HAND)
    for _ in range(2):
        assert command("export", stage, "--to", "isaac", "-o", model)[0] == 0
    assert (tmp_path / "b.html").read_text() == BY_HAND and (tmp_path / "b.isaac.html").is_file()
    model.write_text(BY_HAND)
    assert command("export", stage, "--to", "isaac", "-o", model)[0] == 2
    assert model.read_text() == BY_HAND


def test_a_stage_is_saved_over_itself_and_over_no_other(tmp_path: Path) -> None:
    mine, other = tmp_path / "mine.yaml", tmp_path / "other.yaml"
    shutil.copy(CONFIG / "ball-screw.yaml", mine)
    shutil.copy(CONFIG / "emps.yaml", other)
    changed = sc.load_stage(mine).changed({"mechanics.viscous": 0.15})
    with refused(StageError, kind=ProblemKind.CONFLICT, file=other):
        changed.save(other)
    for _ in range(2):
        changed.save(tmp_path / "copy.yaml")
    changed.save(mine)


def test_a_new_file_takes_its_place_whole_or_not_at_all(tmp_path: Path) -> None:
    path, link = tmp_path / "there.txt", tmp_path / "link.txt"
    link.symlink_to(path)
    write_text(link, "old")
    path.chmod(0o640)

    def half() -> None:
        with replaced(link) as fresh:
            fresh.write_text("ha")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(OSError, match="No space left") as caught:
        half()
    assert caught.value.filename == str(link)
    assert (path.read_text(), sorted(tmp_path.iterdir())) == ("old", [link, path])
    write_text(link, "new")
    assert (path.read_text(), link.is_symlink(), path.stat().st_mode & 0o777) == ("new", True, 0o640)


@pytest.mark.parametrize("to", ["recording", "learned", *WRITERS])
def test_a_full_disk_leaves_the_older_file(recording: Path, to: str) -> None:
    """The limit of this process on the size of a file stands for the disk."""
    loaded, target = open_recording(recording), recording.with_name("old.h5")
    if to in WRITERS:
        target = target.with_suffix(SUFFIXES[to])

    many = np.zeros(50_000)

    def write() -> None:
        if to == "recording":
            save(target, loaded.meta, loaded.samples, "")
        elif to == "learned":
            learned_current.save(target, Learned(many, many, many, {}))
        else:
            export([loaded], to, target)

    write()
    before = {path: path.read_bytes() for path in target.parent.iterdir()}
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        with pytest.raises(StageError) as caught:
            write()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.problems[0].file == target
    assert {path: path.read_bytes() for path in target.parent.iterdir()} == before


@pytest.mark.parametrize("name", ["captures.yaml", "nominal.yaml", "a-1.csv"])
def test_a_folder_of_captures_replaces_only_its_like(recording: Path, command: Command, name: str) -> None:
    loaded, folder, table = open_recording(recording), recording.with_name("hand"), recording.with_name("a.csv")
    loaded.meta["capture"] = {"experiment": "a"}
    for _ in range(2):
        export([loaded], "folder", folder)
    shutil.rmtree(folder)
    folder.mkdir()
    mine = folder / name
    mine.write_text(BY_HAND)
    with refused(StageError, kind=ProblemKind.CONFLICT, file=mine):
        export([loaded], "folder", folder)
    write_columns(table, {"time_s": loaded.column("time"), "position_rad": loaded.column("measured")})
    code, _, err = command("import", table, "--stage", CONFIG / "ball-screw.yaml", "-o", folder)
    assert (code, str(mine) in err) == (2, True)
    assert ([*folder.iterdir()], mine.read_text()) == ([mine], BY_HAND)


def test_a_folder_of_captures_takes_the_place_of_no_file(recording: Path) -> None:
    mine = recording.with_name("notes.yaml")
    mine.write_text(BY_HAND)
    with refused(StageError, kind=ProblemKind.FILE, file=mine):
        export([open_recording(recording)], "folder", mine)


@pytest.mark.parametrize("name", ["a.yaml", "a.yaml/sub/folder", "shut/sub"])
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "a.yaml").write_text("name: a")
    (tmp_path / "shut").mkdir()
    monkeypatch.setattr(os, "access", lambda place, _: Path(place) != tmp_path / "shut")  # root may do anything
    with refused(StageError, kind=ProblemKind.FILE, file=tmp_path / name):
        check_folder_to_be(tmp_path / name)
    check_folder_to_be(tmp_path / "new" / "folder")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.yaml", "shut"]


def test_a_log_made_for_stagectl_is_no_export(recording: Path, tmp_path: Path) -> None:
    """It begins as an export does: with the columns that stagectl asks of logs."""
    loaded, own = open_recording(recording), tmp_path / "own.csv"
    for text in ("time_s,position_mm,current_A\n0,0,0\n", "time_s,reference_rad,measured_rad,command_A\n0,0,0,0\n"):
        own.write_text(text)
        with refused(StageError, kind=ProblemKind.CONFLICT, file=own):
            export([loaded], "csv", own)
        assert own.read_text() == text
    samples = tmp_path / "own-samples.csv"
    samples.write_text("time_s,reference_rad\n0,0\n")
    with refused(StageError, kind=ProblemKind.CONFLICT, file=samples):
        export([loaded], "trajectory", tmp_path / "own.yaml")


@pytest.mark.parametrize("to", ["parquet", "mat", "mcap"])
def test_a_file_of_the_same_format_is_no_export(recording: Path, to: str) -> None:
    loaded, path = open_recording(recording), recording.with_suffix(SUFFIXES[to])
    if to == "parquet":
        arrow().parquet.write_table(arrow().table({"time_s": [0.0]}), path)
    elif to == "mat":
        savemat(path, {"samples": 1.0, "time_s": 0.0})
    else:
        path.write_bytes(b"\x89MCAP0\r\n\x01\x1c\0\0\0\0\0\0\0\x04\0\0\0ros2\x10\0\0\0libmcap and 1.2.0stagectl")
    before = path.read_bytes()
    with refused(StageError, kind=ProblemKind.CONFLICT, file=path):
        export([loaded], to, path)
    assert path.read_bytes() == before


def test_json_of_another_program_is_left(recording: Path, command: Command) -> None:
    mine = recording.with_name("package.json")
    mine.write_text(text := json.dumps({"name": "mine"}, indent=2))
    code, _, err = command("report", recording, "--json", mine)
    assert (code, mine.read_text(), str(mine) in err) == (2, text, True)
