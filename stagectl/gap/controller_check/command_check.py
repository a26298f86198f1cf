"""The command check: the command recomputed with the deployed law from reference and position, against the logged one.

Neither machine nor drive takes part in it, so both must agree to the digits of the log.  Where they do not, the
controller that ran is not the one that is described, and all further results would rest on a wrong basis.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.controller_check import thresholds
from stagectl.gap.controller_check.causes import Cause, probable, unexplained, within_limit
from stagectl.gap.controller_check.recomputed_command import Comparison, comparable, compared
from stagectl.gap.logs.load_session import gathered
from stagectl.gap.logs.session import Array, Log, Session


class CommandCheck(NamedTuple):
    """Whether the logged commands are those of the deployed controller."""

    agrees: bool  # also where it could not be checked
    words: str
    missing: str = ""  # why it could not be checked: controller | command | reference | periods; empty where it could
    worst: float = math.nan  # A, largest difference of the rows that count
    limit: float = math.nan  # A, largest difference that is allowed
    log: str = ""  # of the largest difference
    time: float = math.nan  # s, of the largest difference
    cause: Cause | None = None  # where it does not agree
    harmless: frozenset[str] = frozenset()  # kinds of differences that did not count: gap | limit | beginning | corner

    @property
    def checked(self) -> bool:
        """Whether the command could be recomputed."""
        return not self.missing


def check_command(session: Session) -> CommandCheck:
    """Check the commands of a whole session, and find the probable cause where they differ."""
    logs = comparable(session)
    if not logs:
        return _not_checked(session)
    allowed = limit(session, logs)
    strict = _judged(session, compared(session, allowed), allowed)
    one_count = _gain(session) * session.stage.encoder.step
    if strict.agrees or one_count <= allowed:
        return strict
    comparisons = compared(session, one_count)
    worst = max(comparison.worst[0] for comparison in comparisons)
    if worst > one_count or not unexplained(session, comparisons):
        return strict
    words = (
        f"the recomputed command agrees within {worst:.2g} A, the effect of one encoder count ({one_count:.2g} A): the "
        "controller had a finer position than the log, and no systematic difference is left"
    )
    return _agreement(session, comparisons, one_count, words)


def _judged(session: Session, comparisons: Sequence[Comparison], allowed: float) -> CommandCheck:
    """Whether all agree within the limit `allowed` (A), and no wrong gain hides within it."""
    worst = max(comparison.worst[0] for comparison in comparisons)
    hidden = (
        within_limit(session, comparisons)
        if thresholds.DIGITS / thresholds.AGREEMENT * allowed < worst <= allowed
        else None
    )
    if worst <= allowed and hidden is None:
        words = f"the recomputed command agrees within {worst:.2g} A (limit {allowed:.2g} A)"
        return _agreement(session, comparisons, allowed, words)
    cause = hidden or probable(session, comparisons, allowed)
    check = _agreement(session, comparisons, allowed, "")
    within = f"which is within the limit of {allowed:.2g} A, but" if hidden else f"limit {allowed:.2g} A:"
    words = (
        f"the logged command differs from the recomputed one by up to {worst:.3g} A in {check.log} at "
        f"{check.time:.6g} s, {within} {cause.described}{check.words}"
    )
    return check._replace(agrees=False, words=words, cause=cause)


def _agreement(session: Session, comparisons: Sequence[Comparison], allowed: float, words: str) -> CommandCheck:
    largest = max(comparisons, key=lambda comparison: comparison.worst[0])
    worst, row = largest.worst
    notes = [(comparison.log.name, harmless.words) for comparison in comparisons for harmless in comparison.harmless]
    return CommandCheck(
        agrees=True,
        words=words + "".join(f"; {note}" for note in gathered(notes, len(comparisons))),
        worst=worst,
        limit=allowed,
        log=largest.log.name,
        time=row * session.dt,
        harmless=frozenset(harmless.kind for comparison in comparisons for harmless in comparison.harmless),
    )


def _not_checked(session: Session) -> CommandCheck:
    if session.law is None:
        missing, why = "controller", "the deployed controller is not known"
    elif all(log.command is None for log in session.logs):
        missing, why = "command", "no command was logged"
    elif all(log.setpoints is None for log in session.logs):
        missing, why = "reference", "no reference was logged"
    else:
        missing, why = "periods", "no log was sampled at the controller's own periods"
    return CommandCheck(True, f"the controller is not checked: {why}", missing)


def limit(session: Session, logs: Sequence[Log]) -> float:
    """Largest difference (A) that is allowed: 1e-4 of the command's rms, its step, or what the log's digits cost."""
    commands = np.concatenate([log.command[log.valid] for log in logs if log.command is not None])
    if not len(commands):
        return 0.0
    rms = float(np.sqrt(np.mean(commands * commands)))
    decimals = [_decimal(log.position, session.stage.encoder.step) for log in logs]
    decimals += [_decimal(log.reference, 0.0) for log in logs if log.reference is not None]
    return max(thresholds.AGREEMENT * rms, resolution(commands), 0.5 * _gain(session) * max(decimals))


def resolution(values: Array) -> float:
    """The step to which `values` (n,) were rounded; 0 where they were not."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > thresholds.SAME_STEP * float(np.abs(values).max(initial=0.0))]
    if not len(steps):
        return 0.0
    step = float(steps.min())
    whole = values[:: max(len(values) // thresholds.COMMAND_SAMPLES, 1)] / step
    allowed = thresholds.STEP_ERROR + thresholds.STEP_ERROR_EACH * np.minimum(np.abs(whole), thresholds.STEPS_COUNTED)
    return step if np.mean(np.abs(whole - np.rint(whole)) < allowed) > thresholds.STEPPED else 0.0


def _gain(session: Session) -> float:
    """The feedback's gain at the highest frequency (A/rad | A/m)."""
    p = session.law
    assert p is not None
    if p.cascaded:
        return p.cascade.velocity * (p.cascade.position + 2.0 / p.cascade.dt)
    return abs(p.feedback.proportional) + 2.0 * abs(p.feedback.derivative)


def _decimal(values: Array, step: float) -> float:
    """The decimal to which `values` (n,) were rounded; 0 where there is none, or it is the encoder's own `step`."""
    some = values[:: max(len(values) // thresholds.POSITION_SAMPLES, 1)]
    for digits in thresholds.DECIMALS:
        unit = 10.0**-digits
        if np.all(np.abs(some / unit - np.rint(some / unit)) < thresholds.ROUNDED) and np.any(some != some[0]):
            own = step > 0.0 and abs(step / unit - round(step / unit)) < thresholds.ENCODER_ALIGNED
            return 0.0 if own else unit
    return 0.0
