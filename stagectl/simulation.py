"""A whole run in closed loop, compiled, faster than real time: the same law, the same rows as on a machine."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Simulation
from stagectl.drives.simulated import draw
from stagectl.kernels import rollout, stage
from stagectl.kernels.law import Law
from stagectl.plan import Plan


def simulate(setup: Setup, plan: Plan, running: Law, plant: Setup | None = None, start: float = 0.0) -> NDArray[Any]:
    """Rows (n,) of the run, structured as in a recording; `plant` is the machine where it is not the model.

    It starts at `start` (s) on the session's clock, on which the machine warms up.
    """
    machine = plant or setup
    count = len(plan.setpoints)
    rows = np.zeros((count, rollout.WIDTH))
    loop = rollout.Loop(running, machine.stage)
    inputs = (plan.setpoints, noise(machine.file.simulation, count, machine.stage.drive.jitter), rows)
    plant_state = stage.at_rest(machine.stage, 0.0, start)
    rollout.closed_loop(loop, plant_state, inputs, setup.dt, machine.file.simulation.substeps)
    return structured(rows)


def noise(p: Simulation, count: int, jitter: float = 0.0) -> NDArray[np.float64]:
    """(n, 3) of current (A), position (rad | m) and dead time (s), drawn as the virtual drive draws it."""
    if p.current_noise == 0.0 and p.encoder_noise == 0.0 and jitter == 0.0:
        return np.zeros((count, 3))
    return np.array(draw(p, count, jitter))


def structured(rows: NDArray[np.float64]) -> NDArray[Any]:
    """(n, width) as (n,) rows with named columns, without a copy."""
    return rows.view(np.dtype([(name, "<f8") for name in rollout.COLUMNS]))[:, 0]
