"""How far the gap shrinks: the held-out runs simulated again in closed loop, before and after.

Nothing of these runs chose an effect or a value.  The gap is measured minus simulated under the same controller and
reference; the floor is what repeats differ by.  Where no controller is known, no loop can be simulated, and the gap
is that of the effort along the measured path.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.residuals import friction_family, sensitivities, whitening
from stagectl.gap.residuals.half_strokes import Run, by_experiment, half_strokes, known_from, spans
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.residuals.thresholds import BAND
from stagectl.gap.result.diagnosis import Gap, Trace
from stagectl.gap.validation.rollouts import closed_all, column
from stagectl.kernels.stage import Stage

RESAMPLED = 400  # times, for the interval of the closure
NEARLY = 1.05  # squared gap, of the smallest
CHANNELS = ("position", "current")  # of the tracking error it is that of the position: the reference is known


class Judged(NamedTuple):
    """A log, and the half strokes over which its gap is summed."""

    log: Log
    strokes: list[slice]


class Squares(NamedTuple):
    """Sums of squares of each half stroke (c,), one model."""

    gap: Array
    samples: Array  # of each


def predicted(session: Session, stage: Stage, logs: Sequence[Log]) -> list[Array]:
    """Simulated rows of each log; repeats that begin at one place on one clock share a simulation."""
    aging = _aging(stage)
    keys = [(log.experiment, log.start if aging else 0.0, round(float(log.position[0]), 12)) for log in logs]
    first = {key: log for key, log in reversed(list(zip(keys, logs, strict=True)))}
    found = dict(zip(first, closed_all(session, stage, list(first.values())), strict=True))
    return [found[key] for key in keys]


def closest(session: Session, stages: Sequence[Stage], logs: Sequence[Log]) -> Stage:
    """The first of `stages` whose loop follows `logs` nearly as closely as that of the best of them.

    What a model explains of the effort need not bring its position nearer: a table or a fit that leads away from the
    logs that it was made on is left out.
    """
    counts = counted(session, logs)
    sums = [remaining(counts, predicted(session, one, logs)) for one in stages]
    return next(one for one, left in zip(stages, sums, strict=True) if left <= NEARLY * np.nanmin(sums))


def _aging(p: Stage) -> bool:
    """Whether something in the model runs on the session clock."""
    mechanics, friction = p.mechanics, p.friction
    rises = (mechanics.viscous_warming.rise, friction.warming.rise, mechanics.viscous_step.share, friction.step.share)
    return any(rises)


def counted(session: Session, logs: Sequence[Log]) -> list[Judged]:
    """The logs, less the rows in which the friction's state is still that of an earlier motion, in half strokes.

    No model can know it; it is over once the axis has gone through its rolling zone.
    """
    zone, found = friction_family.length(session.stage.friction), []
    for log in logs:
        valid = log.valid.copy()
        valid[: known_from(log.position, zone)] = False
        found.append(Judged(log._replace(valid=valid), spans(half_strokes(log.position, session.dt))))
    return found


def remaining(judged: Sequence[Judged], rows: Sequence[Array]) -> float:
    """Sum of squares of measured less simulated position."""
    each = (
        _difference(one.log, simulated, "position")[one.log.valid] for one, simulated in zip(judged, rows, strict=True)
    )
    return float(sum(one @ one for one in each))


def squares(judged: Sequence[Judged], rows: Sequence[Array], channel: str) -> Squares:
    """Measured less simulated of every log, summed over half strokes."""
    sums, counts = [], []
    for (log, strokes), simulated in zip(judged, rows, strict=True):
        difference = _difference(log, simulated, channel)
        for piece in strokes:
            part = difference[piece][log.valid[piece]]
            sums.append(float(part @ part))
            counts.append(len(part))
    return Squares(np.array(sums), np.array(counts, dtype=np.float64))


def _difference(log: Log, simulated: Array, channel: str) -> Array:
    rows = log.rows
    if channel == "current":
        return log.current - column(simulated, "measured_current")[:rows] if log.current is not None else np.zeros(rows)
    return log.position - column(simulated, "measured")[:rows]


def floor(judged: Sequence[Judged], rows: Sequence[Array], channel: str) -> Squares:
    """What repeats differ by: mean |r_a - r_b|^2 / 2 of measured less simulated `rows`, summed over half strokes.

    Zeros where nothing was repeated.  What a model foretells of a drift from repeat to repeat is no noise.
    """
    sums, counts = [], []
    strokes = {one.log.name: one.strokes for one in judged}
    logs = [one.log for one in judged]
    left = {log.name: _difference(log, simulated, channel) for log, simulated in zip(logs, rows, strict=True)}
    for repeats in by_experiment(logs).values():
        for log in repeats:
            signal = left[log.name]
            others = [left[one.name] for one in repeats if one is not log]
            common = min([len(signal), *(len(one) for one in others)])
            squared = sum(((signal[:common] - one[:common]) ** 2 for one in others), np.zeros(common)) / max(
                2 * len(others), 1
            )
            whole = np.concatenate([squared, np.zeros(len(signal) - common)])
            for piece in strokes[log.name]:
                sums.append(float(whole[piece][log.valid[piece]].sum()))
                counts.append(int(log.valid[piece].sum()))
    return Squares(np.array(sums), np.array(counts, dtype=np.float64))


def gap(before: Squares, after: Squares, least: Squares, unit: str, expected: float | None = None) -> Gap:
    """The gap of one channel, with the interval of its closure over resampled half strokes."""
    count = max(float(before.samples.sum()), 1.0)
    rms = [math.sqrt(float(one.gap.sum()) / count) for one in (before, after, least)]
    source = np.random.default_rng(1)
    picks = source.integers(0, len(before.gap), (RESAMPLED, len(before.gap)))
    closures = _closure(before.gap[picks].sum(1), after.gap[picks].sum(1), least.gap[picks].sum(1))
    whole = _closure(before.gap.sum(), after.gap.sum(), least.gap.sum())
    low, high = np.quantile(closures, [0.025, 0.975])
    return Gap(rms[0], rms[1], rms[2], unit, float(whole), float(low), float(high), expected)


def _closure(before: Array, after: Array, least: Array) -> Array:
    return 1.0 - (after - least) / np.maximum(before - least, 1e-300)


def shapley(players: Sequence[str], value: Callable[[frozenset[str]], float]) -> dict[str, float]:
    """What each player takes from the gap, averaged over the orders in which they may be added.

    Source: L. S. Shapley, A value for n-person games, 1953.
    """
    known: dict[frozenset[str], float] = {}

    def worth(members: frozenset[str]) -> float:
        if members not in known:
            known[members] = value(members)
        return known[members]

    count, found = len(players), {}
    for player in players:
        others = [one for one in players if one != player]
        total = 0.0
        for size in range(count):
            weight = math.factorial(size) * math.factorial(count - size - 1) / math.factorial(count)
            for chosen in itertools.combinations(others, size):
                rest = frozenset(chosen)
                total += weight * (worth(rest) - worth(rest | {player}))
        found[player] = total
    return found


def traces(
    logs: Sequence[Log], before: Sequence[Array], after: Sequence[Array], least: float, dt: float
) -> list[Trace]:
    """Simulated less measured of the first repeat of every run, before and after."""
    found, seen = [], set[str]()
    for log, old, new in zip(logs, before, after, strict=True):
        if log.experiment in seen:
            continue
        seen.add(log.experiment)
        time = dt * np.arange(log.rows, dtype=np.float64)
        reference = log.reference if log.reference is not None else log.position
        first, last = (-_difference(log, rows, "position") for rows in (old, new))
        found.append(Trace(log.name, time, reference, first, last, least))
    return found


def effort(p: TrackedModel, runs: Sequence[Run], noise: whitening.Whitener, dt: float) -> Squares:
    """Effort that the model lacks along the runs, in the band of the cuts, summed over half strokes (N m | N)."""
    plain = _flat(noise)
    sums: list[float] = []
    counts: list[float] = []
    for run, repeats in zip(runs, sensitivities.residuals_of(p, runs, plain), strict=True):
        scale = math.sqrt(BAND / dt)  # back from unit density to the signal's own size
        for one in repeats:
            _by_stroke(run, scale * one[:, 0], sums, counts)
    return Squares(np.array(sums), np.array(counts))


def _flat(noise: whitening.Whitener) -> whitening.Whitener:
    return whitening.Whitener(noise.frequency, np.ones_like(noise.effort), np.zeros_like(noise.current))


def _by_stroke(run: Run, signal: Array, sums: list[float], counts: list[float]) -> None:
    for number in np.unique(run.cluster):
        mine = run.cluster == number
        sums.append(float(((signal * run.weight)[mine] ** 2).sum()))
        counts.append(float(run.weight[mine].sum()))


def effort_floor(p: TrackedModel, runs: Sequence[Run], noise: whitening.Whitener, dt: float) -> Squares:
    """What repeats differ by in that effort; zeros where nothing was repeated."""
    plain = _flat(noise)
    sums: list[float] = []
    counts: list[float] = []
    for run, repeats in zip(runs, sensitivities.residuals_of(p, runs, plain), strict=True):
        mean, count = np.mean(repeats, axis=0), len(repeats)
        scale = math.sqrt(BAND / dt * count / max(count - 1, 1))
        for one in repeats:
            _by_stroke(run, scale * (one - mean)[:, 0], sums, counts)
    return Squares(np.array(sums), np.array(counts))
