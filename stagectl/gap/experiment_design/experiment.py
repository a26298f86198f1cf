"""One experiment: a motion made for a stage, and what it separates."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl import trajectories
from stagectl.config.stage_file import Setup
from stagectl.gap.effects.library import excited_by
from stagectl.gap.experiment_design.motions import preconditioned
from stagectl.gap.experiment_design.stage_scale import StageScale
from stagectl.gap.experiment_design.trajectory_text import text_of
from stagectl.plan import SETTLE, plan
from stagectl.trajectories import Excited, Trajectory, phases

DIAGNOSE, HELD_OUT = "diagnose", "held-out"


class Experiment(NamedTuple):
    """A motion that separates effects."""

    name: str  # also of its file
    separates: str  # in words, for its user
    effects: tuple[str, ...]  # names of the library that it bears on
    trajectory: trajectories.Experiment
    unit: str = "m"  # of travel
    use: str = DIAGNOSE

    @property
    def duration(self) -> float:
        """Machine time (s), the standstill at its end included."""
        return phases(self.trajectory).duration + SETTLE

    def setpoints(self, setup: Setup) -> NDArray[np.float64]:
        """Rows (n, 8) of `kernels.law.Setpoint` on this stage, under the layers of its file.

        Raises TrajectoryError where the stage's limits do not allow it.
        """
        return plan(setup, self.trajectory, setup.controller.feedforward).setpoints


class Recipe(NamedTuple):
    """An experiment before it is made for a stage."""

    name: str
    separates: str
    motion: Callable[[StageScale], tuple[Trajectory, ...] | Excited]
    family: str = ""  # the name by which the records of the effects list it; empty: its own


def made(p: StageScale, recipes: Iterable[Recipe], use: str = DIAGNOSE) -> tuple[Experiment, ...]:
    """Experiments for a stage of this scale; motions without a current begin with a preconditioning reversal."""
    experiments = []
    for name, separates, motion, family in recipes:
        parts = motion(p)
        trajectory = parts if isinstance(parts, Excited) else preconditioned(p, *parts)
        experiments.append(Experiment(name, separates, excited_by(family or name), trajectory, p.unit, use))
    return tuple(experiments)


def yaml_of(experiment: Experiment) -> str:
    """The trajectory file of `experiment`, as `run` takes it."""
    use = "; held out, to check what was found" if experiment.use == HELD_OUT else ""
    bears = f"Bears on {', '.join(experiment.effects)}." if experiment.effects else ""
    comments = (f"{experiment.name}, {experiment.duration:.3g} s{use}.", experiment.separates, bears)
    return text_of(experiment.trajectory, tuple(filter(None, comments)), experiment.unit)
