"""The stage model tied to a measured path: the further current with which it moves as the machine did.

::

    logged command --> drive model --> i ----(+)--> plant model --> position of the model
                                       |      ^                          |
    logged current ------------->(-)---+--> missing current              v
                                              ^                         (-)<-- logged position
                                              +---- correction <-- PID --+

The correction, times Kt, is the unexplained effort.  The model stays on the measured path, so every
friction force is that of the motion that was really made, and the unexplained effort enters almost linearly: two
candidates add up.  It is no open-loop replay, in which position would be a double integral of every error.  The
same estimator with the same delays runs over data and over every candidate, so its own bias cancels.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from stagectl.kernels import feedback, stage
from stagectl.kernels.jit import kernel


class Tied(NamedTuple):
    """The model and what ties it."""

    stage: stage.Stage
    tracker: feedback.Pid  # A per rad | m: pulls the model onto the measured path


class State(NamedTuple):
    """Memory of the tied model."""

    plant: stage.State
    tracker: feedback.State


@kernel
def step(p: Tied, x: State, row: tuple[float, float, float], dt: float, substeps: int) -> tuple[float, float, State]:
    """One period under `row` = (command A, position, current A; NaN: not measured).

    Returns the correction (A) that the model needs now, the current that its drive gives (A), and the state at the
    end of the period.
    """
    command, position, current = row
    error = position - stage.measured(p.stage.encoder, x.plant, stage.SILENT)
    terms, tracker = feedback.step(p.tracker, x.tracker, error)
    correction = terms.proportional + terms.integral + terms.derivative
    given = stage.reported(p.stage.drive, x.plant, dt)
    extra = correction
    if current == current:  # measured: a deviation of the drive from its model is not one of the mechanics
        extra += current - given
    plant = stage.period(p.stage, x.plant, command, stage.Noise(extra, 0.0, 0.0), dt, substeps)
    return correction, given, State(plant, tracker)


@kernel
def follow(p: Tied, x: State, inputs: Any, dt: float, substeps: int) -> State:
    """All periods of `inputs` = (rows (n, 3): command, position, current; out (n, 2): correction, model's current).

    Fills `out`; returns the state at the end.
    """
    rows, out = inputs
    for k in range(len(rows)):
        row = (rows[k, 0], rows[k, 1], rows[k, 2])
        out[k, 0], out[k, 1], x = step(p, x, row, dt, substeps)
    return x
