"""Whether the logs are in the units and of the sign that they say: the nominal model is the measure."""

from __future__ import annotations

import numpy as np

from stagectl.gap.logs.session import Log, LogError, Session
from stagectl.recording import wrong_units
from stagectl.recording.wrong_units import Mistake


def check_units(session: Session) -> None:
    """Raises LogError where one and the same mistake explains every log, and the nominal model none as it is."""
    mistakes = [_mistake(session, log) for log in session.logs]
    if mistakes and mistakes[0] is not None and all(mistake is mistakes[0] for mistake in mistakes):
        names = tuple(log.name for log in session.logs)
        raise LogError("unit", names, f"{names[0]}: {mistakes[0].sentence}")


def _mistake(session: Session, log: Log) -> Mistake | None:
    current, rows = log.command if log.current is None else log.current, log.valid
    if current is None or not np.ptp(log.position[rows]):
        return None
    moved = wrong_units.motion(log.position[rows], current[rows], session.dt)
    return wrong_units.likely_mistake(moved, session.stage)
