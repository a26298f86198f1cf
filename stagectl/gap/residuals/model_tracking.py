"""The stage model held on the measured path of a log: `kernels.tracked_model` over whole logs, on all cores."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array, Log
from stagectl.kernels import feedback, stage, tracked_model

# Of the sampling frequency: the tracker's poles, 40 Hz at 2 kHz.  Faster ones would hold the model closer, and shake
# every candidate with a resonance.
BANDWIDTH = 0.02
# Integration steps a period; what is stiffer than rolling friction takes more by itself.  A column is a difference of
# two simulations with the same steps: there half as many do.
SUBSTEPS = 4
OF_COLUMNS = 2


class Path(NamedTuple):
    """What a model is tied to: one log, or the mean of repeats."""

    rows: Array  # (n, 3) command A, position rad | m, current A (NaN: not measured)
    start: float  # s, session clock
    dt: float  # s


class Lacking(NamedTuple):
    """What the model lacks along a path."""

    effort: Array  # (n,) N m | N, the correction that keeps it on the path
    current: Array  # (n,) A, measured minus the drive model's; zero where no current is measured


def path_of(log: Log, dt: float) -> Path:
    """The path of one log; without a command the measured current stands for it."""
    unknown = np.full(log.rows, np.nan)
    command = log.current if log.command is None else log.command
    current = unknown if log.command is None or log.current is None else log.current
    assert command is not None  # the loader refuses logs without both
    return Path(np.column_stack([command, log.position, current]), log.start, dt)


def mean_path(paths: list[Path]) -> Path:
    """The mean over repeats: the same motion with less noise."""
    rows = min(len(path.rows) for path in paths)
    return paths[0]._replace(rows=np.mean([path.rows[:rows] for path in paths], axis=0))


def tracker(nominal: stage.Stage, dt: float) -> feedback.Pid:
    """What ties the model: poles at a fiftieth of the sampling frequency, designed on the nominal mechanics.

    One tracker for all candidates: the estimator must not change with what it estimates.
    """
    gains = feedback.place_poles(nominal.mechanics, nominal.motor.force_constant, BANDWIDTH / dt)
    return feedback.discretised(gains, dt)


def lacking(p: tracked_model.Tied, path: Path, substeps: int = SUBSTEPS, load: float = 0.0) -> Lacking:
    """What `p` lacks along `path`; its friction begins with the share `load` of what it can hold."""
    p = p._replace(stage=p.stage._replace(encoder=p.stage.encoder._replace(step=0.0)))  # the log has rounded already
    plant = stage.at_reading(p.stage, float(path.rows[0, 1]), path.start)
    if load:
        plant.stops[:] = load
    x = tracked_model.State(plant, feedback.AT_REST)
    out = np.empty((len(path.rows), 2))
    tracked_model.follow(p, x, (np.ascontiguousarray(path.rows), out), path.dt, substeps)
    measured = path.rows[:, 2]
    missing = np.where(np.isnan(measured), 0.0, measured - out[:, 1])
    return Lacking(out[:, 0] * p.stage.motor.force_constant, missing)
