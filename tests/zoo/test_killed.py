"""Kill -9 of the real-time process in mid-motion: each foreign drive that moves comes to rest, soon enough."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.conftest import ROOT, child_of
from tests.zoo.bench import PATIENCE, drive, fallen, prepared, run_command, unsafe, until
from tests.zoo.diary import Diary
from tests.zoo.distances import longest_stop
from tests.zoo.sample import sample
from tests.zoo.stage import LONG_MOTION
from tests.zoo.table import MOVES, ROWS, Row

MOVING = {row.title: row for row in ROWS if row.allowed & MOVES and not row.bare}
FEW = ("plain", "guarding-only", "heartbeat-only", "rpdo-timer-only", "vertical")
_UNDER_WAY = 1e-3  # m


def _loop(process: subprocess.Popen[str]) -> int:
    return child_of(process.pid, "stagectl.realtime.axes") or 0


def _kill_in_motion(process: subprocess.Popen[str], diary: Diary) -> float:
    """The moment of the signal; 0 where the program ended before: it refused."""
    until(lambda: diary.moved() > _UNDER_WAY or process.poll() is not None, "neither moves nor ends")
    if process.poll() is not None:
        return 0.0
    os.kill(_loop(process), signal.SIGKILL)
    return time.monotonic()


@contextlib.contextmanager
def _running(command: list[str]):  # type: ignore[no-untyped-def]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(timeout=PATIENCE)


@pytest.mark.parametrize("title", sample(MOVING, FEW))
def test_it_stands_within_the_distance(title: str, tmp_path: Path) -> None:
    row: Row = MOVING[title]
    files = prepared(tmp_path, row, LONG_MOTION)
    with drive(row.variant, files) as diary, _running(run_command(files)) as process:
        killed = _kill_in_motion(process, diary)
        until(lambda: diary.stands(row.holding), lambda: diary.last, seconds=60.0)
        assert unsafe(diary, holding=row.holding) + fallen(row, diary) == []
        if killed:
            assert diary.moved_after(killed) <= longest_stop(diary)
