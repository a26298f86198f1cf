"""Whether logs and model are in the units and of the sign that they say: each is the measure of the other."""

import numpy as np

from stagectl.gap.logs.session import Log, LogError, Session
from stagectl.recording import wrong_units
from stagectl.recording.constants import LEAST_EXCESS, USUAL
from stagectl.recording.wrong_units import Motion
from stagectl.units import unit_on


def check_units(session: Session) -> None:
    """Raises LogError where one and the same mistake explains every log, and the nominal model none as it is.

    It does so, too, where rows come too rarely to show a motion, and another unit of the times would make it usual.
    """
    names = tuple(log.name for log in session.logs)
    if words := wrong_units.by_pace(session.dt):
        raise LogError("unit", names, f"{names[0]}: {words}")
    mistakes = [wrong_units.likely_mistake(motion, session.stage) for motion in _motions(session)]
    if mistakes and mistakes[0] is not None and all(mistake is mistakes[0] for mistake in mistakes):
        raise LogError("unit", names, f"{names[0]}: {mistakes[0].sentence}")


def inertia_doubt(session: Session) -> str:
    """Why the nominal inertia cannot be in its unit: it needs many times the logs' largest effort; empty if it can."""
    p, motions = session.stage, _motions(session)
    effort = p.motor.force_constant * max((float(np.abs(motion.current).max()) for motion in motions), default=0.0)
    fastest = max((float(np.quantile(np.abs(motion.acceleration), USUAL)) for motion in motions), default=0.0)
    if effort == 0.0 or p.mechanics.inertia * fastest <= LEAST_EXCESS * effort:
        return ""
    unit, force = (unit_on(session.kind, both) for both in ("kg m^2 | kg", "N m | N"))
    takes_all = effort / fastest
    return (
        f" = {p.mechanics.inertia:g} {unit}: what the log accelerates would need {p.mechanics.inertia * fastest:.3g} "
        f"{force}, and its largest effort is {effort:.3g} {force}; must lie in (0, {LEAST_EXCESS * takes_all:.3g}] "
        f"{unit}, and {takes_all:.3g} {unit} would take all of that effort: correct the unit of the inertia or of the "
        "log; where gravity or a spring moves the axis as well, go on with --doubtful"
    )


def _motions(session: Session) -> list[Motion]:
    return [motion for log in session.logs if (motion := _motion(session, log)) is not None]


def _motion(session: Session, log: Log) -> Motion | None:
    current, rows = log.command if log.current is None else log.current, log.valid
    if current is None or not np.ptp(log.position[rows]):
        return None
    return wrong_units.motion(log.position[rows], current[rows], session.dt)
