"""What the improved simulator says of the held-out runs, as files that anyone can check the closure with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stagectl.gap.logs.session import GapError, Session
from stagectl.gap.validation import rollouts
from stagectl.gap.validation.rollouts import column
from stagectl.kernels.stage import Stage
from stagectl.recording.exports import write_columns


def write(session: Session, improved: Stage, folder: Path) -> list[Path]:
    """A CSV of the name of each held-out capture, with its time, position and current.

    Raises GapError where nothing is held out, or no loop can be simulated.
    """
    held = [log for log in session.logs if log.held_out]
    if not held:
        raise GapError("no log is held out: there is nothing to predict; mark some `use: held-out` in captures.yaml")
    rows = rollouts.simulated_logs(session, improved, held)
    folder.mkdir(parents=True, exist_ok=True)
    name = "position_m" if session.kind == "linear" else "position_rad"
    paths = []
    for log, simulated in zip(held, rows, strict=True):
        path = folder / Path(log.name).with_suffix(".csv").name
        columns = {
            "time_s": session.dt * np.arange(log.rows),
            name: column(simulated, "measured")[: log.rows],
            "current_A": column(simulated, "measured_current")[: log.rows],
        }
        write_columns(path, columns)
        paths.append(path)
    return paths
