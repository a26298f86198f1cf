"""A closed loop simulated with a model of the machine: quiet, and from where the encoder reads its first position."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs import log_start
from stagectl.gap.logs.log_start import LogStart
from stagectl.gap.logs.session import Array, GapError, Log, Session
from stagectl.gap.validation.thresholds import SUBSTEPS
from stagectl.kernels import rollout, stage
from stagectl.kernels.law import Law
from stagectl.parallel import once_for_each
from stagectl.problem import Problem, ProblemKind
from stagectl.recording.exports import write_columns


class Rollout(NamedTuple):
    """One motion under one controller, for whatever machine."""

    setpoints: Array  # (n, 8), the fields of `kernels.law.Setpoint`
    law: Law
    start: LogStart
    dt: float  # s


def closed_loop(p: Rollout, model: stage.Stage, substeps: int) -> Array:
    """Rows (n, rollout.WIDTH) of `p` with `model` as the machine; the friction of an axis at rest is relaxed."""
    rows = np.zeros((len(p.setpoints), rollout.WIDTH))
    plant = p.start.plant(model, p.dt)
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
    return Rollout(log.setpoints[: log.rows], session.law, start_of(session, log), session.dt)


def start_of(session: Session, log: Log) -> LogStart:
    """How `log` begins."""
    return log_start.of_log(log.position, log.driving, log.start, session.dt, log.carried)


def simulated_log(session: Session, model: stage.Stage, log: Log, substeps: int = SUBSTEPS) -> Array:
    """Rows (n, rollout.WIDTH) of `log` with `model` as the machine, on the session's clock."""
    return closed_loop(of_log(session, log), model, substeps)


def simulated_logs(session: Session, model: stage.Stage, logs: Sequence[Log]) -> list[Array]:
    """`simulated_log` of each of `logs`, on all cores; repeats that begin at one place on one clock share one.

    The clock matters only where something in `model` runs on it.
    """
    aging = _aging(model)
    starts = [start_of(session, log) for log in logs]
    keys = [
        (log.experiment, start.clock if aging else 0.0, *(round(x, 12) for x in (start.position, *start.going_on)))
        for log, start in zip(logs, starts, strict=True)
    ]
    return once_for_each(lambda log: simulated_log(session, model, log), logs, keys)


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
