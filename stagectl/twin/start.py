"""What a run needs to have a twin: the order to its process, and the slow record of its axis."""

import re
from pathlib import Path

from stagectl.config.stage_file import Setup
from stagectl.kernels import law
from stagectl.recording.metadata import portable
from stagectl.recording.ring import Ring
from stagectl.service.child_process import Companion
from stagectl.twin.process import TwinOrder
from stagectl.twin.record import live_file
from stagectl.twin.thresholds import SAME_COMMAND


def companion(setup: Setup, running: law.Law, recording: Path, record: Path | None = None) -> Companion:
    """The twin of this run: a snapshot next to the `recording`, the slow record next to it or in the file `record`."""
    axis, p = setup.file.axis, setup.stage
    about = {"name": setup.file.name, "kind": axis.kind, "recording": str(recording), "limit": SAME_COMMAND}
    files = (str(live_file(recording)), str(record or slow_record(setup, recording)))

    def order(ring: Ring, alive: int) -> TwinOrder:
        law, model = portable(running), portable(p)
        return TwinOrder(ring.place, alive, law, model, setup.dt, about, *files, setup.file.realtime.cpu)

    return Companion("stagectl.twin.process", order)


def slow_record(setup: Setup, recording: Path) -> Path:
    """Where the twins of an axis write a line a minute, run after run."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", setup.file.name).strip("-") or "axis"
    return recording.parent / f"twin-{plain}.jsonl"
