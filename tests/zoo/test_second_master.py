"""A second controller that is started while a first one moves: it refuses with the right words, the first goes on."""

from __future__ import annotations

import subprocess
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT
from tests.zoo.bench import PATIENCE, drive, last_words, prepared, run_command, until
from tests.zoo.sample import sample
from tests.zoo.service import ServedZoo
from tests.zoo.stage import LONG_MOTION
from tests.zoo.table import EVERY, WIRING

NAMED = ("master", "controller", "another")  # one of these words
PLAIN = EVERY["plain"]
DISTANCES = (0.0002, 0.001, 0.003)  # m that the first has moved: just begun, in the ramp, under way


def _touched(lines: list[dict[str, Any]], since: float) -> list[dict[str, Any]]:
    """What a second controller did to the drive."""
    return [
        line for line in lines if line["t"] > since and line["kind"] in ("sdo", "nmt", "state", "boot", "emergency")
    ]


def _begin(command: list[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True)


@pytest.mark.parametrize(("reset", "moved"), sample(product(("none", "node"), DISTANCES), [("node", DISTANCES[-1])]))
def test_a_second_run_refuses(reset: str, moved: float, tmp_path: Path) -> None:
    files = prepared(tmp_path, PLAIN, LONG_MOTION)
    (tmp_path / "second").mkdir()
    second = prepared(tmp_path / "second", PLAIN)._replace(bus=files.bus)
    second.stage.write_text(second.stage.read_text().replace("reset: none", f"reset: {reset}"))
    with drive("plain", files) as diary:
        first = _begin(run_command(files))
        until(lambda: diary.moved() > moved, diary.lines)
        since = diary.last["t"]
        done = subprocess.run(run_command(second), cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
        touched, going_on = _touched(diary.lines(), since), diary.last["enabled"]
        first.terminate()
        first.wait(timeout=PATIENCE)
    words = (done.stdout + done.stderr).lower()
    assert (touched, going_on) == ([], True), last_words(words)
    assert done.returncode != 0
    assert any(word in words for word in NAMED) and not any(word in words for word in WIRING), last_words(words)


def test_a_service_refuses(tmp_path: Path) -> None:
    files = prepared(tmp_path, PLAIN, LONG_MOTION)
    (tmp_path / "second").mkdir()
    machine = ServedZoo(tmp_path / "second", PLAIN)
    (tmp_path / "second" / "bus").symlink_to(files.bus)
    with drive("plain", files) as diary:
        first = _begin(run_command(files))
        until(lambda: diary.moved() > 0.001, diary.lines)
        since = diary.last["t"]
        try:
            machine.start()
            enabled = machine.tries("enable")
            words = machine.words.lower()
            touched = _touched(diary.lines(), since)
        finally:
            machine.end()
            first.terminate()
            first.wait(timeout=PATIENCE)
    assert (touched, enabled) == ([], False), last_words(words)
    assert any(word in words for word in NAMED) and not any(word in words for word in WIRING), last_words(words)
