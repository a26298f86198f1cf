"""The command of each log recomputed with the deployed law, without the rows in which a difference means nothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.logs.row_validity import stretches
from stagectl.gap.logs.session import Array, Log, Session
from stagectl.kernels import law, rollout
from stagectl.number_format import duration
from stagectl.parallel import in_parallel

FORGOTTEN = 0.05  # s after a gap, until the derivative's filter has forgotten it
BEGINNING = 0.2  # of a log, within which what the controller had stored before may die out
CORNER = 20  # rows around a corner of the reference, where a spline is another curve than the motion's formula
SHARP = 30.0  # fourth difference of the reference against its neighbourhood: a corner


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
    for begin, end in stretches(counts):
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
        f"around {len(stretches(near))} corners of its reference the command differs by up to {worst:.2g} A, as the "
        "samples do not hold them: these rows do not count"
    ]
