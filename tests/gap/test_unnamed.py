"""Parameters beside something that no effect explains: what acts as the unnamed does is not known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import stagectl as sc
from tests.gap.captured import CONFIG

KEPT = {"time": "s", "reference": "rad", "command": "A", "measured": "rad", "measured_current": "A"}


def test_one_log_at_one_speed_makes_no_constant_force_of_an_asymmetry(tmp_path: Path) -> None:
    """A sine: what is missing follows the speed, and its level over the speed is that of a constant force.

    Beside it, what the motion does tell stays: neither inertia nor friction has changed.
    """
    stage = sc.load_stage(CONFIG / "ball-screw.yaml")
    machine = stage.changed({"mechanics.viscous_asymmetry": 0.1, "simulation.current_noise": 5e-3})
    ran = sc.simulate(stage, CONFIG / "trajectories" / "sine-0.8hz.yaml", plant=machine)
    header, rows = ",".join(f"{name}_{unit}" for name, unit in KEPT.items()), np.column_stack([ran[n] for n in KEPT])
    np.savetxt(tmp_path / "slow.csv", rows, delimiter=",", header=header, comments="", fmt="%.9g")
    answer = sc.diagnose(tmp_path / "slow.csv", stage=stage, advice=False).diagnosis
    assert answer.unknown is not None and answer.unknown.coordinate == "speed"
    assert not answer.named and "No effect of the library" in answer.sentence
