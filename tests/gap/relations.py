"""What must not change an answer: the same logs in other units, mirrored, later, shifted, in another order."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from stagectl.gap.logs.session import Array, Log, Session
from stagectl.kernels import friction


def _columns(log: Log, change: Callable[[Array], Array], *names: str) -> Log:
    values: dict[str, Any] = {name: getattr(log, name) for name in names}
    changed: dict[str, Any] = {name: change(value) for name, value in values.items() if value is not None}
    return log._replace(**changed)


def mirrored(session: Session) -> Session:
    """Positive is the other way."""
    logs = tuple(_columns(log, np.negative, "position", "command", "current", "reference") for log in session.logs)
    mechanics = session.stage.mechanics
    stage = session.stage._replace(mechanics=mechanics._replace(bias=-mechanics.bias))
    return session._replace(logs=logs, stage=stage)


def elsewhere(session: Session) -> Session:
    """Zero is somewhere else."""
    logs = tuple(_columns(log, lambda x: x + 0.37, "position", "reference") for log in session.logs)
    return session._replace(logs=logs)


def later(session: Session) -> Session:
    """The session's clock began earlier."""
    return session._replace(logs=tuple(log._replace(start=log.start + 50.0) for log in session.logs))


def reordered(session: Session) -> Session:
    """The captures in another order."""
    return session._replace(logs=tuple(reversed(session.logs)))


def stronger(session: Session) -> Session:
    """Efforts in mN m: all of them are a thousand times as large."""
    p = session.stage
    mechanics = p.mechanics._replace(inertia=1e3 * p.mechanics.inertia, viscous=1e3 * p.mechanics.viscous)
    operators = friction.bundle([1e3 * float(w) for w in p.friction.operators.weight], p.friction.operators.slip)
    motor = p.motor._replace(force_constant=1e3 * p.motor.force_constant)
    rubbing = p.friction._replace(operators=operators)
    return session._replace(stage=p._replace(mechanics=mechanics, friction=rubbing, motor=motor))


RELATIONS = (mirrored, elsewhere, later, reordered, stronger)


def at_once(session: Session) -> Session:
    """All of them."""
    return functools.reduce(lambda changed, relation: relation(changed), RELATIONS, session)
