"""When the gap is open in each log, and how much of it is left."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.controller_check.recomputed_command import compared
from stagectl.gap.inference import parameter_errors, signatures, swept_parameters, thresholds
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import model_tracking, sensitivities
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.residuals.thresholds import KEPT
from stagectl.gap.residuals.tracker_response import untracked
from stagectl.gap.result.diagnosis import FoundEffect, Spans
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels import plant_with_effects
from stagectl.kernels.fields import put
from stagectl.parallel import in_parallel
from stagectl.recording import true_rows

Flags = NDArray[np.bool_]


class Contributor(NamedTuple):
    """One part of the diagnosis: the model with it and without it."""

    whole: TrackedModel
    less: TrackedModel
    block: str  # drive | mechanics | sensor
    aging: bool = False  # runs on the session clock: each repeat differs


def contributors(
    session: Session, e: Evidence, now: Fitted, named: Sequence[FoundEffect], seen: Sequence[FoundEffect]
) -> list[Contributor]:
    """Everything in the diagnosis that acts at certain times: the effects, or else the parameters that are off."""
    effects = [*_effects(session, e, now), *_of_drive(now, seen)]
    if effects:
        return effects
    return [
        Contributor(
            now.equipped,
            parameter_errors.undone(session, e, now, shift.name),
            "drive" if shift.name == "time_shift" else "mechanics",
        )
        for shift in named
    ]


def _effects(session: Session, e: Evidence, now: Fitted) -> list[Contributor]:
    """Each effect of the fitted model against all others, with the parameters that are its own at nominal values.

    Where friction falls as the machine warms, a model of the cold machine lacks that at the end, not at the beginning.
    """
    own, contributors = swept_parameters.own_parameters(session, now), []
    for valued in now.effects:
        rest = now._replace(effects=tuple(other for other in now.effects if other is not valued))
        less = parameter_errors.undone(session, e, rest, *own.get(valued.effect.name, ()))
        aging = valued.effect.time_variation is not None
        contributors.append(Contributor(now.equipped, less, valued.effect.block, aging))
    return contributors


def _of_drive(now: Fitted, seen: Sequence[FoundEffect]) -> list[Contributor]:
    """The drive's signatures together; a jitter acts where a dead time of its size would."""
    if not seen:
        return []
    plain = now.equipped
    drive = signatures.put_in(plain.stage, seen).drive
    late = put(plain, "stage.drive.dead_time", plain.stage.drive.dead_time + drive.jitter)
    return [Contributor(put(late, "stage.drive.current_quantum", drive.current_quantum), plain, "drive")]


def spans(e: Evidence, now: Fitted, runs: Sequence[Run], parts: Sequence[Contributor]) -> list[Spans]:
    """When the gap is open in each log of `runs`, those held out among them.

    It is open where one of the `parts` exceeds a fifth of its 95 % quantile over all logs.  Without any, it is open
    where the residual exceeds three standard deviations of the repeats.
    """
    flags = [_open_by(contributions(runs, part)) for part in parts] if parts else [_open_by_residual(e, now, runs)]
    result = []
    for number, run in enumerate(runs):
        for repeat, log in enumerate(run.logs):
            of_log = [by_run[number][min(repeat, len(by_run[number]) - 1)] for by_run in flags]
            opened = stretches(np.logical_or.reduce(of_log), run.mean.dt)
            result.append(Spans(log.name, opened, log.rows * run.mean.dt))
    return result


def spans_of_command(session: Session, allowed: float) -> tuple[Spans, ...]:
    """When another controller than the one that is described makes a difference of more than `allowed` (A)."""
    differing = [comparison for comparison in compared(session, allowed) if not comparison.log.held_out]
    if not differing:
        return ()
    flags = _open_by([[np.nan_to_num(np.abs(comparison.difference))] for comparison in differing])
    logs = [(comparison.log.name, comparison.log.rows * session.dt) for comparison in differing]
    return tuple(
        Spans(name, stretches(of, session.dt), length) for (name, length), [of] in zip(logs, flags, strict=True)
    )


def _open_by(sizes: Sequence[Sequence[Array]]) -> list[list[Flags]]:
    """Where the `sizes` (n,) of each run and repeat are large."""
    largest = _quantile(np.concatenate([size for repeats in sizes for size in repeats]))
    return [[size > thresholds.OPEN_SHARE * largest for size in repeats] for repeats in sizes]


def _quantile(sizes: Array) -> float:
    """95 % quantile; of the rows where it acts, if they are fewer than 5 %."""
    quantile = float(np.quantile(sizes, thresholds.CONTRIBUTION_QUANTILE))
    least = thresholds.ACTIVE_SHARE * float(sizes.max(initial=0.0))
    if quantile >= least:
        return quantile
    return float(np.quantile(sizes[sizes > least], thresholds.CONTRIBUTION_QUANTILE))


def contributions(runs: Sequence[Run], part: Contributor) -> list[list[Array]]:
    """Size (n,) of what `part` does in each run: once along the mean path, or in each repeat if it is aging.

    An effort of the mechanics (N m | N), a current of the drive (A), a position of the sensor (rad | m).
    """
    paths = [(run, path) for run in runs for path in (run.paths if part.aging else (run.mean,))]

    def size(place: tuple[Run, model_tracking.MeasuredPath]) -> Array:
        if part.block == "sensor":
            return np.abs(_encoded(part.whole, place[1]) - _encoded(part.less, place[1]))
        return _difference(part.whole, part.less, place[1], part.block == "drive")

    sizes = iter(in_parallel(size, paths))
    return [[next(sizes) for _ in (run.paths if part.aging else (run.mean,))] for run in runs]


def _encoded(p: TrackedModel, path: model_tracking.MeasuredPath) -> Array:
    """Positions that the encoder's grating makes of the path."""
    encoder, pitch = p.stage.encoder, p.stage.mechanics.pitch
    return np.array([plant_with_effects.seen(encoder, pitch, x) for x in path.rows[:, 1].tolist()])


def _difference(whole: TrackedModel, less: TrackedModel, path: model_tracking.MeasuredPath, drive: bool) -> Array:
    after, before = (sensitivities.model_residual(p, path) for p in (whole, less))
    if drive and np.isfinite(path.rows[:, 2]).all():
        return np.abs(before.current - after.current)
    return np.abs(untracked(before.effort - after.effort, whole, path.dt))


def _open_by_residual(e: Evidence, now: Fitted, runs: Sequence[Run]) -> list[list[Flags]]:
    residuals = sensitivities.residuals_of(now.equipped, runs, e.base.noise)
    means = [np.mean(repeats, axis=0) for repeats in residuals]
    noise = _noise(residuals, means, runs)
    flags = []
    for mean, run in zip(means, runs, strict=True):
        limit = thresholds.OPEN_SIGMA * np.maximum(noise, 1e-300)
        beyond = (np.abs(_smoothed(mean, run)) > limit).any(axis=1) & (run.weight > 0.0)
        flags.append([np.repeat(beyond, KEPT)[: run.rows]])
    return flags


def _noise(residuals: Sequence[list[Array]], means: Sequence[Array], runs: Sequence[Run]) -> Array:
    """Standard deviations (2,) of the repeats from their means; 1 without repeats."""
    if not any(len(repeats) > 1 for repeats in residuals):
        return np.ones(2)
    groups = zip(residuals, means, runs, strict=True)
    spread = [_smoothed(residual - mean, run) for repeats, mean, run in groups for residual in repeats]
    deviations: Array = np.sqrt(np.mean(np.concatenate(spread) ** 2, axis=0))
    return deviations


def _smoothed(signal: Array, run: Run) -> Array:
    """`signal` (m, 2), each column averaged over `thresholds.RESIDUAL_WINDOW`."""
    count = max(round(thresholds.RESIDUAL_WINDOW / (run.mean.dt * KEPT)), 1)
    return np.stack([np.convolve(column, np.ones(count) / count, mode="same") for column in signal.T], axis=1)


def stretches(flags: Flags, dt: float) -> tuple[tuple[float, float], ...]:
    """Spans (s) in which `flags` (n,) hold; short closures are bridged, short openings dropped."""
    joined: list[tuple[float, float]] = []
    for begin, end in ((first * dt, beyond * dt) for first, beyond in true_rows.stretches(flags)):
        if joined and begin - joined[-1][1] < thresholds.BRIDGED:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((begin, end))
    return tuple((begin, end) for begin, end in joined if end - begin >= thresholds.SHORTEST_SPAN)
