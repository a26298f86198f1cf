"""What a drive does to single commands: seen in the signature of the missing current, not in any mean force.

A command in steps leaves a saw tooth over the command itself, whatever the axis does; a delay that jitters leaves
noise that grows with the slope of the current.  Neither moves the axis by much, and neither is foretold by a column.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from stagectl.gap.effects.stage_changes import put
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import sensitivities
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.model_tracking import MeasuredPath
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.result.diagnosis import FoundEffect, Value
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels.stage import Stage
from stagectl.parallel import in_parallel

STEPS = (5e-4, 0.2)  # A, between which a step of the command is looked for
BINS = 8  # of the smallest step
FINEST = 2**17  # steps in the range of the commands: a drive's object has 16 bits
CLEAR = 40.0  # times the mean power of noise: e^-40 times the number of frequencies is what noise alone would reach
WHOLE = (0.4, 1.4)  # of a saw tooth's first harmonic, step over pi: less or more is something else
SPOILT = 0.02  # share of the current's noise variance that a jitter must make
SURE = 8.0  # standard deviations
STEP = 5e-5  # s, of the dead time, by which the current's answer is differenced
CERTAIN = 0.98


class Signature(NamedTuple):
    """An effect found, and what it changes in the model."""

    effect: FoundEffect
    place: str  # field of the stage
    value: float

    def put_in(self, p: Stage) -> Stage:
        """`p` with it."""
        return put(p, self.place, self.value)


class Missing(NamedTuple):
    """One log's missing current beside its command, (n,) each."""

    command: Array  # A
    current: Array  # A, measured less that of the drive's model
    answer: Array  # A/s, of the model's current to a longer dead time


def signatures(session: Session, e: Evidence, now: Fitted, excluded: tuple[str, ...]) -> list[Signature]:
    """The drive's effects on single commands; none where no current is measured beside the command."""
    if not np.isfinite(e.runs[0].mean.rows[:, 2]).all() or not all(log.exact for run in e.runs for log in run.logs):
        return []
    logs = missing(now.equipped, e)
    single = [one for run in logs for one in run]
    found = [("current_quantisation", quantised(session, single)), ("jitter", jittered(logs))]
    return [one for name, one in found if one is not None and name not in excluded]


def missing(p: TrackedModel, e: Evidence) -> list[list[Missing]]:
    """The missing current of every run and repeat, where its rows count."""
    later = p._replace(stage=put(p.stage, "drive.dead_time", p.stage.drive.dead_time + STEP))

    def of(run: Run) -> list[Missing]:
        keep = np.logical_and.reduce([log.valid[: run.rows] for log in run.logs])
        keep[:8] = False  # the drive model's line is empty
        return [_along(p, later, path, keep) for path in run.paths]

    return in_parallel(of, e.runs)


def _along(p: TrackedModel, later: TrackedModel, path: MeasuredPath, keep: NDArray[np.bool_]) -> Missing:
    plain, moved = sensitivities.model_residual(p, path).current, sensitivities.model_residual(later, path).current
    return Missing(*(one[keep] for one in (path.rows[:, 0], plain, (plain - moved) / STEP)))


def quantised(session: Session, logs: list[Missing]) -> Signature | None:
    """Steps of the command, by the spectrum of the missing current over the command.

    Its first harmonic is ``step / pi``.  One histogram of the missing current over the command, and its Fourier
    transform, try all steps at once.
    """
    late = session.stage.drive.delay_samples
    found = [one for shift in range(late, late + 3) if (one := _step(logs, shift)) is not None]
    if not found:
        return None
    step, _, width = max(found, key=lambda one: one[1])
    value = Value(step, step - width, step + width, "A")
    effect = FoundEffect(
        "current_quantisation", (), CERTAIN, 0.0, {"step": value}, "drive", (("drive.current_quantum", step),),
        coordinate="current",
    )  # fmt: skip
    return Signature(effect, "drive.current_quantum", step)


def _step(logs: list[Missing], shift: int) -> tuple[float, float, float] | None:
    """Step (A), its power in units of noise, and half the width of the line; None where none stands out.

    `shift` rows lie between a command and the current that it gives.
    """
    command = np.concatenate([one.command[: len(one.command) - shift] for one in logs])
    current = np.concatenate([one.current[shift:] for one in logs])
    current = current - np.polynomial.Polynomial.fit(command, current, 3)(command)
    low, high = float(command.min()), float(command.max())
    smallest = max(STEPS[0], (high - low) / FINEST)
    width = smallest / BINS
    place = np.round((command - low) / width).astype(np.int64)
    count = fft.next_fast_len(4 * (int(place.max()) + 1), real=True)
    power = np.abs(fft.rfft(np.bincount(place, current, count))) ** 2 / max(float(np.sum(current**2)), 1e-300)
    per_ampere = np.arange(len(power)) / (count * width)
    within = (per_ampere >= 1.0 / STEPS[1]) & (per_ampere <= 1.0 / smallest)
    best = int(np.argmax(np.where(within, power, 0.0)))
    step = 1.0 / float(per_ampere[best])
    first = 2.0 * math.sqrt(float(power[best]) * float(np.sum(current**2))) / len(current)
    about = np.median(power[int(0.8 * best) : int(1.25 * best) + 1])  # a gain's error falls off with the frequency
    if power[best] < CLEAR * max(1.0, about) or not WHOLE[0] < first * math.pi / step < WHOLE[1]:
        return None
    return step, float(power[best]), step * step * 0.5 / (count * width)


def jittered(runs: list[list[Missing]]) -> Signature | None:
    """A random part of the delay, by how what repeats differ by grows with the current's answer to a delay.

    ``var = noise^2 + jitter^2 answer^2``, the answer in A/s, least squares over all rows.  None without repeats: an
    error of the mean delay would pass for it.
    """
    repeated = [run for run in runs if len(run) > 1]
    if not repeated:
        return None
    answer = np.concatenate([one.answer for run in repeated for one in run])
    current = np.concatenate([one for run in repeated for one in _apart(run)])
    x, y = answer * answer, current * current
    spread = x - x.mean()
    total = float(spread @ spread)
    if total == 0.0:
        return None
    slope = float(spread @ y) / total
    left = y - y.mean() - slope * spread
    deviation = math.sqrt(float((spread * left) @ (spread * left))) / total
    if slope < SURE * deviation or slope * float(x.mean()) < SPOILT * float(y.mean()):
        return None
    size, width = math.sqrt(slope), 0.5 * deviation / math.sqrt(slope)
    value = Value(size, size - 1.96 * width, size + 1.96 * width, "s")
    effect = FoundEffect(
        "jitter", (), CERTAIN, 0.0, {"rms": value}, "drive", (("drive.jitter", size),), coordinate="frequency"
    )
    return Signature(effect, "drive.jitter", size)


def _apart(run: list[Missing]) -> list[Array]:
    """What each repeat's missing current has beside the mean of all, with the variance of a single one."""
    mean = np.mean([one.current for one in run], axis=0)
    return [math.sqrt(len(run) / (len(run) - 1)) * (one.current - mean) for one in run]
