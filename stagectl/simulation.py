"""A whole run in closed loop, faster than real time: the same law, the same rows as on a machine."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.drives.simulated import Simulation, draw
from stagectl.kernels import rollout, stage
from stagectl.kernels.jit import interpret_first, interprets
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
    _run(loop, plant_state, inputs, (setup.dt, machine.file.simulation.substeps))
    return structured(rows)


def _run(loop: rollout.Loop, plant: stage.State, inputs: tuple[Any, Any, Any], steps: tuple[float, int]) -> None:
    """Fill the rows: compiled, or interpreted where that is sooner done (see `kernels.jit`)."""
    if interprets(inputs):
        # What Python raises is infinity in compiled code: a loop that diverges is run again there.
        with contextlib.suppress(ArithmeticError, ValueError):
            setpoints, noises, rows = inputs
            rollout.closed_loop(_listed(loop), _listed(plant), (setpoints.tolist(), noises, rows), *steps)
            return
        interpret_first(0)
    rollout.closed_loop(loop, plant, inputs, *steps)


def _listed(block: Any) -> Any:
    """A parameter block whose arrays are lists: an interpreted kernel is slow with numpy's scalars."""
    if isinstance(block, np.ndarray):
        return block.tolist()
    return type(block)(*map(_listed, block)) if hasattr(block, "_fields") else block


def noise(p: Simulation, count: int, jitter: float = 0.0) -> NDArray[np.float64]:
    """(n, 3) of current (A), position (rad | m) and dead time (s), drawn as the virtual drive draws it."""
    if p.current_noise == 0.0 and p.encoder_noise == 0.0 and jitter == 0.0:
        return np.zeros((count, 3))
    return np.array(draw(p, count, jitter))


def structured(rows: NDArray[np.float64]) -> NDArray[Any]:
    """(n, width) as (n,) rows with named columns, without a copy."""
    return rows.view(np.dtype([(name, "<f8") for name in rollout.COLUMNS]))[:, 0]
