"""Whether any current known beforehand answers a gap: the currents that reach the reference exactly every other period.

Usage: python tools/bench/frame_inverse.py

The layer `effects` inverts the model along the reference and gives the mean of each period.  Here the stage itself is
moved on, two periods at a time, and both commands are chosen so that position and velocity of the motor are those of
the reference at the end (Newton's method; perfect tracking of the whole model).  What is left behind these commands is
not the inverse's fault.  Peaks of the tracking error, simulated, with and without the steps of encoder and command.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup, load_stage
from stagectl.kernels import stage
from stagectl.kernels.feedforward import Held, held
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.kernels.plant import Transmission
from stagectl.plan import Plan, plan
from stagectl.simulation import simulate
from stagectl.trajectories import Experiment, phases
from stagectl.trajectories.periodic import Sine
from stagectl.trajectories.profiles import SCurve

MOTIONS: dict[str, Experiment] = {
    "sine of 5 mm": Sine(5e-3, 1.6, 2.0, 1.0),
    "stop and go": SCurve(2e-3, 20e-3, 1.0, 40.0, 0.3, 4, True),
}
GAPS = (3.14e-4, 1.26e-3)  # rad, 0.6 and 2.4 um of table travel
ITERATIONS = 3

Array = NDArray[np.float64]


def in_frames(setup: Setup, motion: Experiment, laid_out: Plan) -> Plan:
    """The same motion with the commands that reach its states at the end of each frame of two periods."""
    p, dt, rows = setup.stage, setup.dt, laid_out.setpoints.copy()
    friction, feedforward = SETPOINT_COLUMNS["friction"], SETPOINT_COLUMNS["feedforward"]
    t: Array = dt * (np.arange(len(rows) + 2, dtype=np.float64) + p.drive.delay_samples)
    wanted = np.stack(phases(motion).motion.at(t)[:2], axis=1) / setup.file.axis.travel_per_unit
    ideal = p._replace(drive=p.drive._replace(delay_samples=0, current_quantum=0.0))
    steps = stage.steps(ideal, dt, setup.file.simulation.substeps)
    linear, x = held(p.mechanics, p.motor.force_constant, dt), stage.at_rest(ideal)
    first = rows[:, friction] + rows[:, feedforward]
    for _ in range(p.drive.delay_samples):
        x = stage.period_of(ideal, x, 0.0, stage.SILENT, steps)
    for k in range(0, len(rows), 2):
        command = first[k : k + 2]
        for _ in range(ITERATIONS):
            y = _frame(ideal, x, command, steps)
            command = command + _corrected(linear, wanted[k + 2] - (y.position, y.velocity))
        x = _frame(ideal, x, command, steps)
        rows[k : k + 2, friction] = command - rows[k : k + 2, feedforward]
    return laid_out._replace(setpoints=rows)


def _frame(p: stage.Stage, x: stage.State, command: Array, steps: stage.Steps) -> stage.State:
    """Two periods later; `x` stays."""
    y = stage.copied(x)
    for current in command.tolist():
        y = stage.period_of(p, y, current, stage.SILENT, steps)
    return y


def _corrected(p: Held, missing: Array) -> Array:
    """Change (A) of both commands that moves the linear plant by the `missing` position and velocity."""
    by_commands = np.array([[p.b1 + p.a12 * p.b2, p.b1], [p.a22 * p.b2, p.b2]])
    return np.linalg.solve(by_commands, missing)


def peak(setup: Setup, laid_out: Plan) -> float:
    """Largest tracking error (nm)."""
    error: Any = simulate(setup, laid_out, setup.controller.law)["error"]
    return float(np.abs(error).max()) * setup.file.axis.travel_per_unit * 1e9


def main() -> None:
    """Print the table."""
    plain = load_stage(Path("config/ball-screw.yaml"))
    plain = plain.having(control=plain.file.control._replace(standstill_band=0.0))
    p = plain.stage
    smooth = p._replace(encoder=p.encoder._replace(step=0.0), drive=p.drive._replace(current_quantum=0.0))
    print("| gap (rad) | steps | motion | no gap | layer effects | frames |\n|---|---|---|---|---|---|")
    for gap in GAPS:
        for steps, known in (("none", smooth), ("encoder and command", p)):
            without = plain._replace(stage=known)
            geared = known.mechanics._replace(transmission=Transmission(0.3, 800.0, 0.1, gap, 0.4))
            machine = plain._replace(stage=known._replace(mechanics=geared))
            for name, motion in MOTIONS.items():
                least = plan(without, motion, without.controller.feedforward)
                laid_out = plan(machine, motion, machine.controller.feedforward)
                cells = (
                    peak(without, least),
                    peak(machine, laid_out),
                    peak(machine, in_frames(machine, motion, laid_out)),
                )
                print(f"| {gap} | {steps} | {name} | {' | '.join(f'{cell:.0f} nm' for cell in cells)} |", flush=True)


if __name__ == "__main__":
    main()
