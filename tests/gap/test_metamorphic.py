"""What must not change an answer: the same logs in other units, mirrored, later, shifted, in another order.

No truth is needed for that, so it holds on measured records as well.  All changes are made at once: an answer that
stays minds none of them.  `STAGECTL_LONG=1` makes them one by one, on all records.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.gap import diagnose
from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.result.diagnosis import DiagnosisResult
from stagectl.kernels import friction
from tests.gap import measured

MOVED = 0.05  # by which a probability may move
RECORDS: dict[str, Callable[[Path], Session]] = {
    "joint 4": lambda place: measured.ur10e(place, 4, 0.5),
    "pulses": lambda place: measured.cnc(place, "Pulse_6Nm_10ms", "Pulse_9Nm_10ms", "Pulse_9Nm_20ms"),
    "joint 6": lambda place: measured.ur10e(place, 6, 0.3),
    "joint 1": lambda place: measured.ur10e(place, 1, 5.5),
    "slow motor": lambda place: measured.odrive(place, "slow2_nocomp_0", "slow2_nocomp_1"),
    "torque steps": lambda place: measured.hsm150(place, "idf_neg_0.04_1", "idf_pos_0.06_1"),
}
LONG = bool(os.environ.get("STAGECTL_LONG"))


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


def _answer(session: Session) -> DiagnosisResult:
    return diagnose.diagnose(session, diagnose.Options(advice=False), lambda _: None).result


def _probabilities(result: DiagnosisResult) -> dict[str, float]:
    return {effect.name: effect.probability for effect in result.effects}


@pytest.fixture(scope="module", params=RECORDS if LONG else ["joint 4"])
def known(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, DiagnosisResult]:
    """A record, and what is said of it as it is."""
    session = RECORDS[request.param](tmp_path_factory.mktemp("record"))
    return session, _answer(session)


@pytest.mark.parametrize("relation", RELATIONS if LONG else [at_once], ids=lambda relation: relation.__name__)
def test_the_answer_stays(known: tuple[Session, DiagnosisResult], relation: Callable[[Session], Session]) -> None:
    session, before = known
    after = _answer(relation(session))
    assert after.verdict == before.verdict
    old, new = _probabilities(before), _probabilities(after)
    for name in {*old, *new}:
        assert abs(old.get(name, 0.0) - new.get(name, 0.0)) <= MOVED, name
    scale = 1e3 if relation in (stronger, at_once) else 1.0
    assert after.gap.before == pytest.approx(scale * before.gap.before, rel=0.02)
    assert after.gap.after == pytest.approx(scale * before.gap.after, rel=0.05)
