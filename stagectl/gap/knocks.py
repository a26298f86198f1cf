"""True answers on real records: a term is knocked out of the model, or a known force is knocked into the record.

Out: the model lacks what it had, so that the machine has an effect that it does not know: its name is the answer.
In: an effort of a known form is added to the recorded one, as if the motor had had to overcome it::

    command' = command + F(x, v, t) / K,      rms(F) = share rms(K command)

The loop never felt that force, so that its controller counts as unknown, and the gap is that of the effort.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, filtfilt

from stagectl.gap.found import Effect, Found
from stagectl.gap.library import put
from stagectl.gap.session import Array, GapError, Log, Session
from stagectl.kernels import friction
from stagectl.kernels.stage import Stage

MASS = 0.2  # share of the inertia that is taken out
REST = 0.02  # share of Coulomb friction that stays: the rolling zone keeps its length
CUT_OFF = 50.0  # Hz, of the motion along which a force is made

Motion = tuple[Array, Array, Array]  # position, velocity, time, each (n,)
Force = Callable[[Motion], Array]


class Knock(NamedTuple):
    """A session with a true answer."""

    name: str
    way: str  # out | in
    session: Session


class Told(NamedTuple):
    """What the diagnosis said of a knock."""

    name: str
    way: str
    verdict: str
    named: tuple[tuple[str, ...], ...]  # each name with its alternatives
    right: bool  # the knocked term is among them
    closure: float


def out(session: Session) -> list[Knock]:
    """The session with a model that lacks viscous friction, Coulomb friction, its bias, a fifth of its inertia."""
    models = {
        "viscous": _with(session.stage, "viscous", 0.0),
        "coulomb": _without_coulomb(session.stage),
        "bias": _with(session.stage, "bias", 0.0),
        "inertia": _with(session.stage, "inertia", (1.0 - MASS) * session.stage.mechanics.inertia),
    }
    return [
        Knock(name, "out", session._replace(stage=model))
        for name, model in models.items()
        if model is not session.stage
    ]


def _with(p: Stage, name: str, value: float) -> Stage:
    """`p` with another value of its mechanics; itself where that stands there already."""
    return p if getattr(p.mechanics, name) == value else put(p, f"mechanics.{name}", value)


def _without_coulomb(p: Stage) -> Stage:
    rolling, bristle = p.friction.operators, p.friction.bristle
    operators = friction.bundle([REST * float(one) for one in rolling.weight], [float(one) for one in rolling.slip])
    changed = bristle._replace(coulomb=REST * bristle.coulomb, stiffness=REST * bristle.stiffness)
    return p._replace(friction=p.friction._replace(operators=operators, bristle=changed))


FORCES: Mapping[str, Force] = {
    "viscous_nonlinear": lambda m: m[1] * np.abs(m[1]),
    "viscous_asymmetry": lambda m: np.abs(m[1]),
    "position_friction": lambda m: _centred(m[0]) * np.tanh(m[1] / (0.01 * np.abs(m[1]).max())),
    "cable_spring": lambda m: _centred(m[0]),
    "friction_step": lambda m: np.tanh(m[1] / (0.01 * np.abs(m[1]).max())) * (m[2] > 0.55 * m[2][-1]),
}


def _centred(position: Array) -> Array:
    centred: Array = position - 0.5 * (position.min() + position.max())
    return centred


def into(session: Session, names: Sequence[str], share: float) -> list[Knock]:
    """The session with each of the forces added, of this share of the recorded effort's rms.

    Raises GapError where a log holds no command, or a name is none of `FORCES`.
    """
    if any(log.command is None for log in session.logs):
        raise GapError("a log holds no command: no force can be added to it")
    if unknown := [name for name in names if name not in FORCES]:
        raise GapError(f"--into {unknown[0]}: no such force; must be one of {', '.join(FORCES)}")
    return [Knock(name, "in", _with_force(session, FORCES[name], share)) for name in names]


def _with_force(session: Session, force: Force, share: float) -> Session:
    logs = tuple(_pushed(log, session.dt, force, share) for log in session.logs)
    return session._replace(logs=logs, law=None)


def _pushed(log: Log, dt: float, force: Force, share: float) -> Log:
    numerator, denominator = butter(2, min(2.0 * CUT_OFF * dt, 0.9))
    position = np.asarray(filtfilt(numerator, denominator, log.position), dtype=np.float64)
    found = force((position, np.gradient(position, dt), dt * np.arange(log.rows, dtype=np.float64)))
    command = log.command if log.command is not None else np.zeros(log.rows)
    added = found * (share * float(np.std(command)) / max(float(np.sqrt(np.mean(found * found))), 1e-300))
    current = None if log.current is None else log.current + added
    return log._replace(command=command + added, current=current, setpoints=None)


def judged(knock: Knock, found: Found, before: Found | None = None) -> Told:
    """Whether the knocked term is among what is named; what the plain record has already counts for nothing."""
    known = {one.name for one in before.named if not one.parameter} if before is not None else set[str]()
    named = tuple((one.name, *one.alternatives) for one in found.named)
    mine: list[Effect] = [one for one in found.named if knock.name in (one.name, *one.alternatives)]
    right = bool(mine) and knock.name not in known
    return Told(knock.name, knock.way, found.verdict, named, right, found.gap.closure)
