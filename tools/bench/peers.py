"""Ours beside its peers, one page: ``python tools/bench --page bench.html [--manual docs/peers.md] [--json FILE]``.

Ours and theirs take turns in each comparison; what cannot be measured here is named with the reason.  ``--only PART``
measures one part anew and keeps the others of ``--json FILE``.  The exam's figures are read, not measured: the last
line of the ledger, and the scores of an exam that was held with ``--baselines``, where one is given.
"""

import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import codec
import engines
import identification
import standing
import wakeup
from measure import Against, versus
from scene import STAGE
from stagectl_studies.exam import ledger

from stagectl.service import virtual_drive

LEDGER = STAGE.parents[1] / "docs" / "exam-ledger.jsonl"
LARGE = 100  # trials, from which an exam's rates say something
_NAMES = ("stagectl", "canopen", "moteus", "mujoco", "scipy", "cma", "numpy", "numba")
Found = tuple[list[Against], dict[str, str]]


PARTS = ("wake-up", "codec", "simulator", "identification", "standing")


class Wish(NamedTuple):
    """What is to be measured."""

    quick: bool = False
    only: str = ""  # one of PARTS; empty: all
    exam: Path | None = None  # scores of an exam with baselines


def measure(wish: Wish, before: dict[str, Any], tell: Callable[[str], None]) -> dict[str, Any]:
    """Everything, as JSON values; of `before` what is not measured now."""
    rounds = 3 if wish.quick else 7
    parts: tuple[Callable[[], Found], ...] = (
        lambda: wake_up(2.0 if wish.quick else 5.0, rounds),
        lambda: _on_the_bus(rounds),
        lambda: (engines.against(rounds), {}),
        lambda: _fits(1 if wish.quick else 3),
        lambda: standing.rows(rounds),
    )
    found: dict[str, Any] = dict(before.get("parts", {}))
    for name, part in zip(PARTS, parts, strict=True):
        if wish.only in ("", name):
            tell(name)
            lines, skipped = part()
            found[name] = {"against": [{**one._asdict(), **_spreads(one)} for one in lines], "skipped": skipped}
    return {
        "parts": {name: found[name] for name in PARTS if name in found},
        "machine": f"{platform.machine()}, {os.cpu_count()} CPUs, Linux {platform.release()}",
        "date": time.strftime("%Y-%m-%d"),
        "load": round(os.getloadavg()[0], 1),
        "versions": {"Python": platform.python_version(), **_versions()},
        "exam": _exam(wish.exam),
    }


def _spreads(line: Against) -> dict[str, Any]:
    return {name: getattr(line, name)._asdict() for name in ("ours", "theirs", "ratio")}


def _versions() -> dict[str, str]:
    found = {}
    for name in _NAMES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def wake_up(seconds: float, rounds: int) -> Found:
    """The loop's metronome beside cyclictest."""
    if shutil.which("cyclictest") is None:
        return [], {"loop wake-up against cyclictest": "there is no cyclictest: apt install rt-tests"}
    try:
        slices = wakeup.sliced(seconds, rounds)
    except (SystemExit, subprocess.CalledProcessError) as error:
        return [], {"loop wake-up against cyclictest": str(error).strip().splitlines()[-1]}
    method = (
        "how late a period of 1 ms begins, with SCHED_FIFO, memory locked, on one CPU; in turn, "
        f"{rounds} slices of {seconds:g} s each; cyclictest is written in C and counts whole microseconds, ours is the "
        "loop's metronome in Python"
    )
    lines = []
    for name, words in (("metronome", ""), ("with spin", ", 50 us of spin")):
        for column, share in enumerate(wakeup.SHARES):
            late = (
                [max(one[column], 1.0) for one in slices[name]],
                [max(one[column], 1.0) for one in slices["cyclictest"]],
            )
            told = ("Loop wake-up", "cyclictest", f"late at p{100 * share:g}{words}")
            lines.append(versus(told, late, ("us", 1.0), method))
    return lines, {}


def _on_the_bus(rounds: int) -> Found:
    with tempfile.TemporaryDirectory(prefix="stagectl-") as folder:
        channel = str(Path(folder) / "bus")
        node = virtual_drive.start(STAGE, channel, 1)
        try:
            return codec.rows(channel, rounds)
        finally:
            node.terminate()
            node.wait()


def _fits(rounds: int) -> Found:
    with tempfile.TemporaryDirectory(prefix="stagectl-") as folder:
        return identification.against(Path(folder), rounds)


def _exam(scores: Path | None) -> dict[str, Any]:
    """What exams have shown: the last large one of the ledger, and diagnosis and baselines on the same trials."""
    held = [{**one, "trials": one.get("stopped after", one["trials"])} for one in ledger.read(LEDGER)]
    last = [one for one in held if one["trials"] >= LARGE][-1]
    beside = json.loads(scores.read_text(encoding="utf-8"))["beside"] if scores else []
    return {"last": {name: last[name] for name in ("date", "version", "full", "scores", "trials")}, "beside": beside}


def main(page: Path, manual: Path | None, written: Path | None, wish: Wish) -> None:
    """Measure, and write what is asked for."""
    import peers_page

    before = json.loads(written.read_text(encoding="utf-8")) if wish.only and written and written.exists() else {}
    found = measure(wish, before, lambda name: print(f"measuring: {name}", file=sys.stderr, flush=True))
    if written:
        written.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    peers_page.write_all(found, page, manual)
