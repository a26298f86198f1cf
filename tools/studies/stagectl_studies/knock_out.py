"""True answers on real records: a term is knocked out of the model, or a known force is knocked into the record.

Out: the model is without a term that it had, so the machine has an effect that the model does not know.
In: an effort of a known form is added to the recorded one, as if the motor had had to overcome it::

    command' = command + F(x, v, t) / K,      rms(F) = share rms(K command)

The loop never felt that force, so its controller counts as unknown, and the gap is that of the effort.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, filtfilt

from stagectl.gap.effects.stage_changes import put
from stagectl.gap.logs.session import Array, GapError, Log, Session
from stagectl.gap.result.diagnosis import DiagnosisResult
from stagectl.kernels import stage
from stagectl.kernels.stage import Stage
from stagectl.problem import Problem, ProblemKind

KNOCKED_INERTIA = 0.2  # of the inertia; chosen.  What is knocked out of the model.
KEPT_COULOMB = 0.02  # of Coulomb friction; chosen.  What stays, so that the rolling zone keeps its length.
MOTION_CUTOFF = 50.0  # Hz; chosen.  Low-pass of the motion along which a force is made.
SIGN_SPEED = 0.01  # of the largest speed; chosen.  Width of the smoothed sign of the velocity.
STEP_TIME = 0.55  # of the session; chosen.  When the friction steps.


class LoggedMotion(NamedTuple):
    """One log's motion, (n,) each."""

    position: Array  # rad | m from the middle of the session's travel
    velocity: Array  # rad/s | m/s
    side: Array  # -1 to 1: its sign, without a jump
    time: Array  # 0 to 1, of the session


Force = Callable[[LoggedMotion], Array]


class Knock(NamedTuple):
    """A session with a true answer."""

    name: str
    way: str  # out | in
    session: Session


class KnockResult(NamedTuple):
    """What the diagnosis found of a knock."""

    name: str
    way: str
    verdict: str
    named: tuple[tuple[str, ...], ...]  # each name with its alternatives
    right: bool  # the knocked term is among them
    closure: float


def out(session: Session) -> list[Knock]:
    """The session with a model without viscous friction, Coulomb friction, its bias, a fifth of its inertia."""
    models = {
        "viscous": _with(session.stage, "viscous", 0.0),
        "coulomb": put(session.stage, "friction", stage.scaled_friction(session.stage.friction, KEPT_COULOMB)),
        "bias": _with(session.stage, "bias", 0.0),
        "inertia": _with(session.stage, "inertia", (1.0 - KNOCKED_INERTIA) * session.stage.mechanics.inertia),
    }
    return [
        Knock(name, "out", session._replace(stage=model))
        for name, model in models.items()
        if model is not session.stage
    ]


def _with(p: Stage, name: str, value: float) -> Stage:
    """`p` with another value of its mechanics; `p` itself where it has that value already."""
    return p if getattr(p.mechanics, name) == value else put(p, f"mechanics.{name}", value)


FORCES: Mapping[str, Force] = {
    "viscous_nonlinear": lambda m: m.velocity * np.abs(m.velocity),
    "viscous_asymmetry": lambda m: np.abs(m.velocity),
    "position_friction": lambda m: m.position * m.side,
    "cable_spring": lambda m: m.position,
    "friction_step": lambda m: m.side * (m.time > STEP_TIME),
}


def into(session: Session, names: Sequence[str], share: float) -> list[Knock]:
    """The session with each of the forces added, of this share of the recorded effort's rms.

    Raises GapError where a log holds no command, or a name is none of `FORCES`.
    """
    if any(log.command is None for log in session.logs):
        raise GapError(Problem("a log holds no command: no force can be added to it", ProblemKind.MISSING))
    if unknown := [name for name in names if name not in FORCES]:
        raise GapError(Problem("no such force", ProblemKind.UNKNOWN, "--into", unknown[0], choices=tuple(FORCES)))
    return [Knock(name, "in", _with_force(session, FORCES[name], share)) for name in names]


def _with_force(session: Session, force: Force, share: float) -> Session:
    """One law over all logs: one middle of the travel, one clock, one amplitude."""
    forces = [force(motion) for motion in _motions(session)]
    commands = [log.command for log in session.logs if log.command is not None]
    scale = share * _rms(commands) / max(_rms(forces), 1e-300)
    logs = tuple(_pushed(log, scale * added) for log, added in zip(session.logs, forces, strict=True))
    return session._replace(logs=logs, law=None)


def _rms(signals: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(signals) ** 2)))


def _motions(session: Session) -> list[LoggedMotion]:
    """The motion of each log, along its smoothed path."""
    dt = session.dt
    numerator, denominator = butter(2, min(2.0 * MOTION_CUTOFF * dt, 0.9))
    paths = [np.asarray(filtfilt(numerator, denominator, log.position), dtype=np.float64) for log in session.logs]
    velocities = [np.gradient(path, dt) for path in paths]
    clocks = [log.start + dt * np.arange(log.rows, dtype=np.float64) for log in session.logs]
    middle = 0.5 * (min(float(path.min()) for path in paths) + max(float(path.max()) for path in paths))
    slow = SIGN_SPEED * max(float(np.abs(velocity).max()) for velocity in velocities)
    begin, end = min(float(clock[0]) for clock in clocks), max(float(clock[-1]) for clock in clocks)
    return [
        LoggedMotion(path - middle, velocity, np.tanh(velocity / slow), (clock - begin) / (end - begin))
        for path, velocity, clock in zip(paths, velocities, clocks, strict=True)
    ]


def _pushed(log: Log, added: Array) -> Log:
    assert log.command is not None  # `into` refuses logs without
    current = None if log.current is None else log.current + added
    return log._replace(command=log.command + added, current=current, setpoints=None)


def judged(knock: Knock, result: DiagnosisResult, before: DiagnosisResult | None = None) -> KnockResult:
    """Whether the knocked term is named; an effect that the unchanged record shows already does not count."""
    known = {effect.name for effect in before.named if not effect.parameter} if before is not None else set[str]()
    named = tuple((effect.name, *effect.alternatives) for effect in result.named)
    right = knock.name not in known and any(knock.name in names for names in named)
    return KnockResult(knock.name, knock.way, result.verdict, named, right, result.gap.closure)
