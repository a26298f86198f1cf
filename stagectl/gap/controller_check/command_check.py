"""Cut A: the command recomputed from reference and position with the deployed law, against the logged one.

Neither machine nor drive has a part in it, so it must agree to the digits of the log.  Where it does not, the
controller that ran is not the one that is described, and whatever else is found would be found on wrong grounds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stagectl.gap.controller_check.causes import probable, slight, unexplained
from stagectl.gap.controller_check.recomputed_command import Compared, comparable, compared
from stagectl.gap.logs.load_session import gathered
from stagectl.gap.logs.session import Array, Log, Session

SHARE = 1e-4  # of the command's rms: what may be left where nothing is rounded
DIGITS = 1e-6  # of the command's rms: what the digits of a log leave; between the two, a wrong gain may hide
_DECIMALS = range(3, 13)


class Parity(NamedTuple):
    """Whether the logged commands are those of the deployed controller."""

    checked: bool  # False: it could not be, and `words` say why; then it agrees with all that is known
    worst: float  # A, largest difference of the rows that count
    at: tuple[str, float]  # file and time (s) of it
    limit: float  # A
    agrees: bool
    words: str


def parity(session: Session) -> Parity:
    """Cut A of a whole session, with the probable cause where it fails."""
    if not comparable(session):
        return impossible(session)
    logs = comparable(session)
    allowed = limit(session, logs)
    strict = judged(session, compared(session, allowed), allowed)
    if strict.agrees:
        return strict
    counted = _gain(session) * session.stage.encoder.step
    if counted <= allowed:
        return strict
    each = compared(session, counted)
    found = max(each, key=lambda one: one.worst[0])
    worst, row = found.worst
    if worst > counted or not unexplained(session, each):
        return strict
    return Parity(
        True,
        worst,
        (found.log.name, row * session.dt),
        counted,
        True,
        f"the recomputed command agrees within {worst:.2g} A, what a count of the position makes ({counted:.2g} A): "
        f"the controller saw it finer than it was logged, and nothing systematic is left{_noted(each)}",
    )


def judged(session: Session, each: list[Compared], allowed: float) -> Parity:
    """Whether all agree within the limit `allowed` (A), and no wrong gain hides in it."""
    found = max(each, key=lambda one: one.worst[0])
    worst, row = found.worst
    at = (found.log.name, row * session.dt)
    hidden = slight(session, each) if DIGITS / SHARE * allowed < worst <= allowed else ""
    if worst <= allowed and not hidden:
        words = f"the recomputed command agrees within {worst:.2g} A (limit {allowed:.2g} A){_noted(each)}"
        return Parity(True, worst, at, allowed, True, words)
    yet = f"within the limit of {allowed:.2g} A, yet" if hidden else f"limit {allowed:.2g} A:"
    words = (
        f"the logged command differs from the recomputed one by up to {worst:.3g} A in {at[0]} at {at[1]:.6g} s, {yet} "
        f"{hidden or probable(session, each, allowed)}{_noted(each)}"
    )
    return Parity(True, worst, at, allowed, False, words)


def _noted(each: list[Compared]) -> str:
    notes = [(one.log.name, note) for one in each for note in one.notes]
    return "".join(f"; {note}" for note in gathered(notes, len(each)))


def impossible(session: Session) -> Parity:
    """Why it cannot be checked."""
    if session.law is None:
        why = "the deployed controller is not known"
    elif all(log.command is None for log in session.logs):
        why = "no command was logged"
    elif all(log.setpoints is None for log in session.logs):
        why = "no reference was logged"
    else:
        why = "no log was sampled at the controller's own periods"
    return Parity(False, float("nan"), ("", float("nan")), float("nan"), True, f"the controller is not checked: {why}")


def limit(session: Session, logs: list[Log]) -> float:
    """What may be left (A): a step of the command, 1e-4 of its rms, or what the digits of the log cost."""
    commands = np.concatenate([log.command[log.valid] for log in logs if log.command is not None])
    if not len(commands):
        return 0.0
    rms = float(np.sqrt(np.mean(commands * commands)))
    return max(SHARE * rms, resolution(commands), *(_rounding(session, log) for log in logs))


def resolution(values: Array) -> float:
    """The step of values that were rounded; 0 where they were not."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-12 * float(np.abs(values).max(initial=0.0))]
    if not len(steps):
        return 0.0
    step = float(steps.min())
    whole = values[:: max(len(values) // 5000, 1)] / step
    close = np.abs(whole - np.rint(whole)) < 0.01 + 1e-3 * np.minimum(np.abs(whole), 100.0)
    return step if np.mean(close) > 0.99 else 0.0


def _rounding(session: Session, log: Log) -> float:
    """What positions that were written with few decimals cost (A)."""
    return 0.5 * _gain(session) * _decimal(log.position, session.stage.encoder.step)


def _gain(session: Session) -> float:
    """The feedback's gain at the highest frequency (A/rad | A/m)."""
    p = session.law
    assert p is not None
    if p.cascaded:
        return p.cascade.velocity * (p.cascade.position + 2.0 / p.cascade.dt)
    return abs(p.feedback.proportional) + 2.0 * abs(p.feedback.derivative)


def _decimal(values: Array, step: float) -> float:
    """The decimal that values were written to; 0 where there is none, or it is the encoder's own step."""
    some = values[:: max(len(values) // 2000, 1)]
    for digits in _DECIMALS:
        unit = 10.0**-digits
        if np.all(np.abs(some / unit - np.rint(some / unit)) < 1e-4) and np.any(some != some[0]):
            own = step > 0.0 and abs(step / unit - round(step / unit)) < 1e-6
            return 0.0 if own else unit
    return 0.0
