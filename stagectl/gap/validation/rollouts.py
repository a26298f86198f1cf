"""A closed loop simulated with a model of the machine: quiet, at rest where the encoder reads its first position."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array, GapError, Log, Session
from stagectl.gap.validation.thresholds import SUBSTEPS
from stagectl.kernels import rollout, stage
from stagectl.kernels.law import Law
from stagectl.parallel import in_parallel
from stagectl.problem import Problem, ProblemKind
from stagectl.recording.exports import write_columns


class Rollout(NamedTuple):
    """One motion under one controller, for whatever machine."""

    setpoints: Array  # (n, 8), the fields of `kernels.law.Setpoint`
    law: Law
    start: float  # rad | m, initial position of the axis
    clock: float  # s, session clock of the first row
    dt: float  # s


def closed_loop(p: Rollout, model: stage.Stage, substeps: int) -> Array:
    """Rows (n, rollout.WIDTH) of `p` with `model` as the machine; its friction begins relaxed."""
    rows = np.zeros((len(p.setpoints), rollout.WIDTH))
    plant = stage.at_reading(model, p.start, p.clock)
    inputs = (np.ascontiguousarray(p.setpoints), np.zeros((len(rows), 2)), rows)
    rollout.closed_loop(rollout.Loop(p.law, model), plant, inputs, p.dt, stage.steps_that_hold(model, p.dt, substeps))
    return rows


def of_log(session: Session, log: Log) -> Rollout:
    """The motion of `log` under the deployed controller.

    Raises GapError where the controller or the reference of the log is not known.
    """
    if session.law is None or log.setpoints is None:
        missing = "controller" if session.law is None else "reference"
        reason = f"is not known, so {log.name} cannot be simulated in closed loop"
        raise GapError(Problem(reason, ProblemKind.MISSING, missing, remedy="see `cannot_tell`"))
    return Rollout(log.setpoints[: log.rows], session.law, float(log.position[0]), log.start, session.dt)


def simulated_log(session: Session, model: stage.Stage, log: Log, substeps: int = SUBSTEPS) -> Array:
    """Rows (n, rollout.WIDTH) of `log` with `model` as the machine, on the session's clock."""
    return closed_loop(of_log(session, log), model, substeps)


def simulated_logs(session: Session, model: stage.Stage, logs: Sequence[Log]) -> list[Array]:
    """`simulated_log` of each of `logs`, on all cores; repeats that begin at one place on one clock share one.

    The clock matters only where something in `model` runs on it.
    """
    aging = _aging(model)
    keys = [(log.experiment, log.start if aging else 0.0, round(float(log.position[0]), 12)) for log in logs]
    first = {key: log for key, log in reversed(list(zip(keys, logs, strict=True)))}
    rows = in_parallel(lambda log: simulated_log(session, model, log), list(first.values()))
    by_key = dict(zip(first, rows, strict=True))
    return [by_key[key] for key in keys]


def _aging(p: stage.Stage) -> bool:
    """Whether something in the model runs on the session clock."""
    mechanics, friction = p.mechanics, p.friction
    rises = (mechanics.viscous_warming.rise, friction.warming.rise, mechanics.viscous_step.share, friction.step.share)
    return any(rises)


def column(rows: Array, name: str) -> Array:
    """A column (n,) of simulated rows by its name in `rollout.COLUMNS`."""
    return rows[:, rollout.COLUMNS.index(name)]


def write_predictions(session: Session, improved: stage.Stage, folder: Path) -> list[Path]:
    """A CSV of the name of each held-out capture, as `improved` predicts it: time, position and current.

    Anyone can check the closure with these files.

    Raises GapError where nothing is held out, or no loop can be simulated.
    """
    held = [log for log in session.logs if log.held_out]
    if not held:
        remedy = "mark some `use: held-out` in captures.yaml"
        raise GapError(
            Problem("no log is held out, so there is nothing to predict", ProblemKind.MISSING, remedy=remedy)
        )
    rows = simulated_logs(session, improved, held)
    folder.mkdir(parents=True, exist_ok=True)
    name = "position_m" if session.kind == "linear" else "position_rad"
    paths = []
    for log, simulated in zip(held, rows, strict=True):
        path = folder / Path(log.name).with_suffix(".csv").name
        columns = {
            "time_s": session.dt * np.arange(log.rows),
            name: column(simulated, "measured")[: log.rows],
            "current_A": column(simulated, "measured_current")[: log.rows],
        }
        write_columns(path, columns)
        paths.append(path)
    return paths
