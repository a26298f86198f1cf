"""Machines of the exam as sessions: another integrator, other friction laws, wider shapes of the effects."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from stagectl_studies.machine.stage_trial import stage_trial
from stagectl_studies.machine.trials import Options, draw

from stagectl.gap import diagnose
from stagectl.gap.logs import load_session
from stagectl.gap.logs.session import Session
from stagectl.gap.result.diagnosis import DiagnosisResult

LONG = bool(os.environ.get("STAGECTL_LONG"))
by_night = pytest.mark.skipif(not LONG, reason="another diagnosis goes through the same code: `make nightly`")


def drawn(
    place: Path, seed: int, *effects: str, scale: float | None = None, stratum: str = "", experiments: str = ""
) -> Session:
    """The short battery on a machine with these effects; of its `experiments` only those that a question needs.

    Most of a diagnosis is the time that its captures last.
    """
    stratum = stratum or ("single" if len(effects) == 1 else "pair")
    stage_trial(draw(seed, stratum, Options(short=True, effects=effects, scale=scale)), place)
    return only(load_session.load([place / "captures"]), *experiments.split())


def only(session: Session, *experiments: str) -> Session:
    """The captures of these experiments; of none: all."""
    logs = tuple(log for log in session.logs if not experiments or log.experiment in experiments)
    return session._replace(logs=logs)


def diagnosed(session: Session, *excluded: str) -> DiagnosisResult:
    """What is said of it, without the advice on a next experiment."""
    return diagnose.diagnose(session, diagnose.Options(excluded=excluded, advice=False), lambda _: None).result
