"""How far the gap shrinks: the held-out runs simulated again in closed loop, before and after.

Nothing of these runs chose an effect or a value.  The gap is measured minus simulated under the same controller and
reference; the floor is what repeats differ by.
"""

import math
from collections.abc import Sequence
from itertools import compress
from typing import NamedTuple

import numpy as np

from stagectl.design import margins
from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.half_strokes import (
    by_experiment,
    half_strokes,
    known_from,
    spans,
    standstills,
    without_drift_at_rest,
)
from stagectl.gap.residuals.noise_at_rest import Spans
from stagectl.gap.result.diagnosis import Gap, Trace
from stagectl.gap.validation.rollouts import column
from stagectl.gap.validation.thresholds import BOOTSTRAP_RESAMPLES, LEAST_JUDGED, LEAST_RESAMPLES, SETTLING


class JudgedLog(NamedTuple):
    """A log, and the half strokes over which its gap is summed."""

    log: Log
    strokes: list[slice]
    rests: Spans = ()


class StrokeSums(NamedTuple):
    """Sums of squares over each half stroke (c,), of one model; repeats of a half stroke are wrong alike: one sum."""

    squares: Array  # of the channel's unit
    samples: Array


def judged_logs(session: Session, logs: Sequence[Log]) -> list[JudgedLog]:
    """The logs in half strokes, less the rows in which the friction's state is that of an earlier motion or of a rest.

    No quiet model knows that state: at rest, noise makes the friction creep.  A log of small steps, which is hardly
    ever without it, is judged whole.
    """
    zone, settling = friction_family.length(session.stage.friction), _settling(session)
    return [_judged(log, zone, settling, session.dt) for log in logs]


def _judged(log: Log, zone: float, settling: int, dt: float) -> JudgedLog:
    """`log`, judged once the axis has moved through the `zone` (rad | m) and the loop has had `settling` rows."""
    valid = log.valid.copy()
    rests = standstills(log.position if log.reference is None else log.reference, dt)
    for start in (0, *(end for _, end in rests)):
        moved = known_from(log.position[start:], zone)
        valid[start : start + moved + settling * (moved > 0)] = False
    kept = valid if valid.sum() >= LEAST_JUDGED * log.valid.sum() else log.valid
    return JudgedLog(log._replace(valid=kept), spans(half_strokes(log.position, dt)), tuple(rests))


def _settling(session: Session) -> int:
    """Rows until the deployed loop has forgotten a disturbance; 0 where it is not known."""
    law, dt = session.law, session.dt
    if law is None:
        return 0
    feedback = law.cascade if law.cascaded else law.feedback
    crossover = margins(session.stage, feedback, dt, law.observer).crossover
    return round(SETTLING / (crossover * dt)) if crossover > 0.0 else 0


def remaining(judged: Sequence[JudgedLog], rows: Sequence[Array]) -> Array:
    """Sums of squares (k,) of measured less simulated position, one of each experiment."""
    sums: dict[str, float] = {}
    for item, simulated in zip(judged, rows, strict=True):
        difference = _difference(item, simulated, "position")[item.log.valid]
        sums[item.log.experiment] = sums.get(item.log.experiment, 0.0) + float(difference @ difference)
    return np.array(list(sums.values()))


def squares(judged: Sequence[JudgedLog], rows: Sequence[Array], channel: str) -> StrokeSums:
    """Measured less simulated of every log, summed over half strokes."""
    signals = [_difference(item, simulated, channel) for item, simulated in zip(judged, rows, strict=True)]
    return _by_stroke(judged, [signal * signal for signal in signals])


def _by_stroke(judged: Sequence[JudgedLog], squares: Sequence[Array]) -> StrokeSums:
    """Sums of the valid rows of `squares` (n,), one of each log, over the half strokes of each experiment."""
    sums: dict[tuple[str, int], Array] = {}
    for (log, strokes, _), square in zip(judged, squares, strict=True):
        for number, stroke in enumerate(strokes):
            part, place = square[stroke][log.valid[stroke]], (log.experiment, number)
            sums[place] = sums.get(place, np.zeros(2)) + np.array([part.sum(), len(part)])
    return StrokeSums(*np.array([sums[place] for place in sorted(sums)]).reshape(-1, 2).T)


def _difference(item: JudgedLog, simulated: Array, channel: str) -> Array:
    """Measured less simulated (n,), without its slow course while the axis stands."""
    return without_drift_at_rest(_apart(item.log, simulated, channel), item.rests)


def _apart(log: Log, simulated: Array, channel: str) -> Array:
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
    pairs = zip(judged, rows, strict=True)
    residuals = {item.log.name: _difference(item, simulated, channel) for item, simulated in pairs}
    groups = by_experiment([item.log for item in judged])
    squares = [_variance(item.log, groups[item.log.experiment], residuals) for item in judged]
    repeated = [len(groups[item.log.experiment]) > 1 for item in judged]
    usual = float(np.mean(np.concatenate(list(compress(squares, repeated))))) if any(repeated) else 0.0
    known = [square if told else np.full_like(square, usual) for square, told in zip(squares, repeated, strict=True)]
    return _by_stroke(judged, known)


def _variance(log: Log, repeats: Sequence[Log], residuals: dict[str, Array]) -> Array:
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
    judged: Sequence[JudgedLog], before: Sequence[Array], after: Sequence[Array], least: float, dt: float
) -> list[Trace]:
    """Simulated less measured position of the first repeat of every run; NaN where it is not judged."""
    first = {item.log.experiment: number for number, item in reversed(list(enumerate(judged)))}
    return [_trace(judged[k], (before[k], after[k]), least, dt) for k in sorted(first.values())]


def _trace(item: JudgedLog, simulated: tuple[Array, Array], least: float, dt: float) -> Trace:
    log = item.log
    time = dt * np.arange(log.rows, dtype=np.float64)
    reference = log.reference if log.reference is not None else log.position
    before, after = (np.where(log.valid, -_difference(item, rows, "position"), np.nan) for rows in simulated)
    return Trace(log.name, time, reference, before, after, least)
