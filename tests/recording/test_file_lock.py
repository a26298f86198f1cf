"""A recording's file appears under its name when it can be read; what a killed writer leaves is taken away."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from stagectl.problem import ProblemKind
from stagectl.recording.file_lock import beginning, being_written, claimed, discard
from stagectl.recording.hdf5 import RecordingError, Writer, open_recording, save
from tests.problems import refused
from tests.recording.test_recorder import COLUMNS, META

ROWS = np.zeros(3, dtype=[(name, "<f8") for name in COLUMNS])
# A writer that is killed over the creation of its file, at the moment that `WHERE` says.
KILLED = """
import os, signal, sys
from pathlib import Path
from stagectl.recording import hdf5
from tests.recording.test_recorder import COLUMNS, META
whole, moment = getattr(hdf5.MODULE, "NAME"), int(sys.argv[2])
def dies(*words, **more):
    if moment:
        whole(*words, **more)
    os.kill(os.getpid(), signal.SIGKILL)
hdf5.MODULE.NAME = dies
hdf5.Writer(Path(sys.argv[1]), META, COLUMNS)
"""
MOMENTS = [("h5py", "File"), ("json", "dumps"), ("os", "posix_fallocate"), ("os", "replace")]


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("where", MOMENTS)
def test_a_writer_killed_over_its_beginning_leaves_no_file_that_cannot_be_read(
    tmp_path: Path, where: tuple[str, str], after: bool
) -> None:
    script, path = KILLED.replace("MODULE", where[0]).replace("NAME", where[1]), tmp_path / "a.h5"
    done = subprocess.run([sys.executable, "-c", script, str(path), str(int(after))], timeout=120)
    assert done.returncode == -signal.SIGKILL
    if path.exists():
        assert after and where == ("os", "replace")
        assert len(open_recording(path).samples) == 0
    else:
        assert discard(path)
    assert list(tmp_path.iterdir()) == ([path] if path.exists() else [])
    save(path, META, ROWS, "complete")  # nothing stands in the way of the next one
    assert open_recording(path).complete and os.listdir(tmp_path) == ["a.h5"]


def test_one_writer_at_a_time_from_the_first_moment_on(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with claimed(path):
        for begins in (lambda: claimed(path), lambda: Writer(path, META, COLUMNS)):
            with refused(RecordingError, kind=ProblemKind.CONFLICT, file=path):
                begins()
        assert not discard(path)  # it is at work
    assert discard(path) and not discard(path)
    writer = Writer(path, META, COLUMNS)
    assert being_written(path) and not beginning(path).exists()
    with refused(RecordingError, kind=ProblemKind.CONFLICT, file=path):
        Writer(path, META, COLUMNS)
    writer.close("complete", 0)
    assert not being_written(path) and os.listdir(tmp_path) == ["a.h5"]


def test_what_must_not_be_written_over_stays(tmp_path: Path) -> None:
    path, other = tmp_path / "a.h5", tmp_path / "elsewhere.h5"
    h5py.File(path, "w").close()
    with refused(RecordingError, kind=ProblemKind.CONFLICT, file=path):
        save(path, META, ROWS, "complete")
    assert os.listdir(tmp_path) == ["a.h5"]
    save(other, META, ROWS, "first")
    path.unlink()
    path.symlink_to(other)
    save(path, META, ROWS, "second")
    assert path.is_symlink() and open_recording(other).ended == "second"
