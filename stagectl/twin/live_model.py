"""The live twin: the stage model next to the axis, block by block of the ring's rows.

::

    rows --+--> law on the logged position --(-)-- logged current        command check
           +--> drive model -----------------(-)-- measured current      unexplained current
           +--> model tracking the path -------> correction x Kt         unexplained effort
           |    the same, each candidate off by 1 %  --> sensitivities
           +--> the same, position late by 1 % of a period               sensor and time

The correction of a right model is noise.  To first order it is ``r = -S theta``, with S the difference that a candidate
makes to it per unit of its size.  S is filtered by the tracker and curved by the friction like the residual itself, and
as free of the encoder's noise as the model is.  The normal equations of every block are kept; `twin.estimate` solves
them.
"""

from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import model_tracking
from stagectl.kernels import feedback, law, rollout, stage, tracked_model
from stagectl.recording.replay import carried
from stagectl.twin import candidates, thresholds
from stagectl.twin.candidates import TwinCandidate

_AT = {name: k for k, name in enumerate(rollout.COLUMNS)}
_SETPOINT = [_AT[name] for name in law.Setpoint._fields]
_PATH = [_AT[name] for name in ("current", "measured", "measured_current")]


class Twin(NamedTuple):
    """One axis and what runs next to it."""

    law: law.Law
    dt: float  # s
    tracker: feedback.Pid
    mechanics: tuple[TwinCandidate, ...]  # `models` holds them in this order, behind the nominal one
    drive: tuple[TwinCandidate, ...]
    models: tuple[stage.Stage, ...]
    length: float  # rad | m of motion after which the friction slips
    substeps: int = thresholds.SUBSTEPS
    origin: float = 0.0  # rad | m, added to the rows' positions: those of a run count from its start, cogging does not


class TwinState(NamedTuple):
    """Memory between blocks; the arrays in `tracked` change in place."""

    law: law.State | None  # None: rows are missing, the law's memory is not known
    tracked: tuple[tracked_model.State, ...]
    before: Array  # (thresholds.SPEED_PERIODS,) rad | m, positions before the block
    current: float  # A, of the drive model, one period ago
    time: float  # s, of the last row
    rows: int  # since the model was put onto the path
    travelled: float  # rad | m, since then


class NormalEquations(NamedTuple):
    """Of one block, for ``target = columns theta``."""

    gram: Array  # (k, k)
    cross: Array  # (k,)
    power: float  # target' target
    rows: int


class TwinBlock(NamedTuple):
    """What one block of rows showed."""

    time: float  # s, of its last row
    rows: int
    informative: bool  # the axis moved, and the model has settled: the normal equations count
    controller: float | None  # A, largest difference of the law's command; None: not known
    drive: NormalEquations | None  # None: no current is measured
    mechanics: NormalEquations  # effort, N m | N
    lateness: float  # s, root mean square


def twin_of(running: law.Law, p: stage.Stage, dt: float) -> Twin:
    """The twin of an axis with this model under this law; `dt` is its period (s)."""
    smooth = p._replace(encoder=p.encoder._replace(step=0.0))  # the log has rounded already
    changes = candidates.of_mechanics(smooth, dt)
    return Twin(
        running,
        dt,
        model_tracking.tracker(p, dt),
        tuple(candidate for candidate, _ in changes),
        candidates.of_drive(p, dt),
        (smooth, *(change(smooth) for _, change in changes)),
        candidates.friction_length(p.friction),
    )


def begin(p: Twin, position: float, controller: law.State | None, held: float = 0.0) -> TwinState:
    """All models at rest where the encoder reads `position` (rad | m), as the drive counts, under a current (A)."""
    plants = [stage.at_reading(model, position, held=held) for model in p.models]
    states = tuple(tracked_model.State(plant, feedback.AT_REST) for plant in plants)
    before = np.full(thresholds.SPEED_PERIODS, position)
    return TwinState(controller, states, before, plants[0].current, float("nan"), 0, 0.0)


def _begun(p: Twin, rows: Array) -> TwinState:
    """At the first row of a run, in which a law acts that has held the axis before."""
    setpoints, measured = rows[:1, _SETPOINT], rows[:1, _AT["measured"]]
    held = carried(p.law, setpoints, measured, "integral", rows[:1, _AT["integral"]])
    return begin(p, float(measured[0]) + p.origin, law.carrying(law.AT_REST, held), held)


def step(p: Twin, x: TwinState | None, rows: Array) -> tuple[TwinBlock, TwinState]:
    """One block of ring rows (n, WIDTH); `x` is None at the first row of a run.

    Where periods are missing the models begin anew, and the controller's memory is not known any more.
    """
    if x is None:
        x = _begun(p, rows)
    elif rows[0, 0] - x.time > thresholds.MISSING * p.dt:
        x = begin(p, float(rows[0, _AT["measured"]]) + p.origin, None)
    path = np.ascontiguousarray(rows[:, _PATH])
    path[:, 1] += p.origin
    controller, memory = _command_difference(p, x.law, rows)
    corrections, currents, states = _tracked(p, x, path)
    travelled = float(np.sum(np.abs(np.diff(path[:, 1], prepend=x.before[-1]))))
    block = TwinBlock(
        float(rows[-1, 0]),
        len(rows),
        _settled(p, x) and not np.any(rows[:, _AT["fault"]]) and travelled > thresholds.INFORMATIVE_LENGTHS * p.length,
        controller,
        _drive(p, path[:, 2], currents, x.current),
        _mechanics(p, corrections),
        float(np.sqrt(np.mean(rows[:, _AT["lateness"]] ** 2))),
    )
    before = np.concatenate([x.before, path[:, 1]])[-thresholds.SPEED_PERIODS :]
    rows_so_far, way = x.rows + len(rows), x.travelled + travelled
    return block, TwinState(memory, states, before, float(currents[-1]), block.time, rows_so_far, way)


def _settled(p: Twin, x: TwinState) -> bool:
    """Whether the models have forgotten how they began."""
    return x.rows * p.dt >= thresholds.SETTLED_TIME and x.travelled >= thresholds.SETTLED_LENGTHS * p.length


def pieces(rows: Array, dt: float) -> list[Array]:
    """`rows` cut wherever periods are missing."""
    return np.split(rows, np.flatnonzero(np.diff(rows[:, 0]) > thresholds.MISSING * dt) + 1)


def _command_difference(p: Twin, x: law.State | None, rows: Array) -> tuple[float | None, law.State | None]:
    """Largest difference (A) of the law's command from the logged one, and the law's memory after it."""
    if x is None:
        return None, None
    out = np.empty((len(rows), len(law.Output._fields)))
    setpoints, measured = rows[:, _SETPOINT], rows[:, _AT["measured"]]
    x = rollout.answers(p.law, x, (np.ascontiguousarray(setpoints), np.ascontiguousarray(measured), out))
    return float(np.max(np.abs(out[:, law.OUTPUT_COLUMNS["current"]] - rows[:, _AT["current"]]))), x


def _tracked(p: Twin, x: TwinState, path: Array) -> tuple[Array, Array, tuple[tracked_model.State, ...]]:
    """Corrections (models, n) A, the current of the drive model (n,) A, and all states at the end."""
    out = np.empty((len(p.models), len(path), 2))
    given, shifted = np.column_stack([path[:, ::2], np.zeros(len(path))]), path.copy()
    past = np.concatenate([x.before, path[:, 1]])
    shifted[:, 1] += thresholds.NUDGE * (path[:, 1] - past[: len(path)]) / thresholds.SPEED_PERIODS
    late = next(k for k, candidate in enumerate(p.mechanics, 1) if candidate.name == "time_shift")
    states = []
    for k, model in enumerate(p.models):
        places = (shifted if k == late else path)[:, 1:2]
        tied = tracked_model.Tied(model, p.tracker)
        states.append(tracked_model.follow(tied, x.tracked[k], (given, places, out[k]), p.dt, p.substeps))
    return out[:, :, 0], out[0, :, 1], tuple(states)


def _mechanics(p: Twin, corrections: Array) -> NormalEquations:
    rows = max(1, round(thresholds.AVERAGED / p.dt))
    means = np.add.reduceat(corrections, np.arange(0, corrections.shape[1], rows), axis=1) / rows
    force_constants = np.array([model.motor.force_constant for model in p.models])
    missing = force_constants[:, None] * means
    return _normal_equations((missing[1:] - missing[0]).T / thresholds.NUDGE, -missing[0])


def _drive(p: Twin, measured: Array, expected: Array, before: float) -> NormalEquations | None:
    if np.isnan(measured).any():
        return None
    late = -np.diff(expected, prepend=before)
    offset = np.full(len(expected), p.drive[1].scale)
    return _normal_equations(np.column_stack([expected, offset, late]), measured - expected)


def _normal_equations(columns: Array, target: Array) -> NormalEquations:
    return NormalEquations(columns.T @ columns, columns.T @ target, float(target @ target), len(target))
