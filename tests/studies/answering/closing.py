"""Closes a gap as it is told: one motion on the machine, and then the model that it began with or a better one."""

import json
import shutil
import sys
from pathlib import Path

from stagectl_studies.blind_closing import ANSWER, MODEL, RUNS, STAGE, carried_out

from stagectl.config.stage_file import load_stage
from stagectl.trajectories import Sine
from stagectl.workflows.motion import Commanded, lay_out


def main(folder: Path, out: Path) -> None:
    """Move once; the answer says what the rows were."""
    RUNS.mkdir()
    setup = load_stage(folder / STAGE)
    motion = lay_out(setup, Commanded("sine.yaml", "", Sine(0.001, 8.0, 1.0, 0.5)), frozenset(), Path("run.h5"))
    rows = [carried_out(motion, 0.0) for _ in range(2)]
    blind = all(row["true_position"][0] != row["true_position"][0] for row in rows)  # not a number
    shutil.copy(folder / STAGE, out / MODEL)
    ended = f"blind: {blind}, alike: {rows[0].tobytes() == rows[1].tobytes()}"
    levels = {"before": 2.0, "after": 1.0}
    said = {"rounds": [{"found": ["cogging"]}], "ended": ended, "levels": levels, "foretold": levels}
    (out / ANSWER).write_text(json.dumps(said), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
