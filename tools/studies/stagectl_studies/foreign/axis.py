"""A plan of stagectl on the exam's machine: its rows and its gains go in, a record comes out."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.design import designed_feedback
from stagectl.kernels import feedback
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.kernels.rollout import WIDTH
from stagectl.plan import Plan
from stagectl.simulation import structured
from stagectl_studies.machine.controller import Loop, Rows
from stagectl_studies.machine.machine import Machine
from stagectl_studies.machine.plant import Setting, noise_of, simulated
from stagectl_studies.machine.standstill import Rest

AHEAD = ("feedforward", "friction", "learned", "injection")  # terms of the command that are known beforehand


class Axis(NamedTuple):
    """The machine, the seed of its noise, and where its runs begin."""

    machine: Machine
    seed: int
    start: float = 0.0  # s, on the session's clock

    def run(self, setup: Setup, plan: Plan, number: int) -> NDArray[Any]:
        """Rows (n,) as in a recording, of the `number`-th run.  Raises ValueError where the machine loses the axis."""
        r = plan.setpoints
        column = {name: np.ascontiguousarray(r[:, place]) for name, place in SETPOINT_COLUMNS.items()}
        known = np.sum([column[name] for name in AHEAD], axis=0)
        still = np.zeros(len(r))
        rows = Rows(column["reference"], column["target"], known, still, column["velocity"], column["friction"])
        noise = noise_of(self.machine, len(r), np.random.default_rng([self.seed, number]))
        trace = simulated(self.machine, loop_of(setup), rows, noise, Setting(start=self.start))
        if trace.lost:
            raise ValueError(f"run {number} of seed {self.seed}: the axis was lost")
        samples = structured(np.zeros((len(r), WIDTH)))
        for name, values in column.items():
            samples[name] = values
        samples["time"] = setup.dt * np.arange(len(r))
        samples["measured"], samples["true_position"] = trace.position, trace.true_position
        samples["error"] = column["target"] - trace.position
        limit = setup.controller.law.current_limit
        samples["command"], samples["current"] = trace.command, np.clip(trace.command, -limit, limit)
        samples["measured_current"] = trace.current
        return samples


def loop_of(setup: Setup) -> Loop:
    """The machine's own PID, and its rules at rest, with the numbers that stagectl designs."""
    gains = designed_feedback(setup.stage, setup.file.control)
    if not isinstance(gains, feedback.Gains):
        raise TypeError("the exam's machine has a PID loop only")
    law = setup.controller.law
    rest = Rest(law.standstill_band, *law.unloading)
    pid = (gains.proportional, gains.integral, gains.derivative, gains.pole)
    return Loop(setup.dt, 0.0, *pid, rest=rest, limit=law.current_limit)
