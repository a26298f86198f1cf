"""The live twin: the stage model beside the axis, block by block of the ring's rows.

::

    rows --+--> law on the logged position --(-)-- logged current        cut A  controller
           +--> drive model -----------------(-)-- measured current      cut B  drive
           +--> model tied to the path --------> correction x Kt         cut C  mechanics: effort it lacks
           |    the same, each candidate off by 1 %  --> sensitivities
           +--> the same, position late by 1 % of a period               cut D  sensor and time

The correction of a right model is noise.  To first order it is ``r = -S theta``, with S the difference that a candidate
makes to it per unit of its size: filtered by the tracker and bent by the friction as the residual itself is, and as
free of the encoder's noise as the model is.  Normal equations of every block are kept; `twin.estimate` solves them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import model_tracking
from stagectl.kernels import feedback, law, rollout, stage, tracked_model

SUBSTEPS = 4  # a period: what rolling friction needs
NUDGE = 0.01  # of a candidate's unit: far from curved, far from rounding
AVERAGED = 0.025  # s: effort noise shakes the axis, and faster than the loop it would pass for inertia
SETTLED = 3.0  # friction lengths, after which it no longer matters how the friction began
CALM = 0.2  # s after which the tracker has forgotten where it began
PRESLIDING, BEND = "presliding", "presliding_curve"  # always in the fit: another friction law is no effect
_SPAN = 8  # periods over which the speed is taken that a late position is late by
_NATURAL = 6.283  # 1/s: viscous friction per inertia where the model has none to scale

_AT = {name: k for k, name in enumerate(rollout.COLUMNS)}
_SETPOINT = [_AT[name] for name in law.Setpoint._fields]
_PATH = [_AT[name] for name in ("current", "measured", "measured_current")]


class Candidate(NamedTuple):
    """What the model may be off by; its size theta is in units of `scale`."""

    name: str
    unit: str  # rotary | linear, of scale and nominal
    nominal: float
    scale: float
    material: float  # theta below which nobody cares
    prior: float  # theta, one standard deviation of what is thinkable
    gauge: str  # of theta: % | Ts | ...


class Twin(NamedTuple):
    """One axis and what runs beside it."""

    law: law.Law
    stage: stage.Stage
    dt: float  # s
    tracker: feedback.Pid
    mechanics: tuple[Candidate, ...]  # `models` holds them in this order, behind the nominal one
    drive: tuple[Candidate, ...]
    models: tuple[stage.Stage, ...]
    length: float  # rad | m of motion after which the friction slips
    substeps: int = SUBSTEPS


class State(NamedTuple):
    """Memory between blocks; the arrays in `tied` change in place."""

    law: law.State | None  # None: rows are missing, the law's memory is not known
    tied: tuple[tracked_model.State, ...]
    before: Array  # (_SPAN,) rad | m, positions before the block
    given: float  # A, of the drive model, one period ago
    time: float  # s, of the last row
    rows: int  # since the model was put onto the path
    travelled: float  # rad | m, since then


class Moments(NamedTuple):
    """Normal equations of one block for ``target = columns theta``."""

    gram: Array  # (k, k)
    cross: Array  # (k,)
    power: float  # target' target
    rows: int


class Block(NamedTuple):
    """What one block of rows showed."""

    time: float  # s, of its last row
    rows: int
    telling: bool  # the axis moved, and the model has settled: the moments count
    controller: float | None  # A, largest difference of the law's answer; None: not known
    drive: Moments | None  # None: no current is measured
    mechanics: Moments  # effort, N m | N
    lateness: float  # s, root mean square


def twin(running: law.Law, p: stage.Stage, dt: float) -> Twin:
    """The twin of an axis with this model under this law."""
    smooth = p._replace(encoder=p.encoder._replace(step=0.0))  # the log has rounded already
    found = [pair for pair in _candidates(smooth, dt) if pair[0].scale > 0.0]
    models = (smooth, *(change(smooth) for _, change in found))
    return Twin(
        running,
        p,
        dt,
        model_tracking.tracker(p, dt),
        tuple(candidate for candidate, _ in found),
        _drive_candidates(p, dt),
        models,
        friction_length(p.friction),
    )


def _candidates(p: stage.Stage, dt: float) -> list[tuple[Candidate, Callable[[stage.Stage], stage.Stage]]]:
    """Each candidate with the model that is off by `NUDGE` of it."""
    body, force_constant = p.mechanics, p.motor.force_constant
    sliding = stage.sliding(p.friction)
    viscous = body.viscous or _NATURAL * body.inertia
    holding = sliding or _NATURAL * viscous
    length = friction_length(p.friction)
    relative = (0.03, 0.3, "%")
    return [
        (Candidate("inertia", "kg m^2 | kg", body.inertia, body.inertia, *relative), _inertia),
        (Candidate("viscous", "N m s/rad | N s/m", body.viscous, viscous, *relative), _moved("viscous", viscous)),
        (Candidate("coulomb", "N m | N", sliding, sliding, *relative), _coulomb),
        (Candidate("bias", "N m | N", body.bias, holding, *relative), _moved("bias", holding)),
        (Candidate("time_shift", "s", 0.0, dt, 0.5, 1.0, "Ts"), _same),
        (Candidate("force_constant", "N m/A | N/A", force_constant, force_constant, *relative), _force_constant),
        (Candidate(PRESLIDING, "rad | m", length, length, 0.3, 1.0, "%"), _stretched),
        (Candidate(BEND, "", 0.0, float(length > 0.0), 0.3, 1.0, "%"), _bent),
    ]


def _drive_candidates(p: stage.Stage, dt: float) -> tuple[Candidate, ...]:
    holding = (stage.sliding(p.friction) or _NATURAL * p.mechanics.inertia) / p.motor.force_constant
    return (
        Candidate("current_gain", "", 0.0, 1.0, 0.01, 0.3, "%"),
        Candidate("current_offset", "A", 0.0, holding, 0.03, 0.3, "%"),
        Candidate("dead_time", "s", 0.0, dt, 0.05, 1.0, "Ts"),
    )


def _same(p: stage.Stage) -> stage.Stage:
    return p  # its rows are nudged, not its model


def _inertia(p: stage.Stage) -> stage.Stage:
    return p._replace(mechanics=p.mechanics._replace(inertia=p.mechanics.inertia * (1.0 + NUDGE)))


def _moved(field: str, scale: float) -> Callable[[stage.Stage], stage.Stage]:
    def change(p: stage.Stage) -> stage.Stage:
        value = getattr(p.mechanics, field) + NUDGE * scale
        return p._replace(mechanics=p.mechanics._replace(**{field: value}))

    return change


def _coulomb(p: stage.Stage) -> stage.Stage:
    return p._replace(friction=stage.scaled_friction(p.friction, 1.0 + NUDGE))


def _force_constant(p: stage.Stage) -> stage.Stage:
    return p._replace(motor=p.motor._replace(force_constant=p.motor.force_constant * (1.0 + NUDGE)))


def _stretched(p: stage.Stage) -> stage.Stage:
    """The rolling zone, longer."""
    return p._replace(friction=stage.stretched_friction(p.friction, 1.0 + NUDGE))


def _bent(p: stage.Stage) -> stage.Stage:
    """Another curve into the same friction: weight from short elements to long ones, or another exponent."""
    rolling, bristle = p.friction.operators, p.friction.bristle
    weight = np.asarray(rolling.weight, dtype=np.float64)
    order = np.log(np.maximum(np.asarray(rolling.slip, dtype=np.float64), 1e-300))
    lean = order - np.average(order, weights=weight) if weight.sum() > 0.0 else np.zeros(len(weight))
    leaning = weight * (1.0 + NUDGE * lean / max(float(np.max(np.abs(lean))), 1e-300))
    operators = rolling._replace(weight=leaning)
    return p._replace(
        friction=p.friction._replace(
            operators=operators, bristle=bristle._replace(exponent=bristle.exponent * (1.0 + NUDGE))
        )
    )


def friction_length(p: stage.Friction) -> float:
    """Displacement (rad | m) after which all of the friction slips; 0 without presliding."""
    pairs = zip(p.operators.weight, p.operators.slip, strict=True)
    longest = max((float(slip) for weight, slip in pairs if weight > 0.0), default=0.0)
    return max(longest, 3.0 * p.bristle.coulomb / p.bristle.stiffness)


def begin(p: Twin, position: float, controller: law.State | None) -> State:
    """All models at rest where the encoder reads `position` (rad | m)."""
    states = [tracked_model.State(stage.at_reading(model, position), feedback.AT_REST) for model in p.models]
    return State(controller, tuple(states), np.full(_SPAN, position), 0.0, float("nan"), 0, 0.0)


def step(p: Twin, x: State | None, rows: Array) -> tuple[Block, State]:
    """One block of ring rows (n, WIDTH); `x` is None at the first row of a run.

    Where periods are missing the models begin anew, and the controller's memory is not known any more.
    """
    if x is None:
        x = begin(p, float(rows[0, _AT["measured"]]), law.AT_REST)
    elif rows[0, 0] - x.time > 1.5 * p.dt:
        x = begin(p, float(rows[0, _AT["measured"]]), None)
    path = np.ascontiguousarray(rows[:, _PATH])
    controller, memory = _parity(p, x.law, rows)
    corrections, given, states = _tied(p, x, path)
    travelled = float(np.sum(np.abs(np.diff(path[:, 1], prepend=x.before[-1]))))
    settled = x.rows * p.dt >= CALM and x.travelled >= SETTLED * p.length
    ended = not np.any(rows[:, _AT["fault"]])
    block = Block(
        float(rows[-1, 0]),
        len(rows),
        settled and ended and travelled > 2.0 * p.length,
        controller,
        _drive(p, path[:, 2], given, x.given),
        _mechanics(p, corrections),
        float(np.sqrt(np.mean(rows[:, _AT["lateness"]] ** 2))),
    )
    before = np.concatenate([x.before, path[:, 1]])[-_SPAN:]
    after = State(memory, states, before, float(given[-1]), block.time, x.rows + len(rows), x.travelled + travelled)
    return block, after


def pieces(rows: Array, dt: float) -> list[Array]:
    """`rows` cut wherever periods are missing."""
    return np.split(rows, np.flatnonzero(np.diff(rows[:, 0]) > 1.5 * dt) + 1)


def _parity(p: Twin, x: law.State | None, rows: Array) -> tuple[float | None, law.State | None]:
    if x is None:
        return None, None
    out = np.empty((len(rows), len(law.Output._fields)))
    setpoints, measured = rows[:, _SETPOINT], rows[:, _AT["measured"]]
    x = rollout.answers(p.law, x, (np.ascontiguousarray(setpoints), np.ascontiguousarray(measured), out))
    return float(np.max(np.abs(out[:, law.OUTPUT_COLUMNS["current"]] - rows[:, _AT["current"]]))), x


def _tied(p: Twin, x: State, path: Array) -> tuple[Array, Array, tuple[tracked_model.State, ...]]:
    """Corrections (models, n) A, the current of the drive model (n,) A, and all states at the end."""
    out = np.empty((len(p.models), len(path), 2))
    shifted = path.copy()
    past = np.concatenate([x.before, path[:, 1]])
    shifted[:, 1] += NUDGE * (path[:, 1] - past[: len(path)]) / _SPAN
    late = next(k for k, candidate in enumerate(p.mechanics, 1) if candidate.name == "time_shift")
    states = []
    for k, model in enumerate(p.models):
        followed = shifted if k == late else path
        states.append(
            tracked_model.follow(tracked_model.Tied(model, p.tracker), x.tied[k], (followed, out[k]), p.dt, p.substeps)
        )
    return out[:, :, 0], out[0, :, 1], tuple(states)


def _mechanics(p: Twin, corrections: Array) -> Moments:
    taken = max(1, round(AVERAGED / p.dt))
    corrections = np.add.reduceat(corrections, np.arange(0, corrections.shape[1], taken), axis=1) / taken
    own = np.array([model.motor.force_constant for model in p.models])  # E - Kt i: linear in Kt, too
    lacking = own[:, None] * corrections
    return _moments((lacking[1:] - lacking[0]).T / NUDGE, -lacking[0])


def _drive(p: Twin, measured: Array, given: Array, before: float) -> Moments | None:
    if np.isnan(measured).any():
        return None
    late = -np.diff(given, prepend=before)
    offset = np.full(len(given), p.drive[1].scale)
    return _moments(np.column_stack([given, offset, late]), measured - given)


def _moments(columns: Array, target: Array) -> Moments:
    return Moments(columns.T @ columns, columns.T @ target, float(target @ target), len(target))
