"""Cut A: the command recomputed from reference and position with the deployed law, against the logged one.

Neither machine nor drive has a part in it, so it must agree to the digits of the log.  Where it does not, the
controller that ran is not the one that is described, and whatever else is found would be found on wrong grounds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.parallel import in_parallel
from stagectl.gap.controller_check.causes import probable, slight, unexplained
from stagectl.gap.logs.load_session import gathered
from stagectl.gap.logs.row_validity import runs
from stagectl.gap.logs.session import Array, Log, Session
from stagectl.kernels import law, rollout
from stagectl.number_format import duration

SHARE = 1e-4  # of the command's rms: what may be left where nothing is rounded
DIGITS = 1e-6  # of the command's rms: what the digits of a log leave; between the two, a wrong gain may hide
FORGOTTEN = 0.05  # s after a gap, until the derivative's filter has forgotten it
BEGINNING = 0.2  # of a log, within which what the controller had stored before may die out
CORNER = 20  # rows around a corner of the reference, where a spline is another curve than the motion's formula
SHARP = 30.0  # fourth difference of the reference against its neighbourhood: a corner
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


class Compared(NamedTuple):
    """One log's command, logged and recomputed."""

    log: Log
    terms: Array  # (n, 7) of law.Output
    difference: Array  # (n,) A, logged minus recomputed; NaN in rows that do not count
    notes: tuple[str, ...]

    @property
    def worst(self) -> tuple[float, int]:
        """The largest difference (A), and its row."""
        size = np.abs(self.difference)
        if np.all(np.isnan(size)):
            return 0.0, 0
        row = int(np.nanargmax(size))
        return float(size[row]), row


def comparable(session: Session) -> list[Log]:
    """Logs whose command can be recomputed."""
    if session.law is None:
        return []
    return [log for log in session.logs if log.command is not None and log.setpoints is not None and log.exact]


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


def compared(session: Session, allowed: float) -> list[Compared]:
    """All comparable logs recomputed; harmless rows are looked for where more than `allowed` (A) is left."""
    logs, p = comparable(session), session.law
    assert p is not None
    return in_parallel(lambda log: _compared(p, log, session.dt, allowed), logs)


def recomputed(p: law.Law, setpoints: Array, position: Array) -> Array:
    """The terms (n, 7) of `kernels.law.Output` that the law answers."""
    out = np.zeros((len(position), len(law.Output._fields)))
    rollout.answers(p, (np.ascontiguousarray(setpoints), np.ascontiguousarray(position), out))
    return out


def _compared(p: law.Law, log: Log, dt: float, allowed: float) -> Compared:
    assert log.setpoints is not None and log.command is not None
    terms = recomputed(p, log.setpoints, log.position)
    difference = log.command - terms[:, law.Output._fields.index("command")]
    difference, notes = _after_gaps(difference, log, dt)
    for harmless in (_begun_before, _corners):
        if np.nanmax(np.abs(difference), initial=0.0) > allowed:
            difference, note = harmless(difference, log, dt, allowed)
            notes += note
    return Compared(log, terms, difference, tuple(notes))


def _after_gaps(difference: Array, log: Log, dt: float) -> tuple[Array, list[str]]:
    """Without rows that do not count; after each of their stretches the integrator is where it is."""
    if np.all(log.valid):
        return difference, []
    found, largest = _levelled(difference, log.valid, round(FORGOTTEN / dt))
    return found, [f"after gaps the integrator is taken as it was ({largest:.2g} A at most)"] if largest else []


def _levelled(difference: Array, counts: NDArray[np.bool_], forgotten: int) -> tuple[Array, float]:
    """The difference in rows that count, without its constant part after each stretch that does not; and the largest.

    What was not told there stays in the integrator; the first `forgotten` rows do not count, either.
    """
    found, largest = np.where(counts, difference, np.nan), 0.0
    for begin, end in runs(counts):
        if begin == 0:
            continue
        start = min(begin + forgotten, end)
        found[begin:start] = np.nan
        if start < end:
            offset = float(np.median(found[start:end]))
            largest = max(largest, abs(offset))
            found[start:end] -= offset
    return found, largest


def _begun_before(difference: Array, log: Log, dt: float, allowed: float) -> tuple[Array, list[str]]:
    """A log that begins while the controller runs: what it had stored dies out, but for the integrator."""
    rows = len(difference)
    offset = float(np.nanmedian(difference[rows // 2 :])) if np.any(np.isfinite(difference[rows // 2 :])) else 0.0
    left = difference - offset
    wrong = np.flatnonzero(np.abs(np.nan_to_num(left)) > allowed)
    until = int(wrong[-1]) + 1 if wrong.size else 0
    if until > BEGINNING * rows:
        return difference, []
    left[:until] = np.nan
    words = f"it begins while the controller runs: {offset:.3g} A are in its integrator"
    return left, [words + (f", and the first {duration(until * dt)} do not count" if until else "")]


def _corners(difference: Array, log: Log, dt: float, allowed: float) -> tuple[Array, list[str]]:
    """Around corners of the reference's acceleration, which the controller may have known better than its samples."""
    if log.reference is None or len(log.reference) < 4 * CORNER:
        return difference, []
    bend = np.abs(np.diff(log.reference, 4, prepend=[0.0] * 2, append=[0.0] * 2))
    bend[:4] = bend[-4:] = 0.0
    around = np.lib.stride_tricks.sliding_window_view(np.pad(bend, CORNER, mode="edge"), 2 * CORNER + 1)
    noise = 1e-15 * float(np.abs(log.reference).max(initial=0.0)) * 16.0
    sharp = bend > SHARP * np.median(around, axis=1) + noise
    near = np.convolve(sharp.astype(np.float64), np.ones(2 * CORNER + 1), mode="same") > 0.5
    left, _ = _levelled(difference, ~near & np.isfinite(difference), 0)
    if np.nanmax(np.abs(left), initial=0.0) > allowed:  # it is not the corners
        return difference, []
    worst = float(np.nanmax(np.abs(difference)))
    return left, [
        f"around {len(runs(near))} corners of its reference the command differs by up to {worst:.2g} A, as the "
        "samples do not hold them: these rows do not count"
    ]


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
