"""A test bench: a virtual machine that no method knows, and what its operator believes of it beforehand.

An experiment is planned and controlled with what is *believed*; it is carried out by the *machine*.  What comes back
is a recording as of any machine, without its true position, and the captures in it go through the same preparation
as those of a user.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.config.friction_laws import Operators
from stagectl.config.stage_file import Setup
from stagectl.config.wire_checks import OWN
from stagectl.identification.capture import Capture
from stagectl.identification.captures import prepared
from stagectl.identification.result import Characteristic
from stagectl.plan import Plan, plan
from stagectl.recording.hdf5 import Recording
from stagectl.simulation import simulate
from stagectl.trajectories import Experiment

Array = NDArray[np.float64]
CONFIG = OWN
NOISE = 0.045  # A rms on the motor current, the ball-screw paper's drive
NO_FRICTION = frozenset({"friction"})


class Bench(NamedTuple):
    """Machine, belief, and the seed of the machine's noise."""

    machine: Setup
    believed: Setup
    seed: int

    def noisy(self, noise: float, number: int) -> Bench:
        """The same with this current noise (A rms), the `number`-th draw of it."""
        simulation = self.machine.file.simulation._replace(current_noise=noise, seed=self.seed + number)
        return self._replace(machine=self.machine.having(simulation=simulation))


class Run(NamedTuple):
    """One experiment, carried out; positions in axis units, lengths by `scale` (m per axis unit)."""

    name: str
    samples: NDArray[Any]  # (n,) structured, as in a recording
    plan: Plan
    setup: Setup  # believed
    scale: float

    @property
    def steady(self) -> NDArray[np.bool_]:
        """Rows (n,) of the steady window."""
        start, end = self.plan.steady
        return np.asarray((self.samples["time"] >= start) & (self.samples["time"] < end), dtype=np.bool_)

    def error(self, column: str = "measured") -> Array:
        """Reference minus position (n,) m of table travel; both of the same instant, as nm = 0 here."""
        return np.asarray((self.samples["reference"] - self.samples[column]) * self.scale, dtype=np.float64)


def carried_out(bench: Bench, experiment: Experiment, name: str, without: frozenset[str] = NO_FRICTION) -> Run:
    """`experiment` on the machine, under the controller that is designed from what is believed."""
    believed = bench.believed
    controller = believed.controller.without(without)
    laid_out = plan(believed, experiment, controller.feedforward)
    samples = simulate(believed, laid_out, controller.law, bench.machine)
    return Run(name, samples, laid_out, believed, believed.file.axis.travel_per_unit)


def captured(run: Run) -> list[Capture]:
    """The run as an identification reads it: what a machine reports, and nothing else."""
    axis, p = run.setup.file.axis, run.setup.stage
    meta = {
        "name": run.setup.file.name,
        "trajectory": run.name,
        "axis": {
            "kind": axis.kind,
            "travel_per_unit": axis.travel_per_unit,
            "travel_unit": axis.travel_unit,
            "encoder_step": p.encoder.step,
        },
        "dt": run.setup.dt,
        "nd": p.drive.delay_samples,
        "nm": p.encoder.delay_samples,
        "steady": list(run.plan.steady),
        "duration": run.plan.duration,
        "excitation": [span._asdict() for span in run.plan.excitation],
    }
    rows = run.samples.copy()
    rows["true_position"] = np.nan
    return prepared([Recording(Path(run.name), meta, rows, True, "", 0)], run.setup)


def believing(setup: Setup, inertia: float, viscous: float, table: Characteristic) -> Setup:
    """`setup` with these mechanics (SI) and this rolling friction in the place of its own."""
    return _assembled(
        setup, inertia, viscous, Operators(tuple(map(float, table.weight)), tuple(map(float, table.slip)))
    )


def _assembled(setup: Setup, inertia: float, viscous: float, rolling: Operators) -> Setup:
    mechanics = setup.file.mechanics._replace(inertia=inertia, viscous=viscous)
    friction = setup.stage.friction._replace(operators=rolling.operators(), stribeck=rolling.stribeck)
    return setup._replace(
        file=setup.file._replace(mechanics=mechanics, friction=rolling),
        stage=setup.stage._replace(mechanics=mechanics, friction=friction),
    )


def guessed(setup: Setup, inertia: float, viscous: float, friction: float) -> Setup:
    """What a data sheet would say: `setup` with its mechanics and friction wrong by these factors."""
    own = setup.stage.friction.operators
    rolling = Operators(
        tuple(friction * float(weight) for weight in own.weight), tuple(1.5 * float(slip) for slip in own.slip)
    )
    true = setup.file.mechanics
    return _assembled(setup, inertia * true.inertia, viscous * true.viscous, rolling)
