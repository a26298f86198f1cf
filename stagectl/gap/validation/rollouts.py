"""The closed loop of a log simulated again: the deployed law, the log's setpoints, a model of the machine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stagectl.gap.logs.session import Array, GapError, Log, Session
from stagectl.kernels import rollout, stage
from stagectl.parallel import in_parallel

SUBSTEPS = 10  # a period, as the virtual drive takes


def closed(session: Session, model: stage.Stage, log: Log, substeps: int = SUBSTEPS) -> Array:
    """Rows (n, rollout.WIDTH) of `log` with `model` as the machine: quiet, at rest at the log's first position.

    The friction begins relaxed, the session's clock where the log begins.  Raises GapError where the controller or the
    reference of the log is not known.
    """
    if session.law is None or log.setpoints is None:
        lacking = "the deployed controller" if session.law is None else "its reference"
        raise GapError(f"{log.name} cannot be simulated in closed loop: {lacking} is not known; see `cannot_tell`")
    rows = np.zeros((log.rows, rollout.WIDTH))
    plant = stage.at_reading(model, float(log.position[0]), log.start)
    inputs = (np.ascontiguousarray(log.setpoints), np.zeros((log.rows, 2)), rows)
    rollout.closed_loop(rollout.Loop(session.law, model), plant, inputs, session.dt, substeps)
    return rows


def closed_all(session: Session, model: stage.Stage, logs: Sequence[Log], substeps: int = SUBSTEPS) -> list[Array]:
    """`closed` of each log, on all cores."""
    return in_parallel(lambda log: closed(session, model, log, substeps), logs)


def column(rows: Array, name: str) -> Array:
    """A column (n,) of simulated rows by its name in `rollout.COLUMNS`."""
    found: Array = rows[:, rollout.COLUMNS.index(name)]
    return found
