"""How far the gap shrinks: the held-out runs simulated again in closed loop, before and after.

Nothing of these runs chose an effect or a value.  The gap is measured minus simulated under the same controller and
reference; the floor is what repeats differ by.
"""

import math
from collections.abc import Sequence
from itertools import compress
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.half_strokes import by_experiment, half_strokes, known_from, spans
from stagectl.gap.result.diagnosis import Gap, Trace
from stagectl.gap.validation.rollouts import column
from stagectl.gap.validation.thresholds import BOOTSTRAP_RESAMPLES, LEAST_RESAMPLES


class JudgedLog(NamedTuple):
    """A log, and the half strokes over which its gap is summed."""

    log: Log
    strokes: list[slice]


class StrokeSums(NamedTuple):
    """Sums of squares over each half stroke (c,), of one model; repeats of a half stroke are wrong alike: one sum."""

    squares: Array  # of the channel's unit
    samples: Array


def judged_logs(session: Session, logs: Sequence[Log]) -> list[JudgedLog]:
    """The logs in half strokes, less the rows in which the friction's state is still that of an earlier motion.

    No model can know that state; it is forgotten once the axis has moved through its rolling zone.
    """
    zone, judged = friction_family.length(session.stage.friction), []
    for log in logs:
        valid = log.valid.copy()
        valid[: known_from(log.position, zone)] = False
        judged.append(JudgedLog(log._replace(valid=valid), spans(half_strokes(log.position, session.dt))))
    return judged


def remaining(judged: Sequence[JudgedLog], rows: Sequence[Array]) -> Array:
    """Sums of squares (k,) of measured less simulated position, one of each experiment."""
    sums: dict[str, float] = {}
    for item, simulated in zip(judged, rows, strict=True):
        difference = _difference(item.log, simulated, "position")[item.log.valid]
        sums[item.log.experiment] = sums.get(item.log.experiment, 0.0) + float(difference @ difference)
    return np.array(list(sums.values()))


def squares(judged: Sequence[JudgedLog], rows: Sequence[Array], channel: str) -> StrokeSums:
    """Measured less simulated of every log, summed over half strokes."""
    signals = [_difference(item.log, simulated, channel) for item, simulated in zip(judged, rows, strict=True)]
    return _by_stroke(judged, [signal * signal for signal in signals])


def _by_stroke(judged: Sequence[JudgedLog], squares: Sequence[Array]) -> StrokeSums:
    """Sums of the valid rows of `squares` (n,), one of each log, over the half strokes of each experiment."""
    sums: dict[tuple[str, int], Array] = {}
    for (log, strokes), square in zip(judged, squares, strict=True):
        for number, stroke in enumerate(strokes):
            part, place = square[stroke][log.valid[stroke]], (log.experiment, number)
            sums[place] = sums.get(place, np.zeros(2)) + np.array([part.sum(), len(part)])
    return StrokeSums(*np.array([sums[place] for place in sorted(sums)]).reshape(-1, 2).T)


def _difference(log: Log, simulated: Array, channel: str) -> Array:
    if channel == "position":
        return log.position - column(simulated, "measured")[: log.rows]
    if log.current is None:
        return np.zeros(log.rows)
    return log.current - column(simulated, "measured_current")[: log.rows]


def floor(judged: Sequence[JudgedLog], rows: Sequence[Array], channel: str) -> StrokeSums:
    """What repeats differ by: mean |r_a - r_b|^2 / 2 of measured less simulated `rows`, summed over half strokes.

    Zeros where nothing was repeated; what was recorded once among repeats is as noisy as these.  A drift from repeat to
    repeat that the model predicts is no noise.
    """
    pairs = zip((item.log for item in judged), rows, strict=True)
    residuals = {log.name: _difference(log, simulated, channel) for log, simulated in pairs}
    groups = by_experiment([item.log for item in judged])
    squares = [_apart(item.log, groups[item.log.experiment], residuals) for item in judged]
    repeated = [len(groups[item.log.experiment]) > 1 for item in judged]
    usual = float(np.mean(np.concatenate(list(compress(squares, repeated))))) if any(repeated) else 0.0
    known = [square if told else np.full_like(square, usual) for square, told in zip(squares, repeated, strict=True)]
    return _by_stroke(judged, known)


def _apart(log: Log, repeats: Sequence[Log], residuals: dict[str, Array]) -> Array:
    """Half the mean squared difference (n,) of one repeat from the others; 0 beyond the shortest."""
    own = residuals[log.name]
    others = [residuals[other.name] for other in repeats if other is not log]
    rows = min([len(own), *(len(other) for other in others)])
    total = sum(((own[:rows] - other[:rows]) ** 2 for other in others), np.zeros(rows))
    return np.concatenate([total / max(2 * len(others), 1), np.zeros(len(own) - rows)])


def gap(before: StrokeSums, after: StrokeSums, least: StrokeSums, unit: str, expected: float | None = None) -> Gap:
    """The gap of one channel, with the 95 % interval of its closure over resampled half strokes.

    `least` is the floor, `expected` the closure on the data that chose the effects.
    """
    sums = (before, after, least)
    count = max(float(before.samples.sum()), 1.0)
    rms = tuple(math.sqrt(float(part.squares.sum()) / count) for part in sums)
    whole = _closure(*(part.squares.sum() for part in sums))
    strokes = len(before.squares)
    picks = np.random.default_rng(1).integers(0, strokes, (BOOTSTRAP_RESAMPLES, strokes))
    resampled = _closure(*(part.squares[picks].sum(1) for part in sums))
    known = np.isfinite(resampled).mean() >= LEAST_RESAMPLES
    low, high = np.nanquantile(resampled, [0.025, 0.975]) if known else (np.nan, np.nan)
    return Gap(rms[0], rms[1], rms[2], unit, float(whole), float(low), float(high), expected)


def worse(p: Gap, factor: float) -> Gap:
    """The gap where the squares after are `factor` times as large; none is larger than before."""
    after = min(p.after * math.sqrt(factor), max(p.before, p.after))
    share = (after**2 - p.floor**2) / max(p.after**2 - p.floor**2, 1e-300)
    low, closed, high = (1.0 - share * (1.0 - value) for value in (p.low, p.closure, p.high))
    return p._replace(after=after, closure=closed, low=low, high=high)


def _closure(before: Array, after: Array, least: Array) -> Array:
    """NaN where nothing lies above the floor: there is nothing to close."""
    whole = np.where(before > least, before - least, np.nan)
    closed: Array = 1.0 - (after - least) / whole
    return closed


def traces(
    logs: Sequence[Log], before: Sequence[Array], after: Sequence[Array], least: float, dt: float
) -> list[Trace]:
    """Simulated less measured position of the first repeat of every run, before and after."""
    first = {log.experiment: number for number, log in reversed(list(enumerate(logs)))}
    return [_trace(logs[k], before[k], after[k], least, dt) for k in sorted(first.values())]


def _trace(log: Log, before: Array, after: Array, least: float, dt: float) -> Trace:
    time = dt * np.arange(log.rows, dtype=np.float64)
    reference = log.reference if log.reference is not None else log.position
    first, last = (-_difference(log, rows, "position") for rows in (before, after))
    return Trace(log.name, time, reference, first, last, least)
