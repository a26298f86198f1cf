"""Where the gap lies: in which block of the loop, and when in each log.

The coordinate in which it lies is the matter of `coordinates`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from stagectl.gap.controller_check.command_check import CommandCheck
from stagectl.gap.inference import parameter_errors
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import model_tracking, sensitivities
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.residuals.thresholds import KEPT
from stagectl.gap.result.diagnosis import BLOCKS, FoundEffect, Spans
from stagectl.gap.selection import refine
from stagectl.gap.selection.candidates import equipped
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels import plant_with_effects
from stagectl.kernels.plant import Mechanics, Stage
from stagectl.parallel import in_parallel

OPEN = 0.2  # of the 95 % quantile of an effect's own contribution: from there on the gap is open
QUANTILE = 0.95
ABOVE = 3.0  # standard deviations of the repeats: the same where no effect is known
SMOOTH = 0.01  # s, over which a residual is averaged before it is judged
CLOSED = 0.0015  # s: a shorter closure is none; longer ones are where a quick effect changes its sign
SHORTEST = 0.001  # s, of an open span
LEAST_TRACKED = 0.1  # of the tracker's response: what it follows less is not brought back

Flags = NDArray[np.bool_]
Response = NDArray[np.complex128]


def blocks(e: Evidence, now: Fitted, checked: CommandCheck) -> dict[str, float | None]:
    """Share of the excess over the repeats' floor that each of `BLOCKS` holds; None where its cut was impossible.

    Drive and mechanics are the two cuts' own excess before anything was refitted.  The sensor holds what the misfit of
    the mechanics grows by without the effects of the encoder.  A controller that is not the deployed one comes first:
    everything else would be found on wrong grounds.
    """
    measured = bool(np.isfinite(e.runs[0].mean.rows[:, 2]).all())
    mechanics, drive = (max(float(one), 0.0) for one in excess(e, e.base.before))
    sensor = min(_of_sensor(e, now), mechanics)
    shares = {"controller": 0.0, "drive": drive, "mechanics": mechanics - sensor, "sensor": sensor}
    if not checked.agrees:
        shares = {**dict.fromkeys(BLOCKS, 0.0), "controller": 1.0}
    impossible = {"controller": not checked.checked, "drive": not measured}
    whole = sum(share for name, share in shares.items() if not impossible.get(name))
    return {name: None if impossible.get(name) else share / whole if whole else 0.0 for name, share in shares.items()}


def excess(e: Evidence, residuals: Sequence[list[Array]]) -> Array:
    """(2,) sum of squares of effort and current above what repeats differ by."""
    found = np.zeros(2)
    for run, repeats, deviations in zip(e.runs, residuals, e.deviations, strict=True):
        scale = len(repeats) / max(len(repeats) - 1, 1)
        for one, deviation in zip(repeats, deviations, strict=True):
            weighted = run.weight[:, None] * np.stack([one, deviation])
            found += np.sum(weighted[0] ** 2, axis=0) - scale * np.sum(weighted[1] ** 2, axis=0)
    return found


def _of_sensor(e: Evidence, now: Fitted) -> float:
    others = [one for one in now.effects if one.effect.block != "sensor"]
    if len(others) == len(now.effects):
        return 0.0
    left = refine.residuals(e, now.model, others)
    return max(float(excess(e, left)[0] - excess(e, now.residuals)[0]), 0.0)


class _Contribution(NamedTuple):
    """What one effect does in one log, in the unit in which it acts."""

    run: int
    repeat: int
    size: Array  # (n,) N m | N, A, or rad | m


class Part(NamedTuple):
    """Something of the answer: the model with it and without it."""

    whole: TrackedModel
    less: TrackedModel
    block: str  # drive | mechanics | sensor
    aging: bool = False  # runs on the session clock: each repeat is another


def _effects(now: Fitted) -> list[Part]:
    """Each effect of the fitted model against all others."""
    rests = [(one, [other for other in now.effects if other is not one]) for one in now.effects]
    return [
        Part(now.equipped, equipped(now.model, rest), one.effect.block, one.effect.time_variation is not None)
        for one, rest in rests
    ]


def parts(session: Session, now: Fitted, named: Sequence[FoundEffect], improved: Stage) -> list[Part]:
    """What was found, for where it acts: the effects; where there are none, the parameters that are off."""
    effects = _effects(now)
    signed = {one.name for one in named} & {"current_quantisation", "jitter"}
    if signed:
        plain = now.equipped
        drive = plain.stage.drive._replace(
            current_quantum=improved.drive.current_quantum,
            dead_time=plain.stage.drive.dead_time + improved.drive.jitter,
        )
        effects.append(Part(plain._replace(stage=plain.stage._replace(drive=drive)), plain, "drive"))
    if effects:
        return effects
    return [
        Part(
            now.equipped,
            parameter_errors.undone(session, now, one.name),
            "drive" if one.name == "time_shift" else "mechanics",
        )
        for one in named
    ]


def spans(e: Evidence, now: Fitted, runs: Sequence[Run], parts: Sequence[Part]) -> list[Spans]:
    """When the gap is open in each log of `runs`, those held out among them.

    Where what one of the `parts` does exceeds a fifth of its 95 % quantile over all logs.  Without any: where what is
    left stands three standard deviations of the repeats above nothing.
    """
    each = [_open_by(runs, part) for part in parts] if parts else [_open_by_residual(e, now, runs)]
    found = []
    for number, run in enumerate(runs):
        for repeat, log in enumerate(run.logs):
            flags = np.logical_or.reduce([one[number][min(repeat, len(one[number]) - 1)] for one in each])
            found.append(Spans(log.name, stretches(flags, run.mean.dt), log.rows * run.mean.dt))
    return found


def _open_by(runs: Sequence[Run], part: Part) -> list[list[Flags]]:
    sizes = contributions(runs, part)
    largest = _quantile(np.concatenate([size for repeats in sizes for size in repeats]))
    return [[size > OPEN * largest for size in repeats] for repeats in sizes]


def _quantile(sizes: Array) -> float:
    """95 % quantile; of the rows where it acts, if they are fewer than 5 %."""
    quantile, least = float(np.quantile(sizes, QUANTILE)), 1e-3 * float(sizes.max(initial=0.0))
    if quantile >= least:
        return quantile
    return float(np.quantile(sizes[sizes > least], QUANTILE))


def contributions(runs: Sequence[Run], part: Part) -> list[list[Array]]:
    """Size (n,) of what `part` does in each run: once along the mean path, of each repeat if it runs on the clock.

    An effort of the mechanics (N m | N), a current of the drive (A), a position of the sensor (rad | m).
    """
    paths = [(run, path) for run in runs for path in (run.paths if part.aging else (run.mean,))]

    def of(place: tuple[Run, model_tracking.MeasuredPath]) -> Array:
        if part.block == "sensor":
            return np.abs(_encoded(part.whole, place[1]) - _encoded(part.less, place[1]))
        return _lacking(part.whole, part.less, place[1], part.block == "drive")

    sizes = iter(in_parallel(of, paths))
    return [[next(sizes) for _ in (run.paths if part.aging else (run.mean,))] for run in runs]


def _encoded(p: TrackedModel, path: model_tracking.MeasuredPath) -> Array:
    """Positions that the encoder's grating makes of the path."""
    encoder, pitch = p.stage.encoder, p.stage.mechanics.pitch
    return np.array([plant_with_effects.seen(encoder, pitch, x) for x in path.rows[:, 1].tolist()])


def _lacking(whole: TrackedModel, less: TrackedModel, path: model_tracking.MeasuredPath, drive: bool) -> Array:
    after, before = (sensitivities.model_residual(p, path) for p in (whole, less))
    if drive and np.isfinite(path.rows[:, 2]).all():
        return np.abs(before.current - after.current)
    return np.abs(untracked(before.effort - after.effort, whole, path.dt))


def untracked(effort: Array, p: TrackedModel, dt: float) -> Array:
    """`effort` (n,) as it acted: without the lag of the tracker that answered it.

    ``T = C P / (1 + C P)`` of the tracker C and a free mass P with its damping, divided out up to where T is small.
    """
    response = tracking(p, lines_of(len(effort), dt), dt)
    inverse = (np.conj(response) / (np.abs(response) ** 2 + LEAST_TRACKED**2)).astype(np.complex128)
    return passed(effort, inverse) * (1.0 + LEAST_TRACKED**2)


def tracking(p: TrackedModel, lines: Array, dt: float) -> Response:
    """What the tracker answers to an effort, at the frequencies `lines` (f,) Hz."""
    return _response(p, np.exp(2j * np.pi * dt * lines), dt)


def lines_of(count: int, dt: float) -> Array:
    """Frequencies (f,) Hz of signals of `count` rows at `dt` (s), mirrored and filled up as in `passed`."""
    return np.asarray(fft.rfftfreq(2 * fft.next_fast_len(count, real=True), dt), dtype=np.float64)


def passed(signals: Array, response: Array | Response) -> Array:
    """`signals` (..., n) through a filter with this response at their lines, mirrored so that no end rings."""
    count, rows = signals.shape[-1], 2 * (len(response) - 1)
    fill = np.repeat(signals[..., :1], rows - 2 * count, axis=-1)
    mirrored = np.concatenate([signals, signals[..., ::-1], fill], axis=-1)
    found: Array = fft.irfft(fft.rfft(mirrored) * response, rows)[..., :count]
    return found


def _response(p: TrackedModel, z: NDArray[np.complex128], dt: float) -> NDArray[np.complex128]:
    c, m = p.tracker, p.stage.mechanics
    z = np.where(z == 1.0, 1.0 + 1e-9, z)
    controller = c.proportional + c.integral * (z + 1.0) / (z - 1.0) + c.derivative * (z - 1.0) / (z - c.decay)
    loop = controller * p.stage.motor.force_constant * _mass(m, z, dt) * z ** -float(p.stage.encoder.delay_samples)
    response: NDArray[np.complex128] = loop / (1.0 + loop)
    return response


def _mass(m: Mechanics, z: NDArray[np.complex128], dt: float) -> NDArray[np.complex128]:
    """Position per held effort: velocity decays by ``a = exp(-D dt / J)``."""
    if m.viscous <= 0.0:
        return dt * dt / (2.0 * m.inertia) * (z + 1.0) / (z - 1.0) ** 2
    rate = m.viscous / m.inertia
    a, gain = np.exp(-rate * dt), 1.0 / m.viscous
    velocity = (1.0 - a) / (z - a)  # times gain
    moved: NDArray[np.complex128] = (dt - (1.0 - a) / rate + (1.0 - a) / rate * velocity) / (z - 1.0)
    mass: NDArray[np.complex128] = gain * moved
    return mass


def _open_by_residual(e: Evidence, now: Fitted, runs: Sequence[Run]) -> list[list[Flags]]:
    each = sensitivities.residuals_of(now.equipped, runs, e.base.noise)
    means = [np.mean(repeats, axis=0) for repeats in each]
    groups = zip(each, means, runs, strict=True)
    spread = [_smoothed(one - mean, run) for repeats, mean, run in groups for one in repeats]
    noise = np.sqrt(np.mean(np.concatenate(spread) ** 2, axis=0)) if any(len(one) > 1 for one in each) else np.ones(2)
    found = []
    for mean, run in zip(means, runs, strict=True):
        beyond = (np.abs(_smoothed(mean, run)) > ABOVE * np.maximum(noise, 1e-300)).any(axis=1) & (run.weight > 0.0)
        found.append([np.repeat(beyond, KEPT)[: run.rows]])
    return found


def _smoothed(signal: Array, run: Run) -> Array:
    """(m, 2) averaged over `SMOOTH`."""
    count = max(round(SMOOTH / (run.mean.dt * KEPT)), 1)
    return np.stack([np.convolve(one, np.ones(count) / count, mode="same") for one in signal.T], axis=1)


def stretches(flags: Flags, dt: float) -> tuple[tuple[float, float], ...]:
    """Spans (s) in which `flags` (n,) hold, short closures bridged and short openings left out."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0))
    found: list[tuple[float, float]] = []
    for begin, end in zip((edges[::2] * dt).tolist(), (edges[1::2] * dt).tolist(), strict=True):
        if found and begin - found[-1][1] < CLOSED:
            found[-1] = (found[-1][0], end)
        else:
            found.append((begin, end))
    return tuple((begin, end) for begin, end in found if end - begin >= SHORTEST)
