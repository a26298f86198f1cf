"""What a run needs to have a twin: the order to its process, and where the twin writes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from stagectl.config.stage_file import Setup
from stagectl.gap.logs.session import GapError
from stagectl.kernels import law
from stagectl.problem import why_unread
from stagectl.recording.metadata import portable
from stagectl.recording.ring import Ring
from stagectl.service.child_process import Companion
from stagectl.twin.process import TwinOrder
from stagectl.twin.record import FORMAT
from stagectl.twin.thresholds import SAME_COMMAND

SUFFIX = ".twin.json"
_SOURCE = "a run with --twin writes one next to its recording"


def companion(setup: Setup, running: law.Law, recording: Path, record: Path | None = None) -> Companion:
    """The twin of this run: a snapshot next to the `recording`, the slow record next to it or in the file `record`."""
    axis, p = setup.file.axis, setup.stage
    about = {
        "name": setup.file.name,
        "kind": axis.kind,
        "recording": str(recording),
        "limit": SAME_COMMAND,
    }
    files = (str(live_file(recording)), str(record or slow_record(setup, recording)))

    def order(ring: Ring, alive: int) -> TwinOrder:
        law, model = portable(running), portable(p)
        return TwinOrder(ring.place, alive, law, model, setup.dt, about, *files, setup.file.realtime.cpu)

    return Companion("stagectl.twin.process", order)


def live_file(recording: Path) -> Path:
    """Where the twin of a run writes its snapshot."""
    return recording.with_name(recording.name.removesuffix(".h5") + SUFFIX)


def slow_record(setup: Setup, recording: Path) -> Path:
    """Where the twins of an axis write a line a minute, run after run."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", setup.file.name).strip("-") or "axis"
    return recording.parent / f"twin-{plain}.jsonl"


def newest(folder: Path) -> Path | None:
    """The snapshot that was written last."""
    return max(folder.glob(f"*{SUFFIX}"), key=lambda path: path.stat().st_mtime, default=None)


def load_snapshot(path: Path) -> dict[str, Any]:
    """The snapshot that the twin wrote last.  Raises GapError where the file is not a twin's."""
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise GapError(f"{path} cannot be read: {why_unread(error)}; {_SOURCE}") from error
    if not isinstance(entry, dict) or entry.get("format") != FORMAT:
        raise GapError(f"{path} is no snapshot of a twin ({FORMAT}); {_SOURCE}")
    return entry
