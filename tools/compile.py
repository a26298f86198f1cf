"""Compile the two long loops, the simulator's and the exam's machine, once.

On a new machine each of the tests' workers would compile them at the same time: forty seconds of a core, each.
"""

import tempfile
from pathlib import Path

from stagectl_studies.machine.stage_trial import stage_trial
from stagectl_studies.machine.trials import Options, draw

import stagectl as sc

CONFIG = Path(__file__).parents[1] / "config"

sc.simulate(CONFIG / "ball-screw.yaml", CONFIG / "trajectories" / "sine-3.2hz.yaml")
with tempfile.TemporaryDirectory() as folder:
    stage_trial(draw(1, "single", Options(short=True, effects=("cogging",))), Path(folder))
