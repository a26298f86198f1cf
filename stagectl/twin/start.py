"""What a run needs to have its twin beside it: the order, and where the twin writes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from stagectl.config.stage_file import Setup
from stagectl.gap.logs.session import GapError
from stagectl.kernels import law
from stagectl.recording.metadata import portable
from stagectl.recording.ring import Ring
from stagectl.service.child_process import Companion
from stagectl.twin.process import Order
from stagectl.twin.record import FORMAT

SUFFIX = ".twin.json"
ANSWER = 1e-9  # A; the ring holds what the law computed, unrounded, and both kinds of kernels give the same bits


def companion(setup: Setup, running: law.Law, recording: Path, record: Path | None = None) -> Companion:
    """The twin of this run: a snapshot beside the `recording`, the slow record beside it or where `record` says."""
    axis, p = setup.file.axis, setup.stage
    about = {
        "name": setup.file.name,
        "kind": axis.kind,
        "recording": str(recording),
        "limit": ANSWER,
    }
    files = (str(live_file(recording)), str(record or slow_record(setup, recording)))

    def order(ring: Ring, alive: int) -> Order:
        place = (ring.descriptor, ring.width, ring.capacity, alive)
        return Order(*place, portable(running), portable(p), setup.dt, about, *files, setup.file.realtime.cpu)

    return Companion("stagectl.twin.process", order)


def live_file(recording: Path) -> Path:
    """Where the twin of a run writes what it sees now."""
    return recording.with_name(recording.name.removesuffix(".h5") + SUFFIX)


def slow_record(setup: Setup, recording: Path) -> Path:
    """Where the twins of an axis write their minutes, run after run."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", setup.file.name).strip("-") or "axis"
    return recording.parent / f"twin-{plain}.jsonl"


def newest(folder: Path) -> Path | None:
    """The live file that was written last."""
    return max(folder.glob(f"*{SUFFIX}"), key=lambda path: path.stat().st_mtime, default=None)


def seen(path: Path) -> dict[str, Any]:
    """What the twin wrote last.

    Raises GapError where the file is not a twin's.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise GapError(f"{path} cannot be read: {error}; a run with --twin writes one beside its recording") from error
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise GapError(f"{path} is no file of a twin ({FORMAT}); a run with --twin writes one beside its recording")
    return found
