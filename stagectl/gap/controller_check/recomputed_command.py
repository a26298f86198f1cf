"""The command of each log recomputed with the deployed law, without the rows in which a difference means nothing."""

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.controller_check.thresholds import BEGINNING, CORNER, FORGOTTEN, LIMIT_ROUNDED, REFERENCE_NOISE, SHARP
from stagectl.gap.logs.session import Array, Log, Session
from stagectl.kernels import law
from stagectl.number_format import duration
from stagectl.parallel import in_parallel
from stagectl.recording.replay import recomputed
from stagectl.recording.true_rows import stretches


class Harmless(NamedTuple):
    """A difference that does not count."""

    kind: str  # gap | limit | beginning | corner
    words: str


class Comparison(NamedTuple):
    """One log's command, logged and recomputed."""

    log: Log
    law: law.Law
    logged: Array  # (n,) A, command
    setpoints: Array  # (n, 8)
    terms: Array  # (n, 7) of law.Output
    difference: Array  # (n,) A, logged minus recomputed; NaN in rows that do not count
    harmless: tuple[Harmless, ...]

    @property
    def worst(self) -> tuple[float, int]:
        """The largest difference (A), and its row."""
        size = np.abs(self.difference)
        if np.all(np.isnan(size)):
            return 0.0, 0
        row = int(np.nanargmax(size))
        return float(size[row]), row

    @property
    def recomputed(self) -> Array:
        """(n,) A, before any limit."""
        return self.terms[:, law.OUTPUT_COLUMNS["command"]]


_Remaining = tuple[Array, Harmless | None]  # a difference (n,) A without harmless rows, and what these were


def comparable(session: Session) -> list[Log]:
    """Logs whose command can be recomputed."""
    if session.law is None:
        return []
    return [log for log in session.logs if log.command is not None and log.setpoints is not None and log.exact]


def compared(session: Session, allowed: float) -> list[Comparison]:
    """All comparable logs recomputed; harmless rows are looked for where more than `allowed` (A) is left."""
    logs, p = comparable(session), session.law
    assert p is not None
    return in_parallel(lambda log: _compared(p, log, session.dt, allowed), logs)


def _compared(p: law.Law, log: Log, dt: float, allowed: float) -> Comparison:
    assert log.setpoints is not None and log.command is not None
    terms = recomputed(p, log.setpoints, log.position, log.carried)
    commands = _as_logged(terms[:, law.OUTPUT_COLUMNS["command"]], log.command, p.current_limit)
    difference, gaps = _after_gaps(log.command - commands, log, dt)
    harmless = [gaps]
    for without in (functools.partial(_at_limit, commands=commands, limit=p.current_limit), _beginning, _corners):
        if np.nanmax(np.abs(difference), initial=0.0) > allowed:
            difference, kind = without(difference, log, dt, allowed)
            harmless.append(kind)
    rows = tuple(kind for kind in harmless if kind is not None)
    return Comparison(log, p, log.command, log.setpoints, terms, difference, rows)


def _as_logged(commands: Array, logged: Array, limit: float) -> Array:
    """The recomputed `commands` (n,) A as a controller logs them: before its own `limit` (A), or behind it."""
    behind = np.nanmax(np.abs(logged), initial=0.0) <= limit * (1.0 + LIMIT_ROUNDED)
    clipped: Array = np.clip(commands, -limit, limit) if behind else commands
    return clipped


def _after_gaps(difference: Array, log: Log, dt: float) -> _Remaining:
    """Without rows that do not count; the integrator's state after each gap is taken from the log."""
    if np.all(log.valid):
        return difference, None
    levelled, largest = _levelled(difference, log.valid, round(FORGOTTEN / dt))
    words = f"after gaps the integrator's state is taken from the log ({largest:.2g} A at most)"
    return levelled, Harmless("gap", words) if largest else None


def _levelled(difference: Array, counts: NDArray[np.bool_], forgotten: int) -> tuple[Array, float]:
    """The difference in rows that count, without its constant part after each gap; and the largest such part.

    What is not known of a gap stays in the integrator.  The first `forgotten` rows after it do not count, either.
    """
    levelled, largest = np.where(counts, difference, np.nan), 0.0
    for begin, end in stretches(counts):
        if begin == 0:
            continue
        start = min(begin + forgotten, end)
        levelled[begin:start] = np.nan
        if start < end:
            offset = float(np.median(levelled[start:end]))
            largest = max(largest, abs(offset))
            levelled[start:end] -= offset
    return levelled, largest


def _at_limit(difference: Array, log: Log, dt: float, allowed: float, commands: Array, limit: float) -> _Remaining:
    """Without rows where one of the commands is at the controller's `limit` (A), and without what its integrator keeps.

    Every controller keeps its integrator from winding up in a way of its own.
    """
    assert log.command is not None
    at = np.maximum(np.abs(log.command), np.abs(commands)) >= limit * (1.0 - LIMIT_ROUNDED)
    left, _ = _levelled(difference, ~at & np.isfinite(difference), 0)
    if not np.any(at) or np.nanmax(np.abs(left), initial=0.0) > allowed:  # it is not the limit
        return difference, None
    worst = float(np.nanmax(np.abs(difference)))
    words = (
        f"where the command reaches its limit of {limit:.4g} A, the integrator runs otherwise than in the law that is "
        f"described: the command differs by up to {worst:.2g} A there, and these rows do not count"
    )
    return left, Harmless("limit", words)


def _beginning(difference: Array, log: Log, dt: float, allowed: float) -> _Remaining:
    """A log that begins while the controller runs: its stored state dies out, except for the integrator's."""
    rows = len(difference)
    offset = float(np.nanmedian(difference[rows // 2 :])) if np.any(np.isfinite(difference[rows // 2 :])) else 0.0
    left = difference - offset
    wrong = np.flatnonzero(np.abs(np.nan_to_num(left)) > allowed)
    until = int(wrong[-1]) + 1 if wrong.size else 0
    if until > BEGINNING * rows:
        return difference, None
    left[:until] = np.nan
    words = f"it begins while the controller runs: {offset:.3g} A are in its integrator"
    if until:
        words += f", and the first {duration(until * dt)} do not count"
    return left, Harmless("beginning", words)


def _corners(difference: Array, log: Log, dt: float, allowed: float) -> _Remaining:
    """Without the corners of the reference's acceleration, which the controller may have known better than a log."""
    if log.reference is None or len(log.reference) < 4 * CORNER:
        return difference, None
    near = _near_corners(log.reference)
    left, _ = _levelled(difference, ~near & np.isfinite(difference), 0)
    if np.nanmax(np.abs(left), initial=0.0) > allowed:  # it is not the corners
        return difference, None
    worst = float(np.nanmax(np.abs(difference)))
    words = (
        f"around {len(stretches(near))} corners of its reference the command differs by up to {worst:.2g} A, because "
        "the samples do not resolve them: these rows do not count"
    )
    return left, Harmless("corner", words)


def _near_corners(reference: Array) -> NDArray[np.bool_]:
    bend = np.abs(np.diff(reference, 4, prepend=[0.0] * 2, append=[0.0] * 2))
    bend[:4] = bend[-4:] = 0.0
    around = np.lib.stride_tricks.sliding_window_view(np.pad(bend, CORNER, mode="edge"), 2 * CORNER + 1)
    noise = REFERENCE_NOISE * float(np.abs(reference).max(initial=0.0))
    sharp = bend > SHARP * np.median(around, axis=1) + noise
    return np.convolve(sharp.astype(np.float64), np.ones(2 * CORNER + 1), mode="same") > 0.5
