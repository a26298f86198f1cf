"""`gap close` on a machine that it cannot look into: each run is asked for in a folder, and answered there.

    python -m stagectl_studies.blind_closing FOLDER OUT [--short]

FOLDER holds ``stage.yaml``, OUT gets ``answer.json`` and the last model.  A run is asked for and answered as::

    runs/7.npz  setpoints (n, 8), the stage file that runs, s on the session's clock  -->  runs/7.npy  rows (n,)

``runs`` lies in the working folder, as all that is recorded.  Rows that are none say that the machine lost its axis.
"""

import argparse
import json
import os
import shutil
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.api.arguments import reported
from stagectl.config.machine_file import text_of
from stagectl.config.stage_file import load_stage
from stagectl.service.single_motion import Motion
from stagectl.workflows.gap_closing import Closing, close
from stagectl.workflows.trials import Machine, Shown, TrialError

RUNS, STAGE, ANSWER, MODEL = Path("runs"), "stage.yaml", "answer.json", "model.yaml"
ROUNDS = 3  # as `gap close` makes unless it is told otherwise
SHORT = ("sine-slow", "sine-fast", "stairs", "check-sine-slow", "check-stairs")
_PATIENCE = 0.005  # s between two looks for an answer


def carried_out(motion: Motion, start: float) -> NDArray[Any]:
    """Rows (n,) of the motion on the machine.  Raises TrialError where it loses its axis."""
    number = len(list(RUNS.glob("*.npz"))) + 1
    draft, answer = RUNS / f"{number}.part", RUNS / f"{number}.npy"
    stage = motion.setup.text or text_of(motion.setup.path)
    with draft.open("wb") as file:
        np.savez(file, setpoints=motion.plan.setpoints, stage=stage, start=start)
    os.replace(draft, draft.with_suffix(".npz"))
    while not answer.exists():
        time.sleep(_PATIENCE)
    rows: NDArray[Any] = np.load(answer)
    if not rows.size:
        raise TrialError(f"{motion.meta['trajectory']}: the machine lost its axis")
    answer.unlink()
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Close the gap and write the answer."""
    parser = argparse.ArgumentParser(prog="python -m stagectl_studies.blind_closing", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--short", action="store_true", help="a few experiments and one round")
    given = parser.parse_args(arguments)
    RUNS.mkdir()
    machine = Machine(load_stage(given.folder / STAGE), True, None, elsewhere=carried_out)
    closing = Closing(machine, Path("closed"), ROUNDS, seed=1)
    if given.short:
        closing = closing._replace(rounds=1, repeats=2, only=SHORT)
    result = close(closing, Shown(print, partial(reported, False)))
    shutil.copy(result["model"], given.out / MODEL)
    (given.out / ANSWER).write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
