"""CSV trajectories, broken in every way: an error with file and line, never a hang."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from stagectl.config.source import UnreadableError
from stagectl.config.trajectory_file import load_free
from stagectl.problem import ProblemKind
from stagectl.trajectories import Recorded
from stagectl.units import StageError
from tests.problems import refused

GOOD = "time_s,reference_mm\n" + "".join(f"{0.1 * k:.1f},{k * k * 0.01}\n" for k in range(8))


def load(folder: Path, data: bytes | None) -> Recorded:
    if data is not None:
        (folder / "log.csv").write_bytes(data)
    (folder / "move.yaml").write_text("{type: csv, file: log.csv}")
    trajectory = load_free(folder / "move.yaml")
    assert isinstance(trajectory, Recorded)
    return trajectory


@pytest.mark.parametrize("data", [GOOD, "\ufeff" + GOOD, GOOD.replace("\n", "\r\n"), GOOD.replace(",", " , ")])
def test_usual_dialects_are_read(tmp_path: Path, data: str) -> None:
    loaded = load(tmp_path, data.encode())
    assert len(loaded.time) == 8
    assert loaded.position[7] == pytest.approx(0.49e-3)


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (b"", ":1"),
        (b"\n\n", ":1"),
        (GOOD.encode().replace(b"0.3,", b"\xff,"), ":5"),
        (GOOD.encode().replace(b"0.3,0.09", b"0.3"), ":5"),
        (GOOD.encode().replace(b"0.3,0.09", b"0.3,nan"), ":5"),
        (GOOD.encode().replace(b"0.3,0.09", b"0.3,1e999"), ":5"),
        (GOOD.encode().replace(b"0.3,0.09", b"0.3,0.0_9"), ":5"),
        (GOOD.encode().replace(b"0.3,0.09", "0.3,\u0663".encode()), ":5"),
        (GOOD.encode().replace(b"reference_mm", b"reference_kg"), ":1"),
        (GOOD.encode().replace(b"time_s", b"time"), ":1"),
        (b"time_s,time_s,reference_mm\n0,0,0\n", ":1"),
        (GOOD.replace(",", ";").replace(".", ",").encode(), ":1"),
        (GOOD.encode().replace(b"0.3,", b"0.2,"), ":5"),
        (b"time_s,reference_mm\n0,0\n1,1\n", ""),
        (b'time_s,reference_mm\n0,"0\n' * 3, ":"),
    ],
)
def test_broken_ones_are_refused_with_their_place(tmp_path: Path, data: bytes, line: str) -> None:
    with pytest.raises(StageError) as caught:
        load(tmp_path, data)
    assert f"log.csv{line}" in str(caught.value) or (not line and "move.yaml" in str(caught.value))


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "log.csv")
    with refused(UnreadableError, kind=ProblemKind.FILE):
        load(tmp_path, None)
    (tmp_path / "log.csv").unlink()
    with refused(UnreadableError, kind=ProblemKind.FILE, key="file", file=tmp_path / "move.yaml", line=1):
        load(tmp_path, None)
    (tmp_path / "log.csv").symlink_to("/dev/zero")
    with refused(UnreadableError, kind=ProblemKind.FILE):
        load(tmp_path, None)
