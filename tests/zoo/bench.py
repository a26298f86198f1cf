"""A foreign drive and our program as processes, and the judgement of what came of it."""

from __future__ import annotations

import contextlib
import io
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import NamedTuple
from unittest import mock

from stagectl.cli import main
from tests.conftest import ROOT
from tests.zoo.diary import Diary
from tests.zoo.stage import MOTION, NODE, Files, write
from tests.zoo.table import Row
from tests.zoo.variants import named

PATIENCE = 180.0  # s until anything is given up: the machine is shared
DROP = 1e-4  # m, of a vertical axis (issue 19)
STANDSTILL = 5e-5  # m: an axis that moved less did not move
SECOND_NODE = 6


def until(true: Callable[[], bool], what: object = "", seconds: float = PATIENCE) -> None:
    """Wait for something; an AssertionError with `what` where it does not come true."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, what() if callable(what) else what
        time.sleep(0.02)


@contextlib.contextmanager
def drive(name: str, files: Files, *more: str) -> Iterator[Diary]:
    """The variant as a process on the bus; `more` are words for its command line."""
    variant, processes = named(name), []
    try:
        processes.append(_start(name, files.bus, files.diary, NODE, *more))
        if variant.second_node:
            processes.append(_start("extra-pdos", files.bus, files.diary.with_suffix(".2"), SECOND_NODE))
        diary = Diary(files.diary)
        until(lambda: bool(diary.lines("start")), "the drive did not start")
        yield diary
    finally:
        for process in processes:
            process.terminate()
            process.wait(timeout=PATIENCE)


def _start(name: str, bus: Path, diary: Path, node: int, *more: str) -> subprocess.Popen[str]:
    words = ["tests.zoo.node", name, "--channel", str(bus), "--diary", str(diary), "--node", str(node), *more]
    return subprocess.Popen([sys.executable, "-m", *words], cwd=ROOT, text=True)


def run_command(files: Files) -> list[str]:
    """What starts `run` as a process."""
    return [sys.executable, "-m", "stagectl", *_words(files)]


def _words(files: Files) -> list[str]:
    words = ["run", str(files.stage), str(files.motion), "--channel", str(files.bus)]
    return [*words, "-o", str(files.stage.with_name("run.h5"))]


class Result(NamedTuple):
    """How a try ended."""

    outcome: str  # moves, refuses, stops; or "hangs", "silent failure"
    words: str  # all that the program said
    diary: Diary


def prepared(folder: Path, row: Row, motion: str = MOTION) -> Files:
    """The files of a row."""
    return write(folder, named(row.variant), row.wire, motion)


def run(folder: Path, row: Row, *more: str) -> Result:
    """`stagectl run` against the row's drive."""
    files = prepared(folder, row)
    with drive(row.variant, files, *more) as diary:
        code, words = _ended(_words(files))
        settle(diary)
    if code == 1 and "stopped after" not in words:
        code = 0  # late cycles of a busy computer keep an axis from settling in time; the motion was made all the same
    return Result(outcome(code, diary), words, diary)


class HangsError(BaseException):
    """It takes longer than anybody would wait."""


def _ended(words: list[str]) -> tuple[int, str]:
    """Exit code and words of a command of ours, in this process: a new one would only import everything again."""
    said = io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["stagectl", *words]),
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
        _within(PATIENCE),
    ):
        try:
            main()
        except SystemExit as ended:
            return int(ended.code or 0), said.getvalue()
        except HangsError:
            return -1, f"hangs: {said.getvalue()!r}"
    raise AssertionError("it ends without an exit code")


@contextlib.contextmanager
def _within(seconds: float) -> Iterator[None]:
    """A HangsError after so long."""

    def late(number: int, frame: FrameType | None) -> None:
        raise HangsError

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def settle(diary: Diary) -> None:
    """Wait until the axis is at rest without power; go on after a while, the judgement sees it."""
    with contextlib.suppress(AssertionError):
        until(diary.stands, seconds=10.0)


def outcome(code: int, diary: Diary) -> str:
    """By exit code and diary."""
    moved = diary.moved() > STANDSTILL
    if code == 0:
        return "moves" if moved else "silent failure"
    return "hangs" if code < 0 else "stops" if moved else "refuses"


def objections(result: Result, row: Row, served: bool = False) -> list[str]:
    """What is wrong with a result; empty: as the table says."""
    allowed = row.served if served and row.served is not None else row.allowed
    wrong = [] if result.outcome in allowed else [f"{result.outcome}, wanted {' or '.join(sorted(allowed))}"]
    if result.outcome != "moves":
        wrong += [f"does not say {word}" for word in row.says if not _in(word, result.words)]
        wrong += [f"says {word}" for word in row.never if _in(word, result.words)]
    return wrong + unsafe(result.diary, row.bare) + fallen(row, result.diary) + _unwritten(result, row)


def unsafe(diary: Diary, bare: bool = False, holding: bool = False) -> list[str]:
    """Power without a monitor (unless a person accepts that: `bare`), and power or speed that stays.

    A drive may hold the axis by itself, in Quick stop active, where that is its way to stop (`holding`).
    """
    wrong = []
    if not diary.lines("sample"):
        return ["the drive was never heard of"]
    if not bare and (moved := diary.unsupervised()) >= 0.0:
        wrong.append(f"enabled without a monitor that stops, moved {1e3 * moved:.2f} mm so")
    if not diary.stands(holding):
        wrong.append(f"left with power {diary.last['powered']} at {1e3 * diary.last['v']:.1f} mm/s")
    return wrong


def fallen(row: Row, diary: Diary) -> list[str]:
    """What is wrong with how the variant's weight was held."""
    drop = diary.dropped() if named(row.variant).gravity else 0.0
    return [f"the weight fell by {1e3 * drop:.2f} mm"] if drop > DROP else []


def _unwritten(result: Result, row: Row) -> list[str]:
    """Objects that must hold something at the end of a motion, and were not written so."""
    if result.outcome != "moves":
        return []
    held = result.diary.held()
    values = {key: int.from_bytes(bytes.fromhex(held[key]), "little") for key in row.written if key in held}
    return [
        f"0x{key >> 8:04X}:{key & 0xFF:02X} was not written {allowed}, but {values.get(key)}"
        for key, allowed in row.written.items()
        if values.get(key) not in allowed
    ]


def _in(pattern: str, words: str) -> bool:
    return re.search(pattern, " ".join(words.split()), re.IGNORECASE) is not None


def last_words(words: str) -> str:
    """The message without progress bars and results, in one line."""
    lines = [line for line in words.replace("\r", "\n").splitlines() if line.strip() and "━" not in line]
    lines = [
        line
        for line in lines
        if not line.startswith(("foreign drive, motion", "recorded:", "next, once", "the axis did"))
    ]
    return " ".join(" ".join(lines[-8:]).split())[-600:]
